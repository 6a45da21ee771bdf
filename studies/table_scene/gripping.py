"""The hand's grip: ties between the bar and what it holds, switched on and off.

Grasping switches on constraints that `scene` prepared: one for each point of the
cloth's first and last row, and one for the basket's handle.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from clothlab._validation import choose
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.cloth_elements import point_names


class GraspError(RuntimeError):
    """The hand closed on nothing, or did not get to where it should."""


@dataclass(frozen=True, eq=False)
class Grip:
    """The hand of a robot in front of a table, and what it holds."""

    model: mujoco.MjModel
    data: mujoco.MjData
    cloth: Cloth
    bar_length: float  # [m]

    @property
    def held(self) -> tuple[str, ...]:
        """Points of the cloth's first or last row, or `"basket"`."""
        return tuple(name for name in self.places() if self._tied(f"grip_{name}"))

    def places(self) -> dict[str, np.ndarray]:
        """Where the hand could take hold, `[3]` [m] each."""
        first, *_, last = point_names(self.cloth)
        places = {name: self.data.body(name).xpos for name in (*first, *last)}
        return places | {"basket": self.data.site("basket").xpos}

    def close(self, reach: float) -> None:
        """Take what is nearest to the bar, and no farther than `reach` [m].

        A `GraspError` where the hand is not empty, or nothing is in reach.
        """
        if self.held:
            raise GraspError(
                f"the hand is not empty, it holds {', '.join(self.held)}: "
                "release it first"
            )

        # What is nearest to the bar
        places = self.places()
        distances = {name: self._from_bar(place)[1] for name, place in places.items()}
        nearest = min(distances, key=lambda name: distances[name])
        if distances[nearest] > reach:
            raise GraspError(
                f"nothing within {100 * reach:g} cm of the hand; nearest is {nearest}, "
                f"{100 * distances[nearest]:.1f} cm away"
            )

        # And with it the points of the same edge, but no other thing
        edge = nearest.rsplit("_", 1)[0]
        in_reach = [name for name in places if distances[name] <= reach]
        self.hold_fast(name for name in in_reach if name.startswith(edge))

    def hold_fast(self, names: Iterable[str]) -> None:
        """Tie things to the bar, and let go of all else; the rack lets go of these."""
        self.release()
        places = self.places()
        for name in names:
            along, _ = self._from_bar(choose("thing to grasp", name, places))
            self.model.site(f"grip_{name}").pos[:] = [0.0, along, 0.0]
            self._tie(f"grip_{name}", True)
            if name in point_names(self.cloth)[0]:
                self._tie(f"clip_{name}", False)

    def release(self) -> None:
        """Let go of all that is in the hand."""
        for name in self.held:
            self._tie(f"grip_{name}", False)

    def _from_bar(self, place: np.ndarray) -> tuple[float, float]:
        """Where a place `[3]` is by the bar: along it, and how far from it [m]."""
        hand = self.data.body("hand")
        local = hand.xmat.reshape(3, 3).T @ (place - hand.xpos)
        along = float(np.clip(local[1], -self.bar_length / 2, self.bar_length / 2))
        return along, float(np.linalg.norm(local - [0.0, along, 0.0]))

    def _tie(self, name: str, active: bool) -> None:
        self.data.eq_active[self.model.equality(name).id] = active

    def _tied(self, name: str) -> bool:
        return bool(self.data.eq_active[self.model.equality(name).id])
