"""Reaching for what is seen, and moving the hand along a path: postures, driving, the approach in closed loop.

The arm is soft and sags, and does not sense its joint angles, so a command does not say where the hand is. The approach
looks at each control step where bar and goal are and moves the command by what is missing (paper, "Integrated Table
Setting Experiment": "by visual feedback"). Paths without looking are followed by what the muscles feel.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import Checked, check_array, choose, setting
from clothlab.simulation.arm import SHOULDER_POSITION, Arm
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.table_scene.depth import PointCloud, look
from clothlab.table_scene.perception import NotInView, SeenBasket, SeenCloth, find_bar, find_basket, find_cloth
from clothlab.table_scene.table_env import GraspError, TableEnv

Watch = Callable[[], None]
LEAP = 0.02  # [m] from look to look: the middle of a thing leaps so far when a part of it is hidden


class OutOfReachError(ValueError):
    """No posture within the arm's range brings the hand there."""


class MissedError(RuntimeError):
    """The hand did not get to where it should, or grasped nothing, twice."""


@dataclass(frozen=True)
class ReachSettings(Checked):
    """How the hand is brought to what is seen."""

    ahead: float = setting(0.50, "m", above=0)  # from the shoulder to the goal, with room on all sides
    ahead_low: float = setting(0.485, "m", above=0)  # to a basket: so low, the arm has less room
    clear: float = setting(0.08, "m", above=0)  # from the goal to where the approach begins
    gain: float = setting(0.6, above=0, at_most=1)  # part of the seen error that one step takes away
    close: float = setting(0.008, "m", above=0)  # a seen error of less is there
    hidden: float = setting(0.05, "m", at_least=0)  # nearer than that the hand hides its goal, and the last look counts
    steps: int = setting(40, at_least=1)  # control steps after which it has failed
    tension: float = setting(70.0, "N", above=0)  # of an arm that can be stiffened: it sags least
    acceleration: float = setting(0.5, "m/s²", above=0)  # of the base
    height: int = setting(480, at_least=96)  # [pixel] of the depth image
    noise: float = setting(0.0, "m", at_least=0)  # of the depth image at 1 m


@dataclass(frozen=True, eq=False)
class Approach:
    """What happened on the way.

    Attributes:
        seen: what was looked for, as it was seen last.
        errors: from the bar to where it should be, forward and up, at each step `[N, 2]` [m].
        held: what is in the hand.
        attempts: 1, or 2 if the first one missed.
    """

    seen: SeenCloth | SeenBasket
    errors: np.ndarray
    held: tuple[str, ...]
    attempts: int


def posture(arm: Arm, place: ArrayLike) -> np.ndarray:
    """Joint angles θ `[2]` [rad] that bring the hand to (forward, up) of the shoulder `[2]` [m], elbow down.

    Raises:
        OutOfReachError: no angles within the range of θ_ref do.
    """
    forward, up = check_array("place", place, (2,))
    length = arm.link_length
    cosine = (forward**2 + up**2) / (2 * length**2) - 1
    theta = np.full(2, np.nan)
    if abs(cosine) <= 1:
        elbow = -np.arccos(cosine)  # bent upwards, the only way it bends
        theta = np.array([np.arctan2(-up, forward) - elbow / 2, elbow])
    within = np.clip(theta, arm.lower, arm.upper)
    if not np.abs(theta - within).max() < 1e-9:  # where there is no elbow, it is NaN
        raise OutOfReachError(f"the hand cannot be {forward:.2f} m ahead and {up:.2f} m above the shoulder")
    return within


def nearest_posture(arm: Arm, place: ArrayLike) -> np.ndarray:
    """Joint angles θ `[2]` [rad] within range that bring the hand as near to (forward, up) as it gets `[2]` [m]."""
    try:
        return posture(arm, place)
    except OutOfReachError:
        shoulder, elbow = (np.linspace(low, high, 60) for low, high in zip(arm.lower, arm.upper, strict=True))
        all_angles = np.stack(np.meshgrid(shoulder, elbow, indexing="ij"), axis=-1).reshape(-1, 2)
        reach = np.cumsum(all_angles, axis=1)
        places = arm.link_length * np.column_stack([np.cos(reach).sum(axis=1), -np.sin(reach).sum(axis=1)])
        return all_angles[np.linalg.norm(places - np.asarray(place), axis=1).argmin()]


class Mover:
    """Moves hand and base of a robot in front of a table; remembers the command, watches and can be stopped.

    Args:
        env: the scene.
        settings: how.
        watch: called while the periods go by, as `TableEnv.advance` has it. What it raises ends the motion: so does a
            person who stops the robot.
        samples: how often a period.
        rng: draws the camera's noise, if there is any.

    Attributes:
        u: the last command of the arm `[D_u]`.
        steps: control steps so far.
    """

    def __init__(
        self,
        env: TableEnv,
        settings: ReachSettings | None = None,
        *,
        watch: Watch | None = None,
        samples: int = 5,
        rng: np.random.Generator | None = None,
    ):
        self.env, self.settings = env, settings or ReachSettings()
        self.watch, self.samples, self.rng = watch, samples, rng or np.random.default_rng(0)
        self.steps = 0
        self.u, stiffness = env.command.copy(), env.arm.stiffness_command
        low, high = env.arm.command_lower[stiffness], env.arm.command_upper[stiffness]
        self.u[stiffness] = np.clip(self.settings.tension, low, high)
        self.u[env.arm.closed_command] = 1.0  # what the hand grasps it holds, until it is told otherwise
        self._sag = np.zeros(2)  # [rad] what the arm hangs below its command, as far as it is known
        self._speed = 0.0  # [m/s] of the base

    @property
    def felt_angles(self) -> np.ndarray:
        """Joint angles θ that the robot feels `[2]` [rad]."""
        return self.env.arm.felt_angles(self.env.arm.state(self.env.data))

    @property
    def felt_hand(self) -> np.ndarray:
        """Where the robot feels its hand to be in the world `[3]` [m]."""
        forward, up = self.env.arm.hand(self.felt_angles)
        return SHOULDER_POSITION + np.array([self.env.base + forward, 0.0, up])

    def look(self) -> PointCloud:
        """Take a point cloud."""
        height = self.settings.height
        return look(self.env, height, height * 4 // 3, noise=self.settings.noise, rng=self.rng)

    def step(self, *, base: float | None = None, release_after: float | None = None) -> None:
        """Hold the command for one control period, with the base at `base` [m] at its end."""
        u = self.u if base is None else np.append(self.u, base)
        self.send(u, release_after=release_after)

    def send(self, u: ArrayLike, *, release_after: float | None = None) -> None:
        """One control period with a command `[D_u]`, as `TableEnv.advance` has it."""
        self.env.advance(u, self.watch, self.samples, release_after=release_after)
        self.steps += 1

    def command_angles(self, theta: ArrayLike) -> None:
        """Send these angles from now on, kept in the arm's range."""
        self.u[self.env.arm.angle_command] = np.clip(theta, self.env.arm.lower, self.env.arm.upper)

    def correct(self, error: np.ndarray) -> None:
        """Move the commanded angles so that the hand moves by `error`, forward and up `[2]` [m]."""
        jacobian = self.env.arm.hand_jacobian(self.felt_angles)
        # Damped: a stretched arm would otherwise be asked for wide turns to get a little farther.
        turn = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-3 * np.eye(2), error)
        self.command_angles(self.u[self.env.arm.angle_command] + np.clip(turn, -0.15, 0.15))

    def next_base(self, goal: float) -> float:
        """Where the base should be after the next control period, on its way to `goal` [m], gathering speed evenly."""
        most, change = self.env.furniture.base_speed, self.settings.acceleration * CONTROL_PERIOD
        left = goal - self.env.base_goal
        # So fast that, after this period too, there is way enough to brake.
        braking = np.sqrt(change**2 + 2 * self.settings.acceleration * abs(left)) - change
        wanted = np.sign(left) * min(most, braking)
        farthest = abs(left) / CONTROL_PERIOD
        speed = np.clip(wanted, self._speed - change, self._speed + change)
        self._speed = float(np.clip(speed, -farthest, farthest))
        return self.env.base_goal + self._speed * CONTROL_PERIOD

    def drive(self, goal: float) -> None:
        """Move the base to `goal` [m] and wait until it stands; the arm holds its command."""
        low, high = self.env.furniture.base_range
        goal = float(np.clip(goal, low, high))
        while abs(goal - self.env.base_goal) > 1e-4:
            self.step(base=self.next_base(goal))
        self._speed = 0.0
        for _ in range(3):
            self.step()

    def move_hand(self, goals: ArrayLike, *, settle: int = 4, base: ArrayLike | None = None) -> None:
        """Lead the hand along places, forward and up of the shoulder `[N, 2]` [m], one a control step, by feeling.

        What is beyond reach is approached as far as the arm goes.

        Args:
            goals: where the hand should be.
            settle: steps at the last one.
            base: where the base should be at each of them `[N]` [m]; it stands by default.
        """
        goals = check_array("goals", goals, ("N", 2))
        for k, goal in enumerate(np.vstack([goals, np.repeat(goals[-1:], settle, axis=0)])):
            theta = nearest_posture(self.env.arm, goal)
            self.command_angles(theta + self._sag)
            self.step(base=None if base is None or k >= len(goals) else float(np.asarray(base)[k]))
            self._sag = np.clip(self._sag + 0.5 * (theta - self.felt_angles), -0.6, 0.6)

    def from_shoulder(self, place: ArrayLike) -> np.ndarray:
        """Forward and up of the shoulder `[2]` [m], where a place in the world is `[3]` [m]."""
        forward, _, up = check_array("place", place, (3,)) - SHOULDER_POSITION
        return np.array([forward - self.env.base, up])

    def felt_place(self) -> np.ndarray:
        """Where the robot feels its hand, forward and up of the shoulder `[2]` [m]."""
        return self.env.arm.hand(self.felt_angles)

    def glide(self, goal: ArrayLike, speed: float = 0.25, settle: int = 4) -> None:
        """Lead the hand straight to (forward, up) of the shoulder `[2]` [m] at `speed` [m/s], by feeling."""
        start, goal = self.felt_place(), check_array("goal", goal, (2,))
        count = max(2, int(np.ceil(np.linalg.norm(goal - start) / (speed * CONTROL_PERIOD))) + 1)
        self.move_hand(start + np.linspace(0, 1, count)[1:, None] * (goal - start), settle=settle)


FINDERS: dict[str, Callable[[PointCloud], SeenCloth | SeenBasket]] = {"cloth": find_cloth, "basket": find_basket}


def take(mover: Mover, what: str) -> Approach:
    """Look for the cloth on the rack or the basket, go there by visual feedback, and grasp it; twice if need be.

    Args:
        mover: moves the robot, which looks towards where the thing may be.
        what: `"cloth"` or `"basket"`.

    Raises:
        KeyError: neither of them; the message lists the choices.
        NotInView: it is not to be seen, nor from a hand's breadth behind.
        MissedError: the hand did not get there, or grasped nothing, twice.
        OutOfReachError: no posture brings the hand there.
        SimulationError: the physics diverged.
    """
    choose("thing to take", what, FINDERS)
    why = ""
    for attempt in (1, 2):
        seen = _see(mover, what)
        try:
            last, errors = _approach(mover, what, seen)
            return Approach(last, np.array(errors), mover.env.grasp(), attempt)
        except (MissedError, GraspError, NotInView) as error:
            why = str(error)
            _withdraw(mover, what, seen)
    raise MissedError(f"the {what} was not grasped, in two attempts: {why}")


def _see(mover: Mover, what: str) -> SeenCloth | SeenBasket:
    try:
        return FINDERS[what](mover.look())
    except NotInView:
        mover.drive(mover.env.base_goal - 0.15)
        return FINDERS[what](mover.look())


def _way(what: str) -> np.ndarray:
    """From the thing to where the approach to it begins: the cloth is met from behind, the handle from above."""
    return np.array([-1.0, 0.0, 0.0] if what == "cloth" else [0.0, 0.0, 1.0])


def _place_beside(mover: Mover, what: str, seen: SeenCloth | SeenBasket) -> np.ndarray:
    """Where the approach begins, forward and up of the shoulder as it will stand then `[2]` [m]."""
    settings = mover.settings
    ahead = settings.ahead if what == "cloth" else settings.ahead_low
    above = seen.place[2] - SHOULDER_POSITION[2]
    return np.array([ahead, above]) + settings.clear * _way(what)[[0, 2]]


def _approach(mover: Mover, what: str, seen: SeenCloth | SeenBasket) -> tuple[SeenCloth | SeenBasket, list[np.ndarray]]:
    """Arm up, base there, then the last hand's breadth in closed loop."""
    settings, errors = mover.settings, []
    mover.glide(_place_beside(mover, what, seen))
    mover.drive(seen.place[0] - (settings.ahead if what == "cloth" else settings.ahead_low))
    clear = settings.clear
    for _ in range(settings.steps):
        cloud = mover.look()
        bar = find_bar(cloud, mover.felt_hand)
        if np.linalg.norm((seen.place - bar)[[0, 2]]) > settings.hidden:
            seen = _look_again(what, cloud, seen)
        errors.append((seen.place + clear * _way(what) - bar)[[0, 2]])
        missing = np.linalg.norm(errors[-1])
        if missing < settings.close and clear == 0:
            return seen, errors
        if missing < 2 * settings.close:
            clear = max(0.0, clear - 2 * settings.close)
        mover.correct(settings.gain * errors[-1])
        mover.step()
    raise MissedError(f"after {settings.steps} steps the hand is still {100 * missing:.1f} cm from its goal")


def _withdraw(mover: Mover, what: str, seen: SeenCloth | SeenBasket) -> None:
    """Back to where the thing can be seen as a whole, with the hand out of the picture."""
    furniture = mover.env.furniture
    mover.glide(_place_beside(mover, what, seen))
    mover.drive(seen.place[0] - furniture.look_ahead)
    mover.glide(mover.env.arm.hand(np.array(furniture.look_posture)))


def _look_again(what: str, cloud: PointCloud, seen: SeenCloth | SeenBasket) -> SeenCloth | SeenBasket:
    """What is seen now; what the hand hides, in part or whole, is where it was seen last."""
    try:
        now = FINDERS[what](cloud)
    except NotInView:
        return seen
    return now if np.linalg.norm(now.place - seen.place) < LEAP else seen


def lay_slowly(
    mover: Mover, *, seconds: float = 12.0, margin: float = 0.167, stretch: float = 0.022, rise: float = 1.038
) -> None:
    """Lay the cloth in the hand down without throwing it, and let go: the obvious rival of dynamic spreading.

    The far edge is let down onto the table near its far end, then the hand goes back and down on a quarter of an
    ellipse, so that the cloth comes to lie from the far edge to the near one. The base goes back as the hand does,
    if that helps. Where arm and base do not reach, the hand goes as far as they do, and what is missing a cloth that
    is stiff enough is pushed.

    The defaults are for hard-1, fetched from the rack, on the furniture's table: of 45 draws of (seconds, margin,
    stretch, rise, and a push at the end) in development episodes, two laid it in three of three, these without a push.
    What counts is that the cloth stays taut, or it sags over the table's near edge; so far away that is a matter of a
    centimetre. With 1 cm more margin or less it sags; seconds, stretch and rise matter less.

    Args:
        mover: with the cloth in its hand, base in front of the table.
        seconds: how long the laying down takes [s].
        margin: from where the cloth's far edge would lie, were it as long as the ellipse, to the table's [m].
        stretch: by which part of the cloth's length the ellipse is longer.
        rise: how high the ellipse begins, over the cloth's length.
    """
    env, cloth, furniture = mover.env, mover.env.cloth, mover.env.furniture
    t = np.linspace(0, np.pi / 2, max(2, round(seconds / CONTROL_PERIOD)))
    hold = 0.012  # [m] above the table: the bar's radius and a little
    places = np.column_stack(
        [
            furniture.far - margin - (1 + stretch) * cloth.length * np.sin(t),
            furniture.height - SHOULDER_POSITION[2] + hold + (rise * cloth.length - hold) * np.cos(t),
        ]
    )
    base = _follow(env, places)
    mover.glide(places[0] - [base[0], 0])
    mover.drive(base[0])
    mover.move_hand(places - np.column_stack([base, np.zeros(len(base))]), base=base, settle=10)
    env.release()
    mover.glide(np.add(mover.felt_place(), [0.0, 0.25]))


def _follow(env: TableEnv, places: np.ndarray) -> np.ndarray:
    """Where the base is to be while the hand is at each of some places, forward and up `[N, 2]` [m], `[N]` [m]."""
    low, high = env.furniture.base_range
    above = np.clip(places[:, 1], -0.55, 0.55) / (2 * env.arm.link_length)
    ahead = 2 * env.arm.link_length * np.sqrt(1 - above**2) - 0.03  # nearly stretched: as far as it can
    return np.clip(places[:, 0] - ahead, low, high)
