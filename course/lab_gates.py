"""What the live lab in a page has to hold, and what its tests measured of it.

A test keeps what it measured, and `scripts/make_gates.py` writes the table into the
page "Throw a cloth".
"""

import json
from typing import NamedTuple

from clothlab._files import write_bytes
from course.repository import ROOT

KEPT = ROOT / "build" / "gates"  # of each gate what was measured last


class Gate(NamedTuple):
    """A figure that may not be beyond its bound."""

    about: str
    bound: float
    unit: str = ""
    least: bool = False  # whether it may not be below

    def holds(self, measured: float) -> bool:
        """Whether a figure is on the right side."""
        return measured >= self.bound if self.least else measured <= self.bound


_PLACES = "2,000 time steps, {} arm: largest difference of a position"
_SOLVES = "40 solves, {} arm: largest difference of a plan"
_MASKS = "200 masks, {} arm: mean overlap with those of MuJoCo's renderer (IoU)"
_SEEN = "what is seen in them, {} arm: mean distance"
_BIAS = "p over 220 recorded steps, {} arm: largest difference"
GATES = {
    "places torque": Gate(_PLACES.format("torque"), 1e-9, "rad"),
    "places muscle": Gate(_PLACES.format("muscle"), 1e-9, "rad"),
    "solves torque": Gate(_SOLVES.format("torque"), 1e-4, "rad"),
    "solves muscle": Gate(_SOLVES.format("muscle"), 1e-2, "rad, N"),
    "bias torque": Gate(_BIAS.format("torque"), 1e-3),
    "bias muscle": Gate(_BIAS.format("muscle"), 1e-3),
    "masks torque": Gate(_MASKS.format("torque"), 0.97, least=True),
    "masks muscle": Gate(_MASKS.format("muscle"), 0.95, least=True),
    "seen torque": Gate(_SEEN.format("torque"), 0.05, "s.d. of z"),
    "seen muscle": Gate(_SEEN.format("muscle"), 0.05, "s.d. of z"),
    "closed loop": Gate(
        "five cloths, two targets, 30 periods each: median best distance of a period, "
        "over Python's",
        1.10,
    ),
    "transfer": Gate("what a visitor loads, compressed", 12, "MB"),
    "one file": Gate("the page as one file", 40, "MB"),
    "ready": Gate("ready after", 3, "s"),
    "step": Gate("a step, median", 40, "ms"),
    "slow step": Gate("a step, 95 of 100 are shorter", 100, "ms"),
    "ready, slower": Gate("four times slower: ready after", 8, "s"),
    "step, slower": Gate("four times slower: a step, median", 120, "ms"),
    "slow step, slower": Gate(
        "four times slower: a step, 95 of 100 are shorter", 200, "ms"
    ),
    "memory": Gate("memory of the page after ten minutes", 400, "MB"),
    "growth": Gate("memory that 100 resets and changes of cloth add", 20, "MB"),
}


def keep(name: str, measured: float) -> None:
    """Keep a figure for the table."""
    content = json.dumps({"measured": measured}).encode()
    write_bytes(KEPT / f"{name}.json", content)


def kept() -> dict[str, float]:
    """What was measured last, by name."""
    return {
        name: json.loads((KEPT / f"{name}.json").read_text("utf-8"))["measured"]
        for name in GATES
        if (KEPT / f"{name}.json").exists()
    }
