"""Throws: policies to learn them from, and the one that plans them to spread a cloth.

A throw is a plan of which only the end counts: its last step is the only one in the
loss. When the hand opens is one number of the plan. A command says it as the share of
each control period for which the hand is closed, 1, …, 1, 0.4, 0, …, 0, so that the
model learns what letting go does as it learns everything else.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, check_mask, choose
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import observe
from clothlab.method.data import Run
from clothlab.method.iterative import (
    IterativeLearningSettings,
    ResidualModel,
    plan_features,
)
from clothlab.method.model import DPMPB, Memory, predict
from clothlab.method.rollout import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import hanging_points
from clothlab.simulation.vision import Observation
from clothlab.trials import Trial
from studies.table_scene.perception import (
    NotVisibleError,
    capture_point_cloud,
    find_cloth_pose,
)
from studies.table_scene.table_env import ClothPose, TableEnv

SPREAD = "spread"  # the outcome of a trial after which the cloth lay so


def label_spread(trial: Trial, spread: bool) -> Trial:
    """The trial with a note whether the cloth was seen to lie spread after it."""
    return replace(trial, outcome=SPREAD if spread else "")


def was_spread(trial: Trial) -> bool:
    """Whether the cloth was seen to lie spread after a recorded trial."""
    return trial.outcome == SPREAD


def laid_by_hand(env: TableEnv, ahead: float) -> np.ndarray:
    """Lay the cloth flat on the table, its middle `ahead` of the shoulder [m].

    Returned is its mask `[H, W]`, which is a target.
    """
    env.start()
    env.release()

    # A cloth that hangs straight down is turned into the plane of the table
    hanging = hanging_points(env.cloth)
    lying = np.empty_like(hanging)
    lying[..., 0] = ahead - env.cloth.length / 2 - hanging[..., 2]
    lying[..., 1] = hanging[..., 1]
    lying[..., 2] = env.furniture.height + env.furniture.point_radius
    env.place_cloth(lying)
    return check_mask(env.observe()["image"])


def see_cloth_pose(
    env: TableEnv, *, height: int = 240, watch: Callable[[], None] | None = None
) -> ClothPose | None:
    """Move the arm out of the way and look how the cloth lies; None if none is in view.

    The hand is empty. The depth image has a height [pixel]; `watch` is called in each
    control step.
    """
    u = env.arm.home_command
    u[env.arm.closed_command] = 0.0
    for _ in range(4):
        env.advance(u, watch)
    try:
        cloud = capture_point_cloud(env, height)
        return find_cloth_pose(cloud, env.furniture.height, env.cloth)
    except NotVisibleError:
        return None


def _arm_with_hand(arm: Arm | str) -> Arm:
    arm = get_arm(arm)
    if not arm.gripper:
        raise ValueError(
            f"the hand of the {arm.name} arm does not open on command; "
            "use the arm muscle-hand"
        )
    return arm


class ExcitationPolicy(Policy):
    """A lively motion from which p of a cloth is estimated, the same each time.

    The hand is closed and held high. On a motion that it was trained on the model tells
    the cloths apart reliably, on a random one half the time.
    """

    name = "swing"
    LOWEST = (-0.8, -1.2)  # shoulder and elbow angle [rad]
    HIGHEST = (-0.7, 0.0)

    def __init__(self, arm: Arm | str):
        self.arm = _arm_with_hand(arm)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Begin the motion anew, whatever the seed."""
        self._rng = np.random.default_rng(0)

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.arm.home_command
        u[self.arm.angle_command] = self._rng.uniform(self.LOWEST, self.HIGHEST)
        u[self.arm.stiffness_command] = _any_stiffness(self.arm, self._rng)
        return u


def _any_stiffness(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    """Stiffness commands, drawn from their whole range."""
    stiffness = arm.stiffness_command
    return rng.uniform(arm.command_lower[stiffness], arm.command_upper[stiffness])


class RandomThrow(RandomPolicy):
    """Uniform random commands, and a hand that opens after 1 to 24 periods.

    That is perhaps after the end of the trial.
    """

    def __init__(self, arm: Arm | str):
        super().__init__(_arm_with_hand(arm))

    def reset(self, seed: int = 0) -> None:
        super().reset(seed)
        self._periods_left = float(np.random.default_rng([seed, 1]).uniform(1, 24))

    def __call__(self, observation: Observation) -> np.ndarray:
        u = super().__call__(observation)
        u[self.arm.closed_command] = np.clip(self._periods_left, 0.0, 1.0)
        self._periods_left -= 1
        return u


class OperatorThrow(Policy):
    """A scripted person who throws the cloth onto the table.

    They swing it back, forward and up, then down onto the table, and let go once.
    Postures, speeds, stiffness and release are drawn from ranges in which most of the
    successful ones of 400 development throws lay, with hard-1 and hard-3.
    """

    name = "operator"
    PHASES = (  # shoulder and elbow angle [rad] at the end of each: lowest, highest
        ((0.25, -0.9), (0.9, -0.2)),  # down and back
        ((-0.8, -0.6), (-0.3, -0.1)),  # forward and up
        ((0.3, -0.85), (1.0, -0.1)),  # down onto the table
    )
    LONGEST = 3  # control steps of a phase
    RELEASE = (1.0, 5.0)  # [period] after the last phase begins
    ONLY_SWINGS = 0.2  # part of the throws in which nothing is let go

    def __init__(self, arm: Arm | str):
        self.arm = _arm_with_hand(arm)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Draw another throw; the same seed gives the same."""
        rng = np.random.default_rng(seed)
        theta = np.array(self.arm.home)
        self._angles: list[np.ndarray] = []
        self._t = 0

        # Each phase moves fast at first, then waits
        for lowest, highest in self.PHASES:
            begins = len(self._angles)
            goal = rng.uniform(lowest, highest)
            steps = rng.integers(1, self.LONGEST + 1)
            moving = rng.integers(1, steps + 1)
            self._angles += [*np.linspace(theta, goal, moving + 1)[1:]]
            self._angles += [goal] * (steps - moving)
            theta = goal

        # The hand opens in the last phase or after it, and the arm waits for that
        self.release = begins + rng.uniform(*self.RELEASE)
        self._angles += [theta] * max(0, int(self.release) + 2 - len(self._angles))
        if rng.uniform() < self.ONLY_SWINGS:
            self.release = np.inf
        self._tension = _any_stiffness(self.arm, rng)

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.arm.home_command
        if self._t < len(self._angles):
            u[self.arm.angle_command] = self._angles[self._t]
        u[self.arm.stiffness_command] = self._tension
        u[self.arm.closed_command] = np.clip(self.release - self._t, 0.0, 1.0)
        self._t += 1
        return np.clip(u, self.arm.command_lower, self.arm.command_upper)


@dataclass(frozen=True)
class ThrowSettings:
    """How a throw is planned."""

    # Of a plan: swing, release, and until the cloth lies
    steps: int = 16  # [step]
    # Earliest and latest
    release: tuple[float, float] = (2.0, 12.0)  # [period]
    # In the last of them the cloth is let go in any case
    attempts: int = 3
    # In the others only if the distance predicted just before is as small as in all
    # recorded throws that spread hard-1.
    near: float = 1.1  # [s.d. of z]
    # For which the cloth hangs before an attempt until it is still
    rest: int = 20  # [step]
    # Weight of the variance of the model's error
    caution: float = 1.0
    # How far from a foam's p its throws still teach
    bias_scale: float = 0.5  # [spread of trained p]


@dataclass(frozen=True)
class ThrowAttempt:
    """One swing that came as far as the moment of release."""

    # Distance to the target that was predicted when it began [s.d. of z]
    expected: float
    before_release: float  # the same when the hand was about to open
    released: bool  # whether it did


class _Begun(NamedTuple):
    """A swing that is under way."""

    s: Tensor  # state at its start [D_s]
    plan: Tensor  # [T, D_u]
    expected: float  # distance to the target that was predicted then [s.d. of z]


class _Lesson(NamedTuple):
    """Plans that were swung, and by how much the model erred about their ends."""

    features: Tensor  # [N, D]
    errors: Tensor  # of z [N, D_z]


class _RecordedThrows(NamedTuple):
    """Recorded throws of one length, and where the cloth was at each end."""

    start: Tensor  # states [N, D_s]
    u: Tensor  # commands [N, T, D_u]
    end: Tensor  # states [N, D_s]
    p: Tensor  # biases of their own materials [N, D_p]


class ThrowPolicy(Policy):
    """Throws a cloth so that it looks like a target image when it has come to lie.

    Each attempt waits until the cloth hangs still and chooses, among the recorded
    throws, the one whose predicted outcome is nearest to the target, corrected by what
    a `ResidualModel` learned of the model's errors. Just before the hand opens, the
    outcome is predicted anew from what has been seen on the way. If that is too far
    from the target, the cloth is held, the arm goes back, and the difference teaches
    the next attempt.

    Args:
        model: predicts throws.
        autoencoder: with which the model was trained.
        arm: the arm, or its name; its hand opens on command.
        target: mask `[H, W]` of the cloth as it should lie.
        p: parametric bias of the cloth in the hand `[D_p]`.
        runs: recorded throws, from which plans are chosen.
        biases: trained p of each run's material, `{name: [D_p]}`.
        settings: how a throw is planned.

    Attributes:
        plans: the recorded throws, each once `[N, T, D_u]`, with the release time
            [period] in the last column.
        attempts: the swings since the reset.
        done: whether the last of them has come to its end.
    """

    name = "throw"

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm | str,
        target: ArrayLike,
        p: ArrayLike,
        runs: Sequence[Run],
        biases: Mapping[str, ArrayLike],
        settings: ThrowSettings = ThrowSettings(),
    ):
        # How a throw is planned, and how far its outcome teaches
        self.settings = settings
        self.learning = IterativeLearningSettings()

        # What predicts and sees, and the arm that throws
        self.model = model
        self.autoencoder = autoencoder
        self.arm = _arm_with_hand(arm)
        self.layout = self.arm.layout(autoencoder.latent_size)
        self._check_sizes()

        # Limits of plans: in the last column is the release time
        self.lower = torch.as_tensor(self.arm.command_lower, dtype=torch.float32)
        self.upper = torch.as_tensor(self.arm.command_upper, dtype=torch.float32)
        self.lower[-1], self.upper[-1] = self.settings.release

        # The cloth, the aim, and what recordings teach
        self.set_target(target)
        self.set_bias(p)
        throws = _recorded_throws(runs, biases, self.settings.steps)
        self.plans = self._plans_of(throws.u)
        self._bias_unit = self.settings.bias_scale * _spread(biases)
        self._recorded = self._errors_about(throws)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last attempts; the cloth hangs still at the arm's home."""
        self.attempts: list[ThrowAttempt] = []
        self.done = False
        self._held: list[_Lesson] = []  # what swings without a release taught
        self._resting = self.settings.rest
        self._begun: _Begun | None = None
        self._step = 0  # of the plan
        self._memory: Memory = self.model.initial_memory()

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next attempt on."""
        self.z_ref = torch.as_tensor(encode(self.autoencoder, check_mask(mask)))

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from now on."""
        p = check_array("p", p, (self.model.bias_size,), np.float32)
        self._p = torch.as_tensor(p)

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.numpy().copy()

    @property
    def released(self) -> bool:
        """Whether the cloth was let go."""
        return bool(self.attempts) and self.attempts[-1].released

    def _check_sizes(self) -> None:
        """Refuse a model that was trained on another arm."""
        sizes = (self.layout.size, len(self.arm.command_lower))
        if (self.model.state_size, self.model.command_size) != sizes:
            raise ValueError(
                f"the model has {self.model.state_size} states and "
                f"{self.model.command_size} commands, the {self.arm.name} arm has "
                f"{sizes[0]} and {sizes[1]}: load the weights of this arm"
            )

    def commands(self, plans: Tensor) -> Tensor:
        """What plans send, `[B, T, D_u]`.

        In the last column of a plan, in each row, is the release time [period].
        """
        closed = (plans[:, :1, -1] - torch.arange(plans.shape[1])).clamp(0, 1)
        return torch.cat([plans[..., :-1], closed[..., None]], dim=-1)

    def expected(self, s: Tensor, plans: Tensor, correction: ResidualModel) -> Tensor:
        """Predicted distance of the cloth to the target after each plan, `[B]`.

        Plans are `[B, T, D_u]`, distances in [s.d. of z], and larger where the
        correction of the model's errors is uncertain.
        """
        u = self.commands(plans)
        states = predict(self.model, s, u, self._p)
        z = states[:, -1, self.layout.z]
        error, variance = correction(self._features(s, u, self._p))
        squares = (z + error[:, 0] - self.z_ref).square().sum(-1)
        doubt = self.settings.caution * len(self.z_ref) * variance
        return (squares + doubt).clamp_min(1e-12).sqrt()

    def correction(self) -> ResidualModel:
        """The model's errors, learned from recorded throws and the attempts so far."""
        lessons = [self._recorded, *self._held]
        features = torch.cat([lesson.features for lesson in lessons])
        errors = torch.cat([lesson.errors for lesson in lessons])
        return ResidualModel(features, errors[:, None], self.learning)

    def __call__(self, observation: Observation) -> np.ndarray:
        s = torch.as_tensor(observe(self.autoencoder, observation))

        # Before an attempt the cloth comes to rest; after the last the arm does
        if self._resting:
            self._resting -= 1
            return self._home(closed=True)
        if self.done:
            return self._home(closed=not self.released)
        if self._begun is None:
            self._begun = self._begin(s)

        # The next command of the plan, unless the cloth is better held
        u = self.commands(self._begun.plan[None])[0, self._step]
        if u[-1] < 1 and not self.released:
            self._decide(s, self._begun)
            if not self.released:
                self._begun = None
                self._resting = self.settings.rest - 1
                return self._home(closed=True)
        with torch.no_grad():
            once = (s[None, None], u[None, None])
            _, self._memory = self.model(*once, self._p, self._memory)
        self._step += 1
        self.done = self._step == self.settings.steps
        return u.double().numpy()

    def _home(self, *, closed: bool) -> np.ndarray:
        u = self.arm.home_command
        u[self.arm.closed_command] = float(closed)
        return u

    def _begin(self, s: Tensor) -> _Begun:
        """Choose the plan that looks best from here, and begin it."""
        with torch.no_grad():
            distances = self.expected(s, self.plans, self.correction())
        self._step = 0
        self._memory = self.model.initial_memory()
        best = int(distances.argmin())
        return _Begun(s, self.plans[best], float(distances[best]))

    def _decide(self, s: Tensor, begun: _Begun) -> None:
        """Before the hand opens: predict the end from here, release if it is near.

        What the prediction has changed by since the start is a lesson about the model.
        """
        u = self.commands(begun.plan[None])
        with torch.no_grad():
            before = predict(self.model, begun.s, u, self._p)
            now = predict(self.model, s, u[:, self._step :], self._p, self._memory)
        z_before = before[0, -1, self.layout.z]
        z_now = now[0, -1, self.layout.z]

        # By now, errors from the start have been seen
        distance = float(torch.linalg.vector_norm(z_now - self.z_ref))
        last = len(self.attempts) + 1 >= self.settings.attempts
        release = last or distance <= self.settings.near
        self.attempts.append(ThrowAttempt(begun.expected, distance, release))
        features = self._features(begun.s, u, self._p)
        self._held.append(_Lesson(features, (z_now - z_before)[None]))

    def _plans_of(self, u: Tensor) -> Tensor:
        """Plans, each once, that send recorded commands `[N, T, D_u]`.

        They are kept within the limits. The hand was closed for as many periods as its
        shares are in sum.
        """
        release = u[..., -1].sum(1)
        column = release[:, None, None].expand(-1, u.shape[1], 1)
        plans = torch.cat([u[..., :-1], column], dim=-1)
        plans = plans.clamp(self.lower, self.upper)
        different = {plan.numpy().tobytes(): plan for plan in plans}
        return torch.stack([*different.values()])

    def _errors_about(self, throws: _RecordedThrows) -> _Lesson:
        """The model's errors about the ends of recorded throws, each with its own p."""
        features = []
        predicted = []
        for s, u, p in zip(throws.start, throws.u, throws.p, strict=True):
            with torch.no_grad():
                states = predict(self.model, s, u[None], p)
            predicted.append(states[:, -1, self.layout.z])
            features.append(self._features(s, u[None], p))
        errors = throws.end[:, self.layout.z] - torch.cat(predicted)
        return _Lesson(torch.cat(features), errors)

    def _features(self, s: Tensor, u: Tensor, p: Tensor) -> Tensor:
        """Plan, start and foam, in units of how far each still teaches: `[B, D]`.

        A throw teaches little about another foam; a stiff one lands where a soft one
        folds.
        """
        throw = plan_features(self.model, s, u, self.learning)
        bias = (p / self._bias_unit).expand(len(u), -1)
        return torch.cat([throw, bias], dim=1)


def _recorded_throws(
    runs: Sequence[Run], biases: Mapping[str, ArrayLike], steps: int
) -> _RecordedThrows:
    """The first steps of all throws that are long enough, and where they led."""
    runs = [run for run in runs if len(run) > steps]
    if not runs:
        raise ValueError(
            f"plans of {steps} steps need recorded throws that are longer: "
            "none was given"
        )
    own = [choose("material", run.material, biases) for run in runs]
    return _RecordedThrows(
        start=torch.as_tensor(np.stack([run.s[0] for run in runs])),
        u=torch.as_tensor(np.stack([run.u[:steps] for run in runs])),
        end=torch.as_tensor(np.stack([run.s[steps] for run in runs])),
        p=torch.as_tensor(np.array(own, np.float32)),
    )


def _spread(biases: Mapping[str, ArrayLike]) -> float:
    """Root mean square distance of trained p from their mean; 1 of a single one."""
    known = torch.as_tensor(np.array([*biases.values()], np.float32))
    return float((known - known.mean(0)).square().sum(1).mean().sqrt()) or 1.0
