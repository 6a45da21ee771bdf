"""The table scene as an environment: a base that drives, contacts, a hand that grasps.

It also says how cloth and basket really lie. What the robot itself can see is in
`perception`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number, choose
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, hanging_points
from clothlab.simulation.cloth_elements import point_names
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.simulation.scene import Scene
from studies.table_scene.gripping import Grip
from studies.table_scene.scene import Furniture, build_spec, place_furniture

_STARTS = ("rack", "hand")  # where the cloth hangs at the start
_ON_TOP = 0.015  # [m] a point so near the table's top, in height, lies on it
_PIXEL = 0.001  # [m] with which areas are measured


@dataclass(frozen=True, eq=False)
class ClothPose:
    """How a cloth lies: by its points, or by what a camera sees of it."""

    # Share of its points, or of its seen surface, that lies on the table's top
    flat: float
    area: float  # what it covers seen from above, over the flat cloth's area
    # Of its length from straight ahead, counterclockwise [degree]; a camera sees a
    # rectangle: -45 to 45
    angle: float
    # Mean of its points, or middle of the rectangle that is seen `[3]` [m]
    centre: np.ndarray
    # Whether a camera sees its back, as when its far edge went forward
    back_up: bool = True

    @property
    def fault(self) -> str:
        """Why the cloth is not spread, in words; empty if it is.

        A spread cloth lies flat with 85 % of it, covers 85 % of its area, and is turned
        by 15° at most.
        """
        if self.flat < 0.85:
            return "it does not lie flat on the table"
        if self.area < 0.85:
            return "it is folded or hangs over the edge"
        if not self.back_up:
            return "it lies the wrong way round"
        return "it is turned" if abs(self.angle) > 15.0 else ""

    @property
    def spread(self) -> bool:
        """Whether the cloth is spread."""
        return not self.fault


@dataclass(frozen=True)
class Placement:
    """How the basket stands."""

    tilt: float  # from upright [degree]
    off_centre: float  # from its middle to the cloth's, level [m]
    on_table: bool  # whether it stands on the table at all

    @property
    def success(self) -> bool:
        """Whether it is placed: on the table, at most 5° tilted and 4 cm off centre."""
        return self.on_table and self.tilt <= 5.0 and self.off_centre <= 0.04


class TableEnv(ClothEnv):
    """A robot in front of a table to set.

    A cloth hangs from a rack, a basket stands on a side table, the robot's base drives,
    things touch, and the hand grasps. As `ClothEnv`, with these differences:

    * A command may have one number more: the place where the base should be at the end
      of the control period [m]. Without it the base stays, so that policies that know
      no base work here too.
    * At the start the cloth hangs from the `"rack"`, far from the table, or is in the
      `"hand"` above it. `grasp` and `release` take it and let go; a command of an arm
      whose hand opens on command lets go within the period.
    * `reset` and `start` draw the places of rack and basket, and how a cloth is held
      that begins in the hand.
    * The arm's home is the furniture's start posture. A camera named `"room"` shows the
      whole scene.

    Args:
        arm: the robot's arm, or its name.
        cloth: the cloth, or its name.
        furniture: where things stand, and how far they are drawn from there.
        start_in: where the cloth hangs at the start: `"rack"` or `"hand"`.
        scene: as of `ClothEnv`.
        options: the other options of `ClothEnv`.
    """

    command: np.ndarray  # the arm's last one `[D_u]`

    def __init__(
        self,
        arm: Arm | str = "muscle",
        cloth: Cloth | str = "hard-1",
        *,
        furniture: Furniture = Furniture(),
        start_in: str = "rack",
        scene: Scene = Scene(),
        render_mode: str | None = None,
    ):
        self.furniture = furniture
        self.start_in = choose("start", start_in, {name: name for name in _STARTS})
        self._release_in: int | None = None  # time steps until the hand opens
        # Where the base should be after each time step to come [m]
        self._base_path: list[float] = []
        arm = replace(get_arm(arm), home=self.furniture.start_posture)
        super().__init__(arm, cloth, scene=scene, render_mode=render_mode)

    @property
    def base(self) -> float:
        """Where the base is [m]; 0 in front of the table."""
        return float(self.data.joint("base").qpos[0])

    @property
    def base_goal(self) -> float:
        """Where the base was last sent [m]."""
        return float(self.data.actuator("base").ctrl[0])

    @property
    def held(self) -> tuple[str, ...]:
        """What is in the hand: points of the cloth's first or last row, or the basket.

        The basket is called `"basket"`, points have the names of `point_names`.
        """
        return self._grip.held

    @property
    def hand(self) -> np.ndarray:
        """Where the middle of the bar is `[3]` [m].

        The robot only sees it, or computes it from what it senses.
        """
        return self.data.site("hand").xpos.copy()

    def advance(
        self, u: ArrayLike, watch: Callable[[], None] | None = None, samples: int = 1
    ) -> None:
        """Hold a command for one control period, as `ClothEnv.advance` does.

        It is the arm's `[D_u]`, or that and a place of the base `[D_u + 1]`.
        """
        # A command of the base comes last, and is no matter of the arm
        size = len(self.arm.command_names)
        u = np.array(u, dtype=np.float64)
        if u.shape == (size + 1,):
            self._send_base(u[size])
            u = u[:size]

        # A hand that is closed for a part of the period opens within it
        closed = u[self.arm.closed_command] if u.shape == (size,) else np.empty(0)
        opens = closed.size and 0 <= closed[0] < 1 and self.held
        if opens:
            seconds = float(closed[0]) * CONTROL_PERIOD
            self._release_in = round(seconds / self.scene.time_step)

        # What was for this period only must not reach into the next
        try:
            super().advance(u, watch, samples)
            self.command = u
        finally:
            self._release_in = None
            self._base_path = []
        if opens:
            self.release()

    def grasp(self) -> tuple[str, ...]:
        """Close the hand on the nearest edge of the cloth, or the basket's handle.

        Returned is what is now in the hand; a `GraspError` where it was not empty, or
        nothing is in reach.
        """
        self._grip.close(self.furniture.reach)
        return self.held

    def hold_fast(self, names: Iterable[str]) -> None:
        """Tie points of the cloth's first or last row, or `basket`, to the bar.

        The hand lets go of all else, the rack of these points.
        """
        self._grip.hold_fast(names)

    def release(self) -> None:
        """Let go of all that is in the hand, at once."""
        self._grip.release()

    def place_cloth(self, points: ArrayLike) -> None:
        """Put the points of the cloth `[rows, columns, 3]` [m] somewhere, at rest."""
        shape = (self.cloth.rows, self.cloth.columns, 3)
        places = check_array("points", points, shape).reshape(-1, 3)
        names = np.ravel(point_names(self.cloth))
        for name, place in zip(names, places, strict=True):
            offset = place - self.model.body(name).pos
            for axis, value in zip("xyz", offset, strict=True):
                joint = self.data.joint(f"{name}_{axis}")
                joint.qpos[0] = value
                joint.qvel[0] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def cloth_pose(self) -> ClothPose:
        """How the cloth lies on the table."""
        return _measure_pose(self.cloth, self.furniture, self.cloth_points())

    def placement(self) -> Placement:
        """How the basket stands now."""
        basket = self.data.body("basket")
        over = _over_table(self.furniture, basket.xpos[0], basket.xpos[1])
        level = abs(basket.xpos[2] - self.furniture.height) <= _ON_TOP
        off = basket.xpos[:2] - self.cloth_points().mean(axis=(0, 1))[:2]
        upright = np.clip(basket.xmat.reshape(3, 3)[2, 2], -1, 1)
        return Placement(
            tilt=float(np.rad2deg(np.arccos(upright))),
            off_centre=float(np.linalg.norm(off)),
            on_table=bool(over and level and "basket" not in self.held),
        )

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode, as `ClothEnv.start` does.

        A cloth in the hand waits longer, because a soft arm sags.
        """
        super().start(seed=seed, random_start=random_start)
        if self.start_in == "hand":
            wait = self.np_random.uniform(*self.furniture.wait)
            self._simulate(round(wait / self.scene.time_step))
            self.data.time = 0.0
            mujoco.mj_forward(self.model, self.data)

    def _spec(self) -> mujoco.MjSpec:
        return build_spec(self.arm, self.cloth, self.scene, self.furniture)

    @property
    def _grip(self) -> Grip:
        """The hand in the present scene, which `hold` replaces."""
        return Grip(self.model, self.data, self.cloth, self.arm.bar_length)

    def _place(self, u: np.ndarray) -> None:
        """Draw where rack and basket are, and put arm and cloth where they begin.

        `u` is the arm's first command `[D_u]`.
        """
        place_furniture(self.data, self.furniture, self.np_random)
        u = u.copy()
        if self.start_in == "hand":
            self._place_robot(0.0, u)
            self._hang_from_hand()
        else:
            rack = self.model.body("rack").pos[0]
            u[self.arm.angle_command] = self.furniture.look_posture
            self._place_robot(rack - self.furniture.look_ahead, u)
            self._hang_from_rack()

    def _place_robot(self, base: float, u: np.ndarray) -> None:
        """Put the base in its place [m], and the arm where a command wants it."""
        self.data.joint("base").qpos[0] = base
        self.data.actuator("base").ctrl[0] = base
        self.command = u
        self.arm.reset(self.data, u.copy())
        mujoco.mj_kinematics(self.model, self.data)

    def _hang_from_rack(self) -> None:
        rack = self.data.body("rack")
        hanging = hanging_points(self.cloth) @ rack.xmat.reshape(3, 3).T
        self.place_cloth(rack.xpos + hanging)

    def _hang_from_hand(self) -> None:
        """Hang the cloth from the bar's middle, or a little aside."""
        middle = self.data.body("hand").xpos.copy()
        middle[1] += self.furniture.off_middle * self.np_random.uniform(-1, 1)
        self.place_cloth(middle + hanging_points(self.cloth))
        self.hold_fast(point_names(self.cloth)[0])

    def _send_base(self, goal: float) -> None:
        """Send the base evenly to a place [m] in the period to come."""
        low, high = self.furniture.base_range
        check_number("the place of the base", goal, at_least=low, at_most=high)
        start = self.base_goal
        farthest = self.furniture.base_speed * CONTROL_PERIOD
        if abs(goal - start) > farthest + 1e-9:
            raise ValueError(
                f"the base moves by {farthest:g} m in a control step at most, from "
                f"{start:.3f} to {goal:.3f} it is farther; `RobotDriver.drive` goes "
                "step by step"
            )
        path = np.linspace(start, goal, self.scene.substeps + 1)
        self._base_path = path[1:].tolist()

    def _simulate(self, steps: int) -> None:
        """As in other scenes, but the base follows its path and the hand may open."""
        if not self._base_path and self._release_in is None:
            super()._simulate(steps)
            return
        for _ in range(steps):
            if self._base_path:
                self.data.actuator("base").ctrl[0] = self._base_path.pop(0)
            if self._release_in is not None:
                self._release_in -= 1
                if self._release_in < 0:
                    self.release()
            super()._simulate(1)


def _measure_pose(cloth: Cloth, furniture: Furniture, points: ArrayLike) -> ClothPose:
    """How a cloth lies from its points in the world, `[rows, columns, 3]` [m]."""
    points = check_array("points", points, (cloth.rows, cloth.columns, 3))
    x, y, z = np.moveaxis(points, -1, 0)
    level = np.abs(z - furniture.height) <= _ON_TOP
    flat = np.mean(_over_table(furniture, x, y) & level)
    ahead = points[-1].mean(axis=0) - points[0].mean(axis=0)
    return ClothPose(
        flat=float(flat),
        area=_covered(points[..., :2]) / (cloth.length * cloth.width),
        angle=float(np.rad2deg(np.arctan2(ahead[1], ahead[0]))),
        centre=points.mean(axis=(0, 1)),
    )


def _over_table(furniture: Furniture, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which places ahead x and aside y [m] are over the table's top, or below it."""
    ahead = (furniture.near <= x) & (x <= furniture.far)
    return ahead & (np.abs(y) <= furniture.width / 2)


def _covered(places: np.ndarray) -> float:
    """Area under a grid of points, seen from above `[rows, columns, 2]` [m], in m².

    What lies double counts once.
    """
    # A picture in which a pixel is a millimetre
    pixels = np.round((places - places.min(axis=(0, 1))) / _PIXEL).astype(np.int32)
    width, height = pixels.max(axis=(0, 1)) + 1
    picture = np.zeros((height, width), np.uint8)

    # Two triangles fill each mesh of the grid
    for i, j in np.ndindex(places.shape[0] - 1, places.shape[1] - 1):
        near = pixels[i, j]
        far = pixels[i + 1, j + 1]
        cv2.fillConvexPoly(picture, np.array([near, pixels[i, j + 1], far]), 1)
        cv2.fillConvexPoly(picture, np.array([near, far, pixels[i + 1, j]]), 1)
    return float(picture.sum()) * _PIXEL**2
