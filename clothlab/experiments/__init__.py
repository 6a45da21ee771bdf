"""Experiments: functions from frozen settings to frozen records, and the claims that stand on them.

Each module has its `Settings`, whose defaults are the full size, its `Record`, and `run(settings) -> Record`. Notebooks
run them small beside the stored record, `make results` runs them full, tests run them tiny. Those in `SLOW` take hours
and run when asked for by name.

    from clothlab import experiments
    record = experiments.load("control")                         # the stored, full-size one
    small = experiments.control.run(experiments.control.Settings(models=(0,), steps=24))
    print(experiments.recompute("integrated", model=0))           # one stored run, and the same made anew
"""

from clothlab.experiments import (
    any_target,
    cameras,
    control,
    estimation,
    experience,
    feeling,
    integrated,
    knowledge,
    limits,
    more_of_one,
    perception,
    practice,
    race,
    self_organisation,
    stiffness,
    table_setting,
    tables,
    uncertainty,
)
from clothlab.experiments._recompute import PARTS, Recomputed, recompute
from clothlab.experiments._record import EXPERIMENTS, PAPER, SLOW, load, load_all, save
from clothlab.experiments.claims import ClaimError, Findings

EXPERIMENTS.update(
    perception=perception,
    self_organisation=self_organisation,
    estimation=estimation,
    control=control,
    integrated=integrated,
    stiffness=stiffness,
    experience=experience,
    limits=limits,
    practice=practice,
    any_target=any_target,
    knowledge=knowledge,
    feeling=feeling,
    cameras=cameras,
    uncertainty=uncertainty,
    race=race,
    more_of_one=more_of_one,
    table_setting=table_setting,
)
QUICK = {"perception", "self_organisation", "estimation", "control", "integrated", "stiffness"}
SLOW.update(EXPERIMENTS.keys() - QUICK)

__all__ = [
    "EXPERIMENTS",
    "PAPER",
    "PARTS",
    "SLOW",
    "ClaimError",
    "Findings",
    "Recomputed",
    "any_target",
    "cameras",
    "control",
    "estimation",
    "experience",
    "feeling",
    "integrated",
    "knowledge",
    "limits",
    "load",
    "load_all",
    "more_of_one",
    "perception",
    "practice",
    "race",
    "recompute",
    "save",
    "self_organisation",
    "stiffness",
    "table_setting",
    "tables",
    "uncertainty",
]
