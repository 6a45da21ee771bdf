"""Throws: policies that make them to be learned from, and the one that plans them to
spread a cloth on a table.

A throw is a plan of which only the end counts: its last step is the only one in the
loss. When the hand opens is one number of the plan. A command says it as the share of
each control period for which the hand is closed, 1, …, 1, 0.4, 0, …, 0, so that the
model learns what letting go does as it learns everything else.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, choose, setting
from clothlab.masks import Observation, check_mask
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import observe
from clothlab.method.data import Run
from clothlab.method.fast_rollout import FastDPMPB, rollout_of
from clothlab.method.iterative import IterativeLearningSettings, ResidualModel
from clothlab.method.model import DPMPB
from clothlab.method.policy import Policy
from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import hanging_points
from clothlab.trials import Trial
from studies.table_scene.perception import (
    NotVisibleError,
    capture_point_cloud,
    find_cloth_pose,
)
from studies.table_scene.table_env import ClothPose, TableEnv

# Ends the name of a recorded trial's policy when the cloth lay spread after it
_SPREAD = ", spread"


def label_spread(trial: Trial, spread: bool) -> Trial:
    """The trial with a note, in the name of its policy, whether the cloth was seen to
    lie spread after it.
    """
    return replace(
        trial, policy=trial.policy.removesuffix(_SPREAD) + (_SPREAD if spread else "")
    )


def was_spread(trial: Trial) -> bool:
    """Whether the cloth was seen to lie spread after a recorded trial."""
    return trial.policy.endswith(_SPREAD)


def laid_by_hand(env: TableEnv, ahead: float) -> np.ndarray:
    """Lay the cloth in the hand flat, its middle `ahead` of the shoulder [m]; its mask
    `[H, W]` is a target.
    """
    cloth, furniture = env.cloth, env.furniture
    env.start()
    env.release()
    points = hanging_points(cloth)
    x = ahead - cloth.length / 2 - points[..., 2]
    env.place_cloth(
        np.stack(
            [
                x,
                points[..., 1],
                np.full_like(x, furniture.height + furniture.point_radius),
            ],
            axis=-1,
        )
    )
    return check_mask(env.observe()["image"])


def see_cloth_pose(
    env: TableEnv, *, height: int = 240, watch: Callable[[], None] | None = None
) -> ClothPose | None:
    """Move the arm, whose hand is empty, out of the way and look how the cloth lies;
    None if none is in view.
    """
    u = env.arm.home_command
    u[env.arm.closed_command] = 0.0
    for _ in range(4):
        env.advance(u, watch)
    try:
        return find_cloth_pose(
            capture_point_cloud(env, height), env.furniture.height, env.cloth
        )
    except NotVisibleError:
        return None


def _arm_with_hand(arm: Arm | str) -> Arm:
    arm = get_arm(arm)
    if arm.closed_command.stop != len(arm.command_names):
        raise ValueError(
            f"the hand of the {arm.name} arm does not open on command; use the arm muscle-hand"
        )
    return arm


class ExcitationPolicy(Policy):
    """A lively motion with the hand closed and held high, the same each time, from
    which p of a cloth is estimated.

    On a motion that it was trained on the model tells the cloths apart reliably, on a
    random one half the time.
    """

    name = "swing"

    def __init__(self, arm: Arm | str):
        self.arm = _arm_with_hand(arm)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Begin the motion anew, whatever the seed."""
        self._rng = np.random.default_rng(0)

    def __call__(self, observation: Observation) -> np.ndarray:
        u, stiffness = self.arm.home_command, self.arm.stiffness_command
        u[self.arm.angle_command] = self._rng.uniform((-0.8, -1.2), (-0.7, 0.0))
        u[stiffness] = self._rng.uniform(
            self.arm.command_lower[stiffness], self.arm.command_upper[stiffness]
        )
        return u


class RandomThrow(RandomPolicy):
    """Uniform random commands, and a hand that opens after 1 to 24 periods: perhaps
    after the end of the trial.
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
    """A scripted person who swings the cloth back, forward and up, then down onto the
    table, and lets go once.

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
        rng, theta = np.random.default_rng(seed), np.array(self.arm.home)
        self._angles: list[np.ndarray] = []
        for lowest, highest in self.PHASES:
            begins = len(self._angles)
            goal, count = (
                rng.uniform(lowest, highest),
                rng.integers(1, self.LONGEST + 1),
            )
            moving = rng.integers(1, count + 1)  # fast at first, then waiting
            self._angles += [
                *np.linspace(theta, goal, moving + 1)[1:],
                *[goal] * (count - moving),
            ]
            theta = goal
        self.release = begins + rng.uniform(*self.RELEASE)
        self._angles += [theta] * max(0, int(self.release) + 2 - len(self._angles))
        if rng.uniform() < self.ONLY_SWINGS:
            self.release = np.inf
        stiffness = self.arm.stiffness_command
        self._tension = rng.uniform(
            self.arm.command_lower[stiffness], self.arm.command_upper[stiffness]
        )
        self._t = 0

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.arm.home_command
        if self._t < len(self._angles):
            u[self.arm.angle_command] = self._angles[self._t]
        u[self.arm.stiffness_command] = self._tension
        u[self.arm.closed_command] = np.clip(self.release - self._t, 0.0, 1.0)
        self._t += 1
        return np.clip(u, self.arm.command_lower, self.arm.command_upper)


@dataclass(frozen=True)
class ThrowSettings(Checked):
    """How a throw is planned."""

    # Of a plan: swing, release, and until the cloth lies
    steps: int = setting(16, "step", at_least=2)
    # Earliest and latest
    release: tuple[float, float] = setting((2.0, 12.0), "period", at_least=0)
    # In the last of them the cloth is let go in any case
    attempts: int = setting(3, at_least=1)
    # In the others only if the distance predicted just before is as small as in all
    # recorded throws that spread hard-1.
    near: float = setting(1.1, "s.d. of z", above=0)
    # For which the cloth hangs before an attempt until it is still
    rest: int = setting(20, "step", at_least=1)
    # Weight of the variance of the model's error
    caution: float = setting(1.0, at_least=0)
    # How far from a foam's p its throws still teach
    bias_scale: float = setting(0.5, "spread of trained p", above=0)


@dataclass(frozen=True)
class _ThrowAttempt:
    expected: (
        float  # distance to the target that was predicted when it began [s.d. of z]
    )
    before_release: float  # the same when the hand was about to open
    released: bool  # whether it did


class ThrowPolicy(Policy):
    """Throws a cloth so that it looks like a target image when it has come to lie.

    Each attempt waits until the cloth hangs still and chooses, among the recorded
    throws, the one whose predicted outcome is nearest to the target, corrected as in
    `learning.iterative`. Just before the hand opens, the outcome is predicted anew from
    what has been seen on the way. If that is too far from the target, the cloth is
    held, the arm goes back, and the difference teaches the next attempt.
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
        settings: ThrowSettings | None = None,
    ):
        self.settings, self.learning = (
            settings or ThrowSettings(),
            IterativeLearningSettings(),
        )
        self.model = model
        self.autoencoder = autoencoder
        self.arm = _arm_with_hand(arm)
        self.layout = self.arm.layout(autoencoder.latent_size)
        self.lower = torch.tensor(self.arm.command_lower, dtype=torch.float32)
        self.upper = torch.tensor(self.arm.command_upper, dtype=torch.float32)
        self._rollout_of_model = rollout_of(model)
        # In the last column of a plan is the release time
        self.lower[-1], self.upper[-1] = self.settings.release
        self.set_target(target)
        self.set_bias(p)
        self._learn_from(runs, biases)
        self.reset()

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next attempt on."""
        self.z_ref = torch.as_tensor(encode(self.autoencoder, check_mask(mask)))

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next attempt on."""
        p = check_array("p", p, (self.model.bias_size,), np.float32)
        self._p = torch.as_tensor(p)
        self._predict = self._rollout_of_model(self.model, self._p)

    def reset(self, seed: int = 0) -> None:
        """Forget the last attempts; the cloth hangs still at the arm's home."""
        self.attempts: list[_ThrowAttempt] = []
        self._held: list[
            tuple[Tensor, Tensor]
        ] = []  # features of plans that were swung, and errors of the model
        self._step, self.done = 0, False
        self._resting = self.settings.rest
        self._begun: tuple[Tensor, Tensor, float] | None = (
            None  # state at the start, plan, predicted distance
        )
        self._memory = self.model.initial_memory()

    @property
    def released(self) -> bool:
        """Whether the cloth was let go."""
        return bool(self.attempts) and self.attempts[-1].released

    def commands(self, plans: Tensor) -> Tensor:
        """What plans send, `[B, T, D_u]`: in the last column of a plan is the release
        time [period], in each row.
        """
        closed = (plans[:, :1, -1] - torch.arange(plans.shape[1])).clamp(0, 1)
        return torch.cat([plans[..., :-1], closed[..., None]], dim=-1)

    def expected(self, s: Tensor, plans: Tensor, correction: ResidualModel) -> Tensor:
        """Predicted distance of the cloth to the target after each of the plans `[B, T,
        D_u]`, `[B]` [s.d. of z].
        """
        u = self.commands(plans)
        z = self._predict(s, u, self.model.initial_memory())[:, -1, self.layout.z]
        error, variance = correction(self._features(s, u))
        squares = (z + error[:, 0] - self.z_ref).square().sum(-1)
        return (
            (squares + self.settings.caution * len(self.z_ref) * variance)
            .clamp_min(1e-12)
            .sqrt()
        )

    def correction(self) -> ResidualModel:
        """The model's errors of the end, learned from recorded throws and from the
        attempts so far.
        """
        tried, errors = zip(self._recorded, *self._held, strict=True)
        return ResidualModel(
            torch.cat(tried), torch.cat(errors)[:, None], self.learning
        )

    def __call__(self, observation: Observation) -> np.ndarray:
        s = torch.as_tensor(observe(self.autoencoder, observation))
        if self._resting:
            self._resting -= 1
            return self._home(closed=True)
        if self._begun is None and not self.done:
            self._begin(s)
        if self.done or self._begun is None:
            return self._home(closed=not self.released)
        u = self.commands(self._begun[1][None])[0, self._step]
        if u[-1] < 1 and not self.released:
            self._decide(s, *self._begun)
            if not self.released:
                self._begun, self._resting = None, self.settings.rest - 1
                return self._home(closed=True)
        self._memory = self._predict.follow(s, u, self._memory)
        self._step += 1
        self.done = self._step == self.settings.steps
        return u.double().numpy()

    def _home(self, *, closed: bool) -> np.ndarray:
        u = self.arm.home_command
        u[self.arm.closed_command] = float(closed)
        return u

    def _learn_from(self, runs: Sequence[Run], biases: Mapping[str, ArrayLike]) -> None:
        """Plans from recorded throws, and the model's errors for them with their own p."""
        steps = self.settings.steps
        runs = [run for run in runs if len(run) > steps]
        if not runs:
            raise ValueError(
                f"plans of {steps} steps need recorded throws that are longer: none was given"
            )
        s, u = (
            torch.as_tensor(np.stack([getattr(run, name)[: steps + 1] for run in runs]))
            for name in ("s", "u")
        )
        release = u[:, :steps, -1].sum(1)
        plans = torch.cat(
            [u[:, :steps, :-1], release[:, None, None].expand(-1, steps, 1)], dim=-1
        )
        plans = plans.clamp(self.lower, self.upper)
        first = {plan.numpy().tobytes(): k for k, plan in reversed([*enumerate(plans)])}
        self.plans = plans[sorted(first.values())]  # each once
        known = torch.as_tensor(
            np.array([np.asarray(p, np.float32) for p in biases.values()])
        )
        self._bias_unit = self.settings.bias_scale * float(
            (known - known.mean(0)).square().sum(1).mean().sqrt() or 1
        )
        own = [
            torch.as_tensor(
                np.asarray(choose("material", run.material, biases), np.float32)
            )
            for run in runs
        ]
        predicted = []
        with torch.no_grad():
            for k, p in enumerate(own):
                states = FastDPMPB(self.model, p)(
                    s[k, 0], u[k : k + 1, :steps], self.model.initial_memory()
                )
                predicted.append(states[:, -1, self.layout.z])
        features = torch.cat(
            [
                self._features(s[k, 0], u[k : k + 1, :steps], p)
                for k, p in enumerate(own)
            ]
        )
        self._recorded = features, s[:, steps, self.layout.z] - torch.cat(predicted)

    def _features(self, s: Tensor, u: Tensor, p: Tensor | None = None) -> Tensor:
        """Plan, start and foam: a throw teaches little about another foam; a stiff one
        lands where a soft one folds.
        """
        plan = (u / self.model.u_std).flatten(1) / self.learning.plan_scale
        start, bias = (
            s / self.model.s_std / self.learning.state_scale,
            (self._p if p is None else p) / self._bias_unit,
        )
        return torch.cat([plan, torch.cat([start, bias]).expand(len(u), -1)], dim=1)

    def _begin(self, s: Tensor) -> None:
        """Choose a plan for the next attempt."""
        with torch.no_grad():
            distances = self.expected(s, self.plans, self.correction())
        self._begun = s, self.plans[distances.argmin()], float(distances.min())
        self._step, self._memory = 0, self.model.initial_memory()

    def _decide(self, s: Tensor, began: Tensor, plan: Tensor, expected: float) -> None:
        """Before the hand opens: predict the outcome from here, and release if it is
        near enough.
        """
        with torch.no_grad():
            u, z = self.commands(plan[None]), self.layout.z
            before = self._predict(began, u, self.model.initial_memory())[0, -1, z]
            now = self._predict(s, u[:, self._step :], self._memory)[0, -1, z]
        # By now, errors from the start have been seen
        distance = float(torch.linalg.vector_norm(now - self.z_ref))
        release = (
            len(self.attempts) + 1 >= self.settings.attempts
            or distance <= self.settings.near
        )
        self.attempts.append(_ThrowAttempt(expected, distance, release))
        self._held.append((self._features(began, u), (now - before)[None]))
