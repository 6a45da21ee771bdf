"""The scene of the table as an environment: an arm on a base, contacts, a hand that grasps; and how well it went.

Nothing here knows what a robot could see: `depth`, `recognition` and `reaching` do.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number, choose
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, point_names
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, Scene
from clothlab.table_scene.scene import Furniture, build_spec, hanging_points, place_basket, place_rack

STARTS = ("rack", "hand")  # where the cloth hangs at the start
FLAT = 0.015  # [m] above the table's top, what lies on it
PIXEL = 0.001  # [m] with which areas are measured


class GraspError(RuntimeError):
    """The hand closed on nothing."""


class TableEnv(ClothEnv):
    """A robot in front of a table to set: rack with cloth, basket on a side table, base, contacts, grasping.

    As `ClothEnv`, with these differences:

    * a command may have one number more, the place where the base should be at the end of the control period [m];
      without it the base stays. What knows nothing of a base can so command the arm all the same.
    * the cloth hangs from the rack, or from the hand, at the start; `grasp` and `release` take and let go. So does a
      command of an arm whose hand opens on command, such as `muscle-hand`.
    * `reset` and `start` draw the places of rack and basket, and how a cloth is held that begins in the hand, within
      the ranges of the furniture.

    Args:
        arm: an arm or its name; its home becomes the furniture's start posture.
        cloth: a cloth or its name.
        furniture: what stands where.
        start_in: `"rack"`, far from the table, or `"hand"`, above the table with the base at 0, to practise spreading.
        scene: time step and start.
        options: as `ClothEnv` has them.

    Raises:
        KeyError: unknown arm, cloth or start.
        SimulationError: this cloth cannot be simulated with this time step.

    Attributes:
        furniture: what stands where.
        command: the arm's last command `[D_u]`.
    """

    command: np.ndarray

    def __init__(
        self,
        arm: Arm | str = "muscle",
        cloth: Cloth | str = "hard-1",
        *,
        furniture: Furniture | None = None,
        start_in: str = "rack",
        scene: Scene | None = None,
        **options: Any,
    ):
        self.furniture = furniture or Furniture()
        self.start_in = choose("start", start_in, {name: name for name in STARTS})
        self._release_in: int | None = None
        self._base_path: np.ndarray = np.empty(0)
        arm = replace(get_arm(arm), home=self.furniture.start_posture)
        super().__init__(arm, cloth, scene=scene, **options)

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
        """Names of what is in the hand: points of the cloth's first or last row, or `"basket"`."""
        active = self.data.eq_active
        return tuple(name for name in self._graspable() if active[self.model.equality(f"grip_{name}").id])

    @property
    def hand(self) -> np.ndarray:
        """Where the middle of the bar is `[3]` [m]. A robot does not know; it sees it, or feels its angles."""
        return self.data.site("hand").xpos.copy()

    def advance(
        self,
        u: ArrayLike,
        watch: Callable[[], None] | None = None,
        samples: int = 1,
        *,
        release_after: float | None = None,
    ) -> None:
        """Hold the command for one control period, as `ClothEnv.advance` does.

        Args:
            u: the arm's command `[D_u]`, or that and the place of the base at the end `[D_u + 1]` [m], to which it
                is led evenly.
            watch: called while the period goes by.
            samples: how often.
            release_after: let go within the period, so long after its beginning [s], whatever the command says.

        Raises:
            ValueError: a command of another shape, not finite or out of range; a base too fast or out of its range.
            SimulationError: the physics diverged.
        """
        size = len(self.arm.command_names)
        u = np.array(u, dtype=np.float64)
        if release_after is not None:
            check_number("release_after", release_after, at_least=0, at_most=CONTROL_PERIOD)
        if u.shape == (size + 1,):
            self._send_base(u[size])
            u = u[:size]
        if release_after is None and u.shape == (size,):
            release_after = self._opening(u)
        if release_after is not None:
            self._release_in = round(release_after / self.scene.time_step)
        try:
            super().advance(u, watch, samples)
            self.command = u
        finally:
            self._release_in, self._base_path = None, np.empty(0)
        if release_after is not None:
            self.release()

    def _opening(self, u: np.ndarray) -> float | None:
        """How long after the beginning of the period the command opens the hand [s]; None where it stays as it is."""
        closed = u[self.arm.closed_command]
        opens = closed.size and 0 <= closed[0] < 1 and self.held
        return float(closed[0]) * CONTROL_PERIOD if opens else None

    def grasp(self) -> tuple[str, ...]:
        """Close the hand on what is nearest to the bar: an edge of the cloth, or the handle of the basket.

        What is taken is drawn to the bar, where it is along it; clips of the rack let go of it.

        Returns:
            What is now in the hand: names of points of the cloth, or `("basket",)`.

        Raises:
            GraspError: something is in the hand already, or nothing is within reach; the message says how far it is.
        """
        if self.held:
            raise GraspError(f"the hand is not empty, it holds {', '.join(self.held)}: release it first")
        places = self._graspable()
        distances = {name: self._from_bar(place)[1] for name, place in places.items()}
        nearest = min(distances, key=lambda name: distances[name])
        if distances[nearest] > self.furniture.reach:
            raise GraspError(
                f"nothing within {100 * self.furniture.reach:g} cm of the hand; nearest is {nearest}, "
                f"{100 * distances[nearest]:.1f} cm away"
            )
        row = nearest.rsplit("_", 1)[0]  # all of the same edge: that and no other thing is taken
        self.hold_fast(name for name in places if name.startswith(row) and distances[name] <= self.furniture.reach)
        return self.held

    def hold_fast(self, names: Iterable[str]) -> None:
        """Tie things to the bar, where they are along it, however far away; what else was in the hand falls out.

        Args:
            names: points of the cloth's first or last row, or `basket`.
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
        """Put the points of the cloth somewhere, at rest.

        Args:
            points: `[rows, columns, 3]` [m] in the world.
        """
        points = check_array("points", points, (self.cloth.rows, self.cloth.columns, 3))
        for i, row in enumerate(point_names(self.cloth)):
            for j, name in enumerate(row):
                for axis, value in zip("xyz", points[i, j] - self.model.body(name).pos, strict=True):
                    self.data.joint(f"{name}_{axis}").qpos[0] = value
                    self.data.joint(f"{name}_{axis}").qvel[0] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def lies(self) -> "Spread":
        """How the cloth lies."""
        return spread(self.cloth, self.furniture, self.cloth_points())

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode, as `ClothEnv.start` does; what begins in the hand waits longer: a soft arm sags."""
        super().start(seed=seed, random_start=random_start)
        if self.start_in == "hand":
            self._simulate(round(self.np_random.uniform(*self.furniture.wait) / self.scene.time_step))
            self.data.time = 0.0
            mujoco.mj_forward(self.model, self.data)

    def _spec(self) -> mujoco.MjSpec:
        return build_spec(self.arm, self.cloth, self.scene, self.furniture)

    def _tie(self, name: str, active: bool) -> None:
        self.data.eq_active[self.model.equality(name).id] = active

    def _place(self, u: np.ndarray) -> None:
        """Draw where rack and basket are; put the arm where `u` wants it, and the cloth below rack or hand."""
        furniture, data = self.furniture, self.data
        place_rack(data, furniture, self.np_random)
        place_basket(data, furniture, self.np_random)
        in_hand, u = self.start_in == "hand", u.copy()
        base = 0.0 if in_hand else max(furniture.base_range[0], furniture.rack_place - furniture.look_ahead)
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
        return {name: self.data.body(name).xpos for name in (*first, *last)} | {"basket": self.data.site("basket").xpos}

    def _from_bar(self, place: np.ndarray) -> tuple[float, float]:
        """Where the nearest point of the bar is along it, and how far `place` is from there [m]."""
        hand = self.data.body("hand")
        local = hand.xmat.reshape(3, 3).T @ (place - hand.xpos)
        along = float(np.clip(local[1], -self.arm.bar_length / 2, self.arm.bar_length / 2))
        return along, float(np.linalg.norm(local - [0.0, along, 0.0]))

    def _send_base(self, goal: float) -> None:
        low, high = self.furniture.base_range
        check_number("the place of the base", goal, at_least=low, at_most=high)
        farthest = self.furniture.base_speed * CONTROL_PERIOD
        if abs(goal - self.base_goal) > farthest + 1e-9:
            raise ValueError(
                f"the base moves by {farthest:g} m in a control step at most, from {self.base_goal:.3f} to {goal:.3f} "
                "it is farther; `reaching.drive` goes step by step"
            )
        self._base_path = np.linspace(self.base_goal, goal, self.scene.substeps + 1)[1:]

    def _simulate(self, steps: int) -> None:
        """As in other scenes, but that the base is led and the hand may open on the way."""
        if not len(self._base_path) and self._release_in is None:
            super()._simulate(steps)
            return
        for _ in range(steps):
            if len(self._base_path):
                self.data.actuator("base").ctrl[0], self._base_path = self._base_path[0], self._base_path[1:]
            if self._release_in is not None:
                self._release_in -= 1
                if self._release_in < 0:
                    self.release()
            super()._simulate(1)


def room_picture(env: TableEnv, height: int = 270, width: int = 480) -> np.ndarray:
    """The whole scene as a visitor sees it, who stands to the robot's right `[height, width, 3]` uint8.

    Raises:
        RuntimeError: no OpenGL on this machine; the message says what to install.
        ValueError: a picture larger than `scene.picture_size`.
    """
    visitor = mujoco.MjvCamera()
    visitor.azimuth, visitor.elevation, visitor.distance = 122, -20, 2.9
    visitor.lookat[:] = (env.furniture.rack_place + env.furniture.near + env.furniture.depth / 2) / 2, 0, 0.72
    return env.camera_picture(height, width, view=visitor)


@dataclass(frozen=True)
class Spread:
    """How well a cloth lies on the table.

    Attributes:
        flat: part of the cloth's points that lie on the table, within `FLAT` of its top.
        area: what the cloth covers, seen from above, as a part of the flat cloth's area.
        angle: from where its length should point, straight ahead, to where it does, counterclockwise [degree].
        centre: the mean of its points in the world `[3]` [m].
    """

    flat: float
    area: float
    angle: float
    centre: np.ndarray

    @property
    def success(self) -> bool:
        """Whether that is a cloth spread out: flat and area 85 %, angle within 15°."""
        return self.flat >= 0.85 and self.area >= 0.85 and abs(self.angle) <= 15.0


def spread(cloth: Cloth, furniture: Furniture, points: ArrayLike) -> Spread:
    """Measure how a cloth lies, from its points `[rows, columns, 3]` [m] in the world."""
    points = check_array("points", points, (cloth.rows, cloth.columns, 3))
    x, y, z = np.moveaxis(points, -1, 0)
    above = (furniture.near <= x) & (x <= furniture.far) & (np.abs(y) <= furniture.width / 2)
    flat = float(np.mean(above & (np.abs(z - furniture.height) <= FLAT)))
    ahead = points[-1].mean(axis=0) - points[0].mean(axis=0)
    angle = float(np.rad2deg(np.arctan2(ahead[1], ahead[0])))
    return Spread(flat, _covered(points[..., :2]) / (cloth.length * cloth.width), angle, points.mean(axis=(0, 1)))


def _covered(places: np.ndarray) -> float:
    """Area under a grid of points, seen from above `[rows, columns, 2]` [m], in m²; what lies double counts once."""
    pixels = np.round((places - places.min(axis=(0, 1))) / PIXEL).astype(np.int32)
    width, height = pixels.max(axis=(0, 1)) + 1
    picture = np.zeros((height, width), np.uint8)
    for i, j in np.ndindex(places.shape[0] - 1, places.shape[1] - 1):
        a, b, c, d = pixels[i, j], pixels[i, j + 1], pixels[i + 1, j + 1], pixels[i + 1, j]
        for triangle in ((a, b, c), (a, c, d)):
            cv2.fillConvexPoly(picture, np.array(triangle), 1)
    return float(picture.sum()) * PIXEL**2


@dataclass(frozen=True)
class Placement:
    """How the basket stands.

    Attributes:
        tilt: from upright [degree].
        off_centre: from its middle to the cloth's, level [m].
        on_table: whether it stands on the table at all.
    """

    tilt: float
    off_centre: float
    on_table: bool

    @property
    def success(self) -> bool:
        """Whether that is a basket placed: on the table, tilted by 5° at most, 4 cm off the cloth's centre at most."""
        return self.on_table and self.tilt <= 5.0 and self.off_centre <= 0.04


def placement(env: TableEnv) -> Placement:
    """Measure how the basket stands, now."""
    basket, furniture = env.data.body("basket"), env.furniture
    off = basket.xpos[:2] - env.cloth_points().mean(axis=(0, 1))[:2]
    above = furniture.near <= basket.xpos[0] <= furniture.far and abs(basket.xpos[1]) <= furniture.width / 2
    on_table = above and abs(basket.xpos[2] - furniture.height) <= FLAT and "basket" not in env.held
    tilt = np.rad2deg(np.arccos(np.clip(basket.xmat.reshape(3, 3)[2, 2], -1, 1)))
    return Placement(float(tilt), float(np.linalg.norm(off)), bool(on_table))
