"""The table scene as an environment: a base that drives, contacts, a hand that grasps;
and how the cloth really lies.

What the robot itself can see is in `perception`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number, choose
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, hanging_points, point_names
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, Scene
from studies.table_scene.scene import Furniture, build_spec, place_furniture

_STARTS = ("rack", "hand")  # where the cloth hangs at the start
_ON_TOP = 0.015  # [m] a point so near the table's top, in height, lies on it
_PIXEL = 0.001  # [m] with which areas are measured


class GraspError(RuntimeError):
    """The hand closed on nothing, or did not get to where it should."""


@dataclass(frozen=True, eq=False)
class ClothPose:
    """How a cloth lies: measured by its points, or as a camera sees it, without what
    the arm hides.
    """

    # Share of its points, or of its seen surface, that lies on the table's top
    flat: float
    area: float  # what it covers seen from above, over the flat cloth's area
    # Of its length from straight ahead, counterclockwise [degree]; a camera sees a
    # rectangle: -45 to 45
    angle: float
    # Mean of its points, or middle of the rectangle that is seen `[3]` [m]
    centre: np.ndarray
    back_up: bool = (
        True  # whether a camera sees its back, as when its far edge went forward
    )

    @property
    def fault(self) -> str:
        """Why the cloth is not spread: 85 % of it flat on the table, 85 % of its area,
        15°; empty if it is.
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
        """Whether the basket is placed: on the table, tilted by 5° at most, 4 cm off
        the cloth's centre at most.
        """
        return self.on_table and self.tilt <= 5.0 and self.off_centre <= 0.04


class TableEnv(ClothEnv):
    """A robot in front of a table to set: rack with cloth, basket on a side table,
    base, contacts, grasping.

    As `ClothEnv`, with these differences:

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
    """

    command: np.ndarray  # the arm's last one `[D_u]`

    def __init__(
        self,
        arm: Arm | str = "muscle",
        cloth: Cloth | str = "hard-1",
        *,
        furniture: Furniture | None = None,
        start_in: str = "rack",
        scene: Scene | None = None,
        render_mode: str | None = None,
    ):
        self.furniture = furniture or Furniture()
        self.start_in = choose("start", start_in, {name: name for name in _STARTS})
        self._release_in: int | None = None  # time steps until the hand opens
        self._base_path: np.ndarray = np.empty(0)
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
        """Names of what is in the hand: points of the cloth's first or last row, or
        `"basket"`.
        """
        active = self.data.eq_active
        return tuple(
            name
            for name in self._graspable()
            if active[self.model.equality(f"grip_{name}").id]
        )

    @property
    def hand(self) -> np.ndarray:
        """Where the middle of the bar is `[3]` [m]; the robot only sees it, or computes
        it from what it senses.
        """
        return self.data.site("hand").xpos.copy()

    def advance(
        self, u: ArrayLike, watch: Callable[[], None] | None = None, samples: int = 1
    ) -> None:
        """Hold the command `[D_u]`, or that and a place of the base `[D_u + 1]`, as
        `ClothEnv.advance` does.
        """
        size = len(self.arm.command_names)
        u = np.array(u, dtype=np.float64)
        if u.shape == (size + 1,):
            self._send_base(u[size])
            u = u[:size]
        closed = u[self.arm.closed_command] if u.shape == (size,) else np.empty(0)
        opens = closed.size and 0 <= closed[0] < 1 and self.held
        if opens:
            self._release_in = round(
                float(closed[0]) * CONTROL_PERIOD / self.scene.time_step
            )
        try:
            super().advance(u, watch, samples)
            self.command = u
        finally:
            self._release_in, self._base_path = None, np.empty(0)
        if opens:
            self.release()

    def grasp(self) -> tuple[str, ...]:
        """Close the hand on the nearest edge of the cloth, or the basket's handle; what
        is now in the hand.
        """
        if self.held:
            raise GraspError(
                f"the hand is not empty, it holds {', '.join(self.held)}: release it first"
            )
        places = self._graspable()
        distances = {name: self._from_bar(place)[1] for name, place in places.items()}
        nearest = min(distances, key=lambda name: distances[name])
        if distances[nearest] > self.furniture.reach:
            raise GraspError(
                f"nothing within {100 * self.furniture.reach:g} cm of the hand; nearest is {nearest}, "
                f"{100 * distances[nearest]:.1f} cm away"
            )
        row = nearest.rsplit("_", 1)[0]  # points of the same edge, and no other thing
        self.hold_fast(
            name
            for name in places
            if name.startswith(row) and distances[name] <= self.furniture.reach
        )
        return self.held

    def hold_fast(self, names: Iterable[str]) -> None:
        """Tie points of the cloth's first or last row, or `basket`, to the bar; rack
        and hand let go of all else.
        """
        self.release()
        places = self._graspable()
        for name in names:
            along = self._from_bar(choose("thing to grasp", name, places))[0]
            self.model.site(f"grip_{name}").pos[:] = [0.0, along, 0.0]
            self._tie(f"grip_{name}", True)
            if name in point_names(self.cloth)[0]:
                self._tie(f"clip_{name}", False)

    def release(self) -> None:
        """Let go of all that is in the hand, at once."""
        for name in self.held:
            self._tie(f"grip_{name}", False)

    def place_cloth(self, points: ArrayLike) -> None:
        """Put the points of the cloth `[rows, columns, 3]` [m] somewhere in the world,
        at rest.
        """
        points = check_array("points", points, (self.cloth.rows, self.cloth.columns, 3))
        for name, place in zip(
            np.ravel(point_names(self.cloth)), points.reshape(-1, 3), strict=True
        ):
            for axis, value in zip(
                "xyz", place - self.model.body(name).pos, strict=True
            ):
                joint = self.data.joint(f"{name}_{axis}")
                joint.qpos[0], joint.qvel[0] = value, 0.0
        mujoco.mj_forward(self.model, self.data)

    def cloth_pose(self) -> ClothPose:
        """How the cloth lies on the table."""
        return _measure_pose(self.cloth, self.furniture, self.cloth_points())

    def placement(self) -> Placement:
        """How the basket stands now."""
        basket, furniture = self.data.body("basket"), self.furniture
        off = basket.xpos[:2] - self.cloth_points().mean(axis=(0, 1))[:2]
        above = (
            furniture.near <= basket.xpos[0] <= furniture.far
            and abs(basket.xpos[1]) <= furniture.width / 2
        )
        on_table = (
            above
            and abs(basket.xpos[2] - furniture.height) <= _ON_TOP
            and "basket" not in self.held
        )
        tilt = np.rad2deg(np.arccos(np.clip(basket.xmat.reshape(3, 3)[2, 2], -1, 1)))
        return Placement(float(tilt), float(np.linalg.norm(off)), bool(on_table))

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode, as `ClothEnv.start` does; a cloth in the hand waits longer,
        because a soft arm sags.
        """
        super().start(seed=seed, random_start=random_start)
        if self.start_in == "hand":
            self._simulate(
                round(
                    self.np_random.uniform(*self.furniture.wait) / self.scene.time_step
                )
            )
            self.data.time = 0.0
            mujoco.mj_forward(self.model, self.data)

    def _spec(self) -> mujoco.MjSpec:
        return build_spec(self.arm, self.cloth, self.scene, self.furniture)

    def _tie(self, name: str, active: bool) -> None:
        self.data.eq_active[self.model.equality(name).id] = active

    def _place(self, u: np.ndarray) -> None:
        """Draw where rack and basket are; put the arm where `u` wants it, and the cloth
        below rack or hand.
        """
        furniture, data = self.furniture, self.data
        place_furniture(data, furniture, self.np_random)
        in_hand, u = self.start_in == "hand", u.copy()
        base = 0.0 if in_hand else self.model.body("rack").pos[0] - furniture.look_ahead
        data.joint("base").qpos[0] = data.actuator("base").ctrl[0] = base
        if not in_hand:
            u[self.arm.angle_command] = furniture.look_posture
        self.command = u.copy()
        self.arm.reset(data, u)
        mujoco.mj_kinematics(self.model, data)
        frame = np.eye(3) if in_hand else data.body("rack").xmat.reshape(3, 3)
        middle = data.body("hand" if in_hand else "rack").xpos.copy()
        if in_hand:
            middle[1] += furniture.off_middle * self.np_random.uniform(-1, 1)
        self.place_cloth(middle + hanging_points(self.cloth) @ frame.T)
        if in_hand:
            self.hold_fast(point_names(self.cloth)[0])

    def _graspable(self) -> dict[str, np.ndarray]:
        """Where the hand could take hold, `[3]` [m] each."""
        first, *_, last = point_names(self.cloth)
        return {name: self.data.body(name).xpos for name in (*first, *last)} | {
            "basket": self.data.site("basket").xpos
        }

    def _from_bar(self, place: np.ndarray) -> tuple[float, float]:
        """Where the nearest point of the bar is along it, and how far `place` is from
        there [m].
        """
        hand = self.data.body("hand")
        local = hand.xmat.reshape(3, 3).T @ (place - hand.xpos)
        along = float(
            np.clip(local[1], -self.arm.bar_length / 2, self.arm.bar_length / 2)
        )
        return along, float(np.linalg.norm(local - [0.0, along, 0.0]))

    def _send_base(self, goal: float) -> None:
        low, high = self.furniture.base_range
        check_number("the place of the base", goal, at_least=low, at_most=high)
        farthest = self.furniture.base_speed * CONTROL_PERIOD
        if abs(goal - self.base_goal) > farthest + 1e-9:
            raise ValueError(
                f"the base moves by {farthest:g} m in a control step at most, from {self.base_goal:.3f} to {goal:.3f} "
                "it is farther; `RobotDriver.drive` goes step by step"
            )
        self._base_path = np.linspace(self.base_goal, goal, self.scene.substeps + 1)[1:]

    def _simulate(self, steps: int) -> None:
        """As in other scenes, but the base follows its path and the hand may open."""
        if not len(self._base_path) and self._release_in is None:
            super()._simulate(steps)
            return
        for _ in range(steps):
            if len(self._base_path):
                self.data.actuator("base").ctrl[0], self._base_path = (
                    self._base_path[0],
                    self._base_path[1:],
                )
            if self._release_in is not None:
                self._release_in -= 1
                if self._release_in < 0:
                    self.release()
            super()._simulate(1)


def _measure_pose(cloth: Cloth, furniture: Furniture, points: ArrayLike) -> ClothPose:
    """Measure how a cloth lies from its points `[rows, columns, 3]` [m] in the world."""
    points = check_array("points", points, (cloth.rows, cloth.columns, 3))
    x, y, z = np.moveaxis(points, -1, 0)
    above = (
        (furniture.near <= x)
        & (x <= furniture.far)
        & (np.abs(y) <= furniture.width / 2)
    )
    flat = float(np.mean(above & (np.abs(z - furniture.height) <= _ON_TOP)))
    ahead = points[-1].mean(axis=0) - points[0].mean(axis=0)
    angle = float(np.rad2deg(np.arctan2(ahead[1], ahead[0])))
    return ClothPose(
        flat,
        _covered(points[..., :2]) / (cloth.length * cloth.width),
        angle,
        points.mean(axis=(0, 1)),
    )


def _covered(places: np.ndarray) -> float:
    """Area under a grid of points, seen from above `[rows, columns, 2]` [m], in m²;
    what lies double counts once.
    """
    pixels = np.round((places - places.min(axis=(0, 1))) / _PIXEL).astype(np.int32)
    width, height = pixels.max(axis=(0, 1)) + 1
    picture = np.zeros((height, width), np.uint8)
    for i, j in np.ndindex(places.shape[0] - 1, places.shape[1] - 1):
        a, b, c, d = (
            pixels[i, j],
            pixels[i, j + 1],
            pixels[i + 1, j + 1],
            pixels[i + 1, j],
        )
        for triangle in ((a, b, c), (a, c, d)):
            cv2.fillConvexPoly(picture, np.array(triangle), 1)
    return float(picture.sum()) * _PIXEL**2
