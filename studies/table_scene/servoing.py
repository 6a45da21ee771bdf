"""Visual servoing: driving, moving the hand, and grasping what is seen.

The arm is soft and sags, and senses no joint angles, so that a command does not say
where the hand is. The approach looks at each control step where bar and goal are, and
moves the command by a part of what is missing (paper, "Integrated Table Setting
Experiment": "by visual feedback"). Other paths are followed by proprioception alone.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, choose
from clothlab.simulation.arm import SHOULDER_POSITION, Arm
from clothlab.simulation.env import CONTROL_PERIOD
from studies.table_scene.gripping import GraspError
from studies.table_scene.perception import (
    NotVisibleError,
    PointCloud,
    capture_point_cloud,
    find_bar,
    find_basket,
    find_cloth_edge,
)
from studies.table_scene.scene import Basket
from studies.table_scene.table_env import TableEnv

AHEAD = 0.50  # [m] from the shoulder to a goal, with room on all sides
AHEAD_LOW = 0.485  # [m] the same to a basket, which stands low
CLEAR = 0.08  # [m] from a goal to where the approach begins
_GAIN = 0.6  # part of the seen error that one step takes away
_CLOSE = 0.008  # [m] a seen error of less is there
_STEPS = 40  # control steps after which an approach has failed
_ACCELERATION = 0.5  # [m/s²] of the base
_TENSION = 70.0  # [N] of an arm that can be stiffened: it sags least
_HIDDEN = 0.05  # [m] nearer than that the hand hides its goal, and the last look counts
# [m] from look to look: the middle of a thing leaps so far when a part of it is hidden
_LEAP = 0.02


def posture(arm: Arm, place: ArrayLike) -> np.ndarray:
    """Joint angles θ `[2]` [rad] that bring the hand to a place, elbow down.

    The place is forward and up of the shoulder `[2]` [m]. Where no angles within the
    range of θ_ref reach it, those of a grid that bring the hand nearest.
    """
    # By the law of cosines, where the place is in reach
    forward, up = check_array("place", place, (2,))
    cosine = (forward**2 + up**2) / (2 * arm.link_length**2) - 1
    if abs(cosine) <= 1:
        elbow = -np.arccos(cosine)  # bent upwards, the only way it bends
        shoulder = np.arctan2(-up, forward) - elbow / 2
        theta = np.array([shoulder, elbow])
        within = np.clip(theta, arm.lower, arm.upper)
        if np.abs(theta - within).max() < 1e-9:
            return within

    # Else by trying 60 x 60 postures
    shoulders, elbows = np.linspace(arm.lower, arm.upper, 60).T
    pairs = np.meshgrid(shoulders, elbows, indexing="ij")
    grid = np.stack(pairs, axis=-1).reshape(-1, 2)
    slants = np.cumsum(grid, axis=1)  # of both links from level
    places = arm.link_length * np.column_stack(
        [np.cos(slants).sum(axis=1), -np.sin(slants).sum(axis=1)]
    )
    distances = np.linalg.norm(places - [forward, up], axis=1)
    return grid[distances.argmin()]


class RobotDriver:
    """Moves hand and base of a robot in front of a table, and remembers the command.

    Args:
        env: the scene.
        height: of the depth image [pixel].
        noise: standard deviation of a pixel's depth at 1 m [m].
        watch: called during every control period; what it raises ends the motion.
        samples: how often in each period `watch` is called.
        rng: draws the noise; by default with the seed 0.

    Attributes:
        u: the arm's last command `[D_u]`.
        steps: control steps so far.
    """

    def __init__(
        self,
        env: TableEnv,
        *,
        height: int = 480,
        noise: float = 0.0,
        watch: Callable[[], None] | None = None,
        samples: int = 5,
        rng: np.random.Generator | None = None,
    ):
        # How the robot looks, and who looks on
        self.env = env
        self.height = height
        self.noise = noise
        self.watch = watch
        self.samples = samples
        self.rng = rng or np.random.default_rng(0)
        self.steps = 0

        # The hand stays closed, and a soft arm is stiffened
        arm = env.arm
        stiffness = arm.stiffness_command
        self.u = env.command.copy()
        self.u[stiffness] = np.clip(
            _TENSION, arm.command_lower[stiffness], arm.command_upper[stiffness]
        )
        self.u[arm.closed_command] = 1.0

        # What the arm hangs below its command [rad], as far as it is known
        self._sag = np.zeros(2)
        self._speed = 0.0  # [m/s] of the base

    @property
    def _angles(self) -> np.ndarray:
        """Joint angles θ by what the robot senses of itself, `[2]` [rad]."""
        return self.env.arm.estimate_angles(self.env.arm.state(self.env.data))

    @property
    def proprioceptive_place(self) -> np.ndarray:
        """Where the hand is by what the robot senses of itself.

        Forward and up of the shoulder, `[2]` [m].
        """
        return self.env.arm.hand(self._angles)

    @property
    def proprioceptive_hand(self) -> np.ndarray:
        """The same in the world `[3]` [m]."""
        forward, up = self.proprioceptive_place
        return SHOULDER_POSITION + np.array([self.env.base + forward, 0.0, up])

    def capture(self) -> PointCloud:
        """Take a point cloud."""
        return capture_point_cloud(
            self.env, self.height, noise=self.noise, rng=self.rng
        )

    def send(self, u: ArrayLike) -> None:
        """Hold a command for one control period, as `TableEnv.advance` has it."""
        self.env.advance(u, self.watch, self.samples)
        self.steps += 1

    def step(self, base: float | None = None) -> None:
        """Hold the last command for one more control period.

        At its end the base is at `base` [m]; by default it stands.
        """
        self.send(self.u if base is None else np.append(self.u, base))

    def command_angles(self, theta: ArrayLike) -> None:
        """Send these angles from now on, kept in the arm's range."""
        self.u[self.env.arm.angle_command] = np.clip(
            theta, self.env.arm.lower, self.env.arm.upper
        )

    def correct(self, error: np.ndarray) -> None:
        """Move the commanded angles so that the hand moves by `error`.

        That is forward and up, `[2]` [m].
        """
        jacobian = self.env.arm.hand_jacobian(self._angles)
        # Damped: a stretched arm would otherwise be asked for wide turns to get a
        # little farther.
        damped = jacobian @ jacobian.T + 1e-3 * np.eye(2)
        turn = jacobian.T @ np.linalg.solve(damped, error)
        angles = self.u[self.env.arm.angle_command]
        self.command_angles(angles + np.clip(turn, -0.15, 0.15))

    def drive(self, goal: float) -> None:
        """Move the base to `goal` [m] and wait until it stands.

        The arm holds its command.
        """
        goal = float(np.clip(goal, *self.env.furniture.base_range))
        while abs(goal - self.env.base_goal) > 1e-4:
            self.step(self._next_base(goal))
        self._speed = 0.0
        for _ in range(3):
            self.step()

    def look_towards(self, x: float) -> None:
        """Drive until a place x [m] of the row is in view.

        The hand goes out of the picture.
        """
        furniture = self.env.furniture
        self.drive(x - furniture.look_ahead)
        self.move_straight(self.env.arm.hand(np.array(furniture.look_posture)))

    def _next_base(self, goal: float) -> float:
        """Where the base should be after the next control period, on its way to `goal`.

        In [m]; the base gathers speed evenly.
        """
        left = goal - self.env.base_goal
        change = _ACCELERATION * CONTROL_PERIOD

        # So fast that, after this period too, the base can still brake before its goal.
        braking = np.sqrt(change**2 + 2 * _ACCELERATION * abs(left)) - change
        wanted = np.sign(left) * min(self.env.furniture.base_speed, braking)

        # But no more of a change than the wheels can give, and not past the goal.
        speed = np.clip(wanted, self._speed - change, self._speed + change)
        farthest = abs(left) / CONTROL_PERIOD
        self._speed = float(np.clip(speed, -farthest, farthest))
        return self.env.base_goal + self._speed * CONTROL_PERIOD

    def move_hand(
        self, goals: np.ndarray, *, settle: int = 4, base: np.ndarray | None = None
    ) -> None:
        """Lead the hand along places, one a control step, without looking.

        They are forward and up of the shoulder, `[N, 2]` [m]. The hand settles for some
        steps at the last one. The base stands, or is led along places of its own `[N]`
        [m].
        """
        places = [*goals, *[goals[-1]] * settle]
        bases: list[float | None] = [None] * len(places)
        if base is not None:
            bases[: len(goals)] = base.tolist()

        # The arm hangs below its command; how far is learned on the way
        for place, stand in zip(places, bases, strict=True):
            theta = posture(self.env.arm, place)
            self.command_angles(theta + self._sag)
            self.step(stand)
            self._sag = np.clip(self._sag + 0.5 * (theta - self._angles), -0.6, 0.6)

    def move_straight(self, goal: ArrayLike, speed: float = 0.25) -> None:
        """Lead the hand straight to a place at `speed` [m/s], by proprioception.

        The goal is forward and up of the shoulder, `[2]` [m].
        """
        start = self.proprioceptive_place
        way = check_array("goal", goal, (2,)) - start
        steps = np.ceil(np.linalg.norm(way) / (speed * CONTROL_PERIOD))
        shares = np.linspace(0, 1, max(2, int(steps) + 1))[1:]
        self.move_hand(start + shares[:, None] * way)

    def from_shoulder(self, place: ArrayLike) -> np.ndarray:
        """Where a place in the world `[3]` is from the shoulder `[2]` [m].

        Forward and up; the shoulder moves with the base.
        """
        forward, _, up = check_array("place", place, (3,)) - SHOULDER_POSITION
        return np.array([forward - self.env.base, up])

    def servo(
        self,
        find_goal: Callable[[PointCloud, np.ndarray], np.ndarray],
        direction: np.ndarray,
    ) -> np.ndarray:
        """Bring the bar to a goal by visual feedback.

        It comes from a place that is clear of the goal in a direction `[3]`.
        `find_goal` says at each look where the goal is `[3]` [m], given the point cloud
        and where the bar is `[3]` [m]. Returned is the way from the bar to where it
        should be then, forward and up `[N, 2]` [m]; a `GraspError` where it does not
        arrive.
        """
        errors = []
        clear = CLEAR
        for _ in range(_STEPS):
            # Look: how far is the bar from where it should be now?
            cloud = self.capture()
            bar = find_bar(cloud, self.proprioceptive_hand)
            aim = find_goal(cloud, bar) + clear * direction
            error = (aim - bar)[[0, 2]]
            errors.append(error)
            missing = np.linalg.norm(error)
            if missing < _CLOSE and clear == 0:
                return np.array(errors)

            # Come nearer to the goal only as fast as the hand follows
            if missing < 2 * _CLOSE:
                clear = max(0.0, clear - 2 * _CLOSE)
            self.correct(_GAIN * error)
            self.step()
        raise GraspError(
            f"after {_STEPS} steps the hand is still {100 * missing:.1f} cm "
            "from its goal"
        )


@dataclass(frozen=True, eq=False)
class _Thing:
    """A thing that can be grasped."""

    # Where the hand should take hold `[3]` [m]
    find: Callable[[PointCloud], np.ndarray]
    direction: np.ndarray  # from there to where the approach begins
    ahead: float  # from the shoulder to it [m]


_THINGS = {
    "cloth": _Thing(
        lambda cloud: find_cloth_edge(cloud).mean(axis=0),
        np.array([-1.0, 0.0, 0.0]),
        AHEAD,
    ),
    "basket": _Thing(
        lambda cloud: find_basket(cloud)[0] + [0, 0, Basket.handle_height],
        np.array([0.0, 0.0, 1.0]),
        AHEAD_LOW,
    ),
}


def grasp(driver: RobotDriver, name: str) -> np.ndarray:
    """Look for a thing, go there by visual feedback and grasp it, in two attempts.

    The edge of the `"cloth"` on the rack is met from behind, the handle of the
    `"basket"` from above. Returned is the way from the bar to where it should be,
    forward and up, at each look `[N, 2]` [m]; a `GraspError` where both attempts fail.
    """
    thing = choose("thing to grasp", name, _THINGS)
    for _ in range(2):
        # Look, and look once more from farther away
        try:
            place = thing.find(driver.capture())
        except NotVisibleError:
            driver.drive(driver.env.base_goal - 0.15)
            place = thing.find(driver.capture())
        up = place[2] - SHOULDER_POSITION[2]
        beside = np.array([thing.ahead, up]) + CLEAR * thing.direction[::2]

        # Approach and take hold; where that fails, go back to where all is in view
        try:
            driver.move_straight(beside)
            driver.drive(place[0] - thing.ahead)
            errors = driver.servo(_tracker(thing, place), thing.direction)
            driver.env.grasp()
            return errors
        except (GraspError, NotVisibleError) as error:
            cause = str(error)
            driver.move_straight(beside)
            driver.look_towards(place[0])
    raise GraspError(f"the {name} was not grasped, in two attempts: {cause}")


def _tracker(
    thing: _Thing, place: np.ndarray
) -> Callable[[PointCloud, np.ndarray], np.ndarray]:
    """A function that says at each look where a thing is.

    What the hand hides, in part or whole, is where it was seen last.
    """
    last = place

    def track(cloud: PointCloud, bar: np.ndarray) -> np.ndarray:
        nonlocal last
        if np.linalg.norm((last - bar)[[0, 2]]) > _HIDDEN:
            with contextlib.suppress(NotVisibleError):
                now = thing.find(cloud)
                if np.linalg.norm(now - last) < _LEAP:
                    last = now
        return last

    return track


def lay_slowly(driver: RobotDriver, *, margin: float = 0.167) -> None:
    """Lay the cloth in the hand down without throwing it: the baseline of throws.

    The far edge is let down near the far end of the table; then the hand goes back and
    down on a quarter of an ellipse, which ends `margin` [m] before the table's far
    edge. There it lets go. The numbers are for hard-1 on this table: the best of 45
    draws in three development episodes.
    """
    seconds = 12.0
    stretch = 1 + 0.022  # length of the ellipse over that of the cloth
    rise = 1.038  # its height over that
    hold = 0.012  # [m] above the table: the bar's radius and a little
    env = driver.env
    furniture = env.furniture
    length = env.cloth.length

    # The hand's way on the ellipse, forward and up of the shoulder at base 0
    t = np.linspace(0, np.pi / 2, round(seconds / CONTROL_PERIOD))
    forward = furniture.far - margin - stretch * length * np.sin(t)
    lowest = furniture.height - SHOULDER_POSITION[2] + hold
    up = lowest + (rise * length - hold) * np.cos(t)

    # The base is where the arm, nearly stretched, reaches the place.
    whole = 2 * env.arm.link_length
    ahead = whole * np.sqrt(1 - (np.clip(up, -0.55, 0.55) / whole) ** 2) - 0.03
    base = np.clip(forward - ahead, *furniture.base_range)
    places = np.column_stack([forward - base, up])

    # Go to where it begins, follow it, let go, and take the hand away
    driver.move_straight(places[0])
    driver.drive(base[0])
    driver.move_hand(places, base=base, settle=10)
    env.release()
    driver.move_straight(np.add(driver.proprioceptive_place, [0.0, 0.25]))
