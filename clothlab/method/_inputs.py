"""What functions of the method are given: is it a model, a run, of the same robot?"""

from typing import Any

from clothlab._validation import check_each, check_kind
from clothlab.method._arm import ControlledArm, Layout
from clothlab.method.data import Run
from clothlab.method.model import PredictiveModel

_ADVICE = ": `learned.to_run(trial)` makes one of a trial"


def check_model(model: Any) -> PredictiveModel:
    """Return a model that can be used for estimation and control.

    A ValueError if it is none, or on another device than the processor.
    """
    check_kind("model", model, PredictiveModel)
    if model.s_mean.device.type != "cpu":
        raise ValueError(
            f"the model is on {model.s_mean.device}: move it with `model.cpu()`, since "
            "estimation and control compute there, where their small matrices are "
            "fastest"
        )
    return model


def check_sizes(model: PredictiveModel, arm: ControlledArm, layout: Layout) -> None:
    """A ValueError for what is no model, or for one that belongs to another arm."""
    check_model(model)
    commands = len(arm.command_lower)
    if (model.state_size, model.command_size) != (layout.size, commands):
        raise ValueError(
            f"the model has {model.state_size} states and {model.command_size} "
            f"commands, the {arm.name} arm has {layout.size} and {commands}; load the "
            "weights of this arm"
        )


def check_run(run: Any) -> Run:
    """Return one run; a ValueError for anything else, such as a trial."""
    return check_kind("run", run, Run, _ADVICE)


def check_runs(runs: Any) -> list[Run]:
    """Return runs as a list; a ValueError says which is none."""
    return check_each("runs", runs, Run, _ADVICE)
