"""What functions of the method are given: is it a model, a run, of the same robot?"""

from collections.abc import Sequence
from typing import Any

from clothlab._validation import check_each, check_kind
from clothlab.method._arm import ControlledArm, Layout
from clothlab.method.data import Run
from clothlab.method.model import DPMPB

_ADVICE = ": `learned.to_run(trial)` makes one of a trial"


def check_model(model: Any) -> DPMPB:
    """Return a model that can be used for estimation and control.

    A ValueError if it is none, or on another device than the processor.
    """
    check_kind("model", model, DPMPB)
    if model.s_mean.device.type != "cpu":
        raise ValueError(
            f"the model is on {model.s_mean.device}: move it with `model.cpu()`, since "
            "estimation and control compute there, where their small matrices are "
            "fastest"
        )
    return model


def check_sizes(model: DPMPB, arm: ControlledArm, layout: Layout) -> None:
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


# Two steps that differ by less than this share of the longer one count as the same.
_SAME_STEP = 0.02


def common_step(runs: Sequence[Run]) -> float | None:
    """The step of these runs [s], or None where none of them knows it.

    A ValueError if runs that know their step, or the names of their numbers, differ.
    """
    known = [run.step for run in runs if run.step is not None]
    for step in known[1:]:
        if differs(step, known[0]):
            raise ValueError(
                f"these runs have steps of {known[0]:g} s and of {step:g} s: bring all "
                f"to one step, such as with runs_from_table(..., step={known[0]:g})"
            )

    _check_same_names("state_names", [run.state_names for run in runs])
    _check_same_names("command_names", [run.command_names for run in runs])
    return known[0] if known else None


def check_same_step(model: Any, run: Run) -> None:
    """A ValueError if a run has another step than those that the model learned from."""
    step = getattr(model, "step", None)
    if step is None or run.step is None or not differs(run.step, step):
        return
    told = f"the model was trained on steps of {step:g} s, this run has {run.step:g} s"
    if run.step < step:
        raise ValueError(f"{told}: resample it, runs_from_table(..., step={step:g})")
    raise ValueError(
        f"{told}, and nothing was measured in between: record it every {step:g} s, or "
        f"train a model on steps of {run.step:g} s"
    )


def differs(step: float, other: float) -> bool:
    """Whether two steps [s] are not the same but for jitter."""
    return abs(step - other) > _SAME_STEP * max(step, other)


def _check_same_names(what: str, names: list[tuple[str, ...]]) -> None:
    known = [each for each in names if each]
    for each in known:
        if each != known[0]:
            raise ValueError(
                f"these runs differ in their {what}: ({', '.join(known[0])}) and "
                f"({', '.join(each)}). Give all the same numbers in the same order"
            )
