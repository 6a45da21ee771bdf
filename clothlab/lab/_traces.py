"""The curves of a live run, as plain data: the browser draws them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from clothlab.lab._session import LiveSession, StepInfo
from clothlab.simulation.arm import JOINTS
from clothlab.simulation.env import CONTROL_PERIOD


def traces(session: LiveSession, history: Sequence[StepInfo]) -> list[dict[str, Any]]:
    """The plots of a history, one below the other."""
    plots = [_distances(session, history), _angles(history)]
    if session.arm.has_stiffness:
        plots.append(_stiffness(session, history))
    plots.append(_times(history))
    return plots


def _distances(session: LiveSession, history: Sequence[StepInfo]) -> dict[str, Any]:
    """Distance to the target, what was predicted of it, and both at a period's end."""
    lines = [_line("distance", (moment.distance for moment in history))]
    predicted = [moment.predicted for moment in history]
    if any(each is not None for each in predicted):
        lines.append(_line("predicted at each step", predicted, 1, dash=1, fine=True))

    plot = _plot("distance to the target", "s.d. of z", lines)
    plot["limit"] = ("hanging still", session.still_distance)
    for k, moment in enumerate(history):
        if moment.period:
            pair = np.round(moment.period, 4).tolist()  # predicted and achieved
            plot["pairs"].append((k, *pair))
    return plot


def _angles(history: Sequence[StepInfo]) -> dict[str, Any]:
    """Angles of the joints, and their references."""
    lines = []
    for j, joint in enumerate(JOINTS):
        lines.append(_line(joint, [moment.theta[j] for moment in history], j))
    for j, joint in enumerate(JOINTS):
        sent = [moment.command[j] for moment in history]
        lines.append(_line(f"{joint} ref", sent, j, dash=1))
    return _plot("joint angles", "rad", lines)


def _stiffness(session: LiveSession, history: Sequence[StepInfo]) -> dict[str, Any]:
    at = session.arm.stiffness_command
    sent = [moment.command[at][0] for moment in history]
    return _plot("stiffness command", "N", [_line("f_const", sent)])


def _times(history: Sequence[StepInfo]) -> dict[str, Any]:
    """How long steps took to compute."""
    line = _line("step", (1e3 * moment.seconds for moment in history))
    plot = _plot("time a step took", "ms", [line])
    plot["limit"] = ("control period", 1e3 * CONTROL_PERIOD)
    return plot


def _line(
    name: str,
    values: Iterable[float | None],
    colour: int = 0,
    *,
    dash: int = 0,
    fine: bool = False,
) -> dict[str, Any]:
    """A curve, with a gap where a value is None; a fine one is not for a projector."""
    rounded = [None if value is None else round(float(value), 4) for value in values]
    return {
        "name": name,
        "values": rounded,
        "colour": colour,
        "dash": dash,
        "fine": fine,
    }


def _plot(title: str, unit: str, lines: list[dict]) -> dict[str, Any]:
    """A plot without a limit, `(name, value)`, and without pairs.

    Pairs are `(index, predicted, achieved)` of the periods that ended.
    """
    return {"title": title, "unit": unit, "lines": lines, "limit": None, "pairs": []}
