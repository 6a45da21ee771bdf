"""Experiments: functions from frozen settings to frozen records, and the claims that stand on them.

Each module has its `Settings`, whose defaults are the full size, its `Record`, and `run(settings) -> Record`. Notebooks
run them small beside the stored record, `make results` runs them full, tests run them tiny.

    from clothlab import experiments
    record = experiments.load("control")                         # the stored, full-size one
    small = experiments.control.run(experiments.control.Settings(models=(0,), steps=24))
"""

from clothlab.experiments import (
    control,
    estimation,
    integrated,
    limits,
    perception,
    self_organisation,
    stiffness,
    tables,
)
from clothlab.experiments._record import EXPERIMENTS, load, save
from clothlab.experiments.claims import ClaimError, Findings

EXPERIMENTS.update(
    perception=perception,
    self_organisation=self_organisation,
    estimation=estimation,
    control=control,
    integrated=integrated,
    stiffness=stiffness,
    limits=limits,
)

__all__ = [
    "EXPERIMENTS",
    "ClaimError",
    "Findings",
    "control",
    "estimation",
    "integrated",
    "limits",
    "load",
    "perception",
    "save",
    "self_organisation",
    "stiffness",
    "tables",
]
