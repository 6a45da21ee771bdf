"""Throws: who makes them to be learned from, and who plans them to spread a cloth on a table.

A throw is a plan whose end counts, not each period: one masked step, its last. When the hand opens is part of the plan,
as one number; commands say it as the part of each control period for which the hand is closed, 1, …, 1, 0.4, 0, …, 0,
so that the model learns what letting go does as it learns everything else, and the plan's end has a derivative by it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_number, choose, setting
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import ControlSettings, PlanningPolicy, optimise_commands
from clothlab.learning.dpmpb import DPMPB, Sequences, observe
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.learning.iterative import IterativeLearningSettings, ResidualModel
from clothlab.policies import Policy, RandomPolicy, Wrapper
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.env import Observation
from clothlab.simulation.vision import check_mask
from clothlab.table_scene.depth import look
from clothlab.table_scene.perception import NotInView, SeenSpread, find_spread
from clothlab.table_scene.scene import hanging_points
from clothlab.table_scene.table_env import TableEnv
from clothlab.trials import Trial

SWING = 0  # seed of the motion that gets to know a cloth
SWUNG = ((-0.8, -1.2), (-0.7, 0.0))  # [rad] lowest and highest angles of it
SPREAD = ", spread"  # what the operator writes behind a trial's policy when the cloth lies as it should


def closed_until(release: float, steps: int) -> np.ndarray:
    """For how much of each control period the hand is closed that opens after so many periods, `[T]`."""
    return np.clip(release - np.arange(steps), 0.0, 1.0)


def judged(trial: Trial, spread: bool) -> Trial:
    """The trial with what came of it written down: whether the cloth was seen to lie spread."""
    return replace(trial, policy=trial.policy.removesuffix(SPREAD) + (SPREAD if spread else ""))


def was_spread(trial: Trial) -> bool:
    """Whether somebody saw the cloth lie spread after it."""
    return trial.policy.endswith(SPREAD)


def laid_by_hand(env: TableEnv, ahead: float) -> np.ndarray:
    """Mask `[H, W]` of the cloth as a person would lay it, flat, far edge forward: what a throw can aim at.

    Args:
        env: a scene of its own, with the cloth in the hand, which is let go and laid.
        ahead: from the shoulder, with the base at 0, to the cloth's middle [m].
    """
    cloth, furniture = env.cloth, env.furniture
    env.start()
    env.release()
    points = hanging_points(cloth)
    x = ahead - cloth.length / 2 - points[..., 2]
    env.place_cloth(np.stack([x, points[..., 1], np.full_like(x, furniture.height + furniture.point_radius)], axis=-1))
    return check_mask(env.observe()["image"])


def look_at_spread(env: TableEnv, *, height: int = 240, watch: Callable[[], None] | None = None) -> SeenSpread | None:
    """Take the arm, whose hand is empty, out of the way and look how the cloth lies; None where there is none.

    Args:
        env: the scene, with an arm whose hand opens on command.
        height: of the depth image [pixel].
        watch: called while the arm moves, as `TableEnv.advance` has it.
    """
    u = env.arm.home_command
    u[env.arm.closed_command] = 0.0
    for _ in range(4):
        env.advance(u, watch)
    try:
        return find_spread(look(env, height, height * 4 // 3), env.furniture.height, env.cloth)
    except NotInView:
        return None


def _hand(arm: Arm | str) -> Arm:
    """The arm.

    Raises:
        ValueError: its hand does not open on command.
    """
    arm = get_arm(arm)
    if arm.closed_command.stop != len(arm.command_names):
        raise ValueError(f"the hand of the {arm.name} arm does not open on command; use the arm muscle-hand")
    return arm


class Swing(Policy):
    """A few seconds of lively motion with the hand closed, the same each time, by which a robot gets to know its cloth.

    Of a motion that it has made with all its cloths a model tells them apart; of another one, as random, in half of the
    cases. The arm is held high, so that the cloth does not catch on the table.

    Args:
        arm: gives the range of the stiffness; its hand opens on command.

    Raises:
        ValueError: a hand that does not open on command.
    """

    name = "swing"

    def __init__(self, arm: Arm | str):
        self.arm = _hand(arm)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Begin the motion anew; it has no other seed than its own."""
        self._rng = np.random.default_rng(SWING)

    def __call__(self, observation: Observation) -> np.ndarray:
        u, stiffness = self.arm.home_command, self.arm.stiffness_command
        u[self.arm.angle_command] = self._rng.uniform(*SWUNG)
        u[stiffness] = self._rng.uniform(self.arm.command_lower[stiffness], self.arm.command_upper[stiffness])
        return u


class RandomThrow(Wrapper):
    """Uniform random commands, and a hand that opens at a random time: perhaps after the end of the trial.

    Args:
        arm: gives the range of the commands; its hand opens on command.
        latest: the release time is drawn from 1 to so many periods.

    Raises:
        ValueError: a hand that does not open on command.
    """

    def __init__(self, arm: Arm | str, *, latest: int = 24):
        self.arm, self.latest = _hand(arm), check_number("latest", latest, int, at_least=1)
        super().__init__(RandomPolicy(self.arm))

    def reset(self, seed: int = 0) -> None:
        super().reset(seed)
        self._left = float(np.random.default_rng([seed, 1]).uniform(1, self.latest))

    def __call__(self, observation: Observation) -> np.ndarray:
        u = super().__call__(observation)
        u[self.arm.closed_command] = np.clip(self._left, 0.0, 1.0)
        self._left -= 1
        return u


@dataclass(frozen=True)
class OperatorSettings(Checked):
    """Between what a person chooses who throws a cloth on a table.

    The ranges are those in which most of the successful ones of 400 development throws lay, with hard-1 and hard-3,
    that were drawn from wider ones: a person has had some practice, too.
    """

    back: tuple[int, int] = setting((1, 3), "step", at_least=1)  # down and back, with what rest is left
    up: tuple[int, int] = setting((1, 3), "step", at_least=1)  # forward and up
    down: tuple[int, int] = setting((1, 3), "step", at_least=1)  # onto the table
    low: tuple[tuple[float, float], ...] = setting(((0.25, 0.9), (-0.9, -0.2)), "rad")
    high: tuple[tuple[float, float], ...] = setting(((-0.8, -0.3), (-0.6, -0.1)), "rad")
    end: tuple[tuple[float, float], ...] = setting(((0.3, 1.0), (-0.85, -0.1)), "rad")
    release: tuple[float, float] = setting((1.0, 5.0), "period")  # after the way down begins
    back_home: int = setting(2, "step", at_least=1)  # after the release, so that the arm hides nothing in the end
    only_swings: float = setting(0.2, at_least=0, at_most=1)  # part of the throws in which nothing is let go


class OperatorThrow(Policy):
    """A scripted stand-in for a person: swings back, forward and up, then down onto the table, and lets go once.

    Every throw draws its own postures, speeds, stiffness and release. In the end the arm goes back to its home.

    Args:
        arm: its hand opens on command.
        settings: between what is drawn.

    Raises:
        ValueError: a hand that does not open on command.
    """

    name = "operator"

    def __init__(self, arm: Arm | str, settings: OperatorSettings | None = None):
        self.arm, self.settings = _hand(arm), settings or OperatorSettings()
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Draw another throw; the same seed gives the same."""
        how, rng = self.settings, np.random.default_rng(seed)
        theta = np.array(self.arm.home)
        self._angles: list[np.ndarray] = []
        for steps, posture in ((how.back, how.low), (how.up, how.high), (how.down, how.end)):
            begins = len(self._angles)
            goal, count = rng.uniform(*np.transpose(posture)), rng.integers(steps[0], steps[1] + 1)
            moving = rng.integers(1, count + 1)  # fast at first, then waiting
            self._angles += [*np.linspace(theta, goal, moving + 1)[1:], *[goal] * (count - moving)]
            theta = goal
        self.release = begins + rng.uniform(*how.release)
        self._angles += [theta] * max(0, int(self.release) + how.back_home - len(self._angles))
        if rng.uniform() < how.only_swings:
            self.release = np.inf
        stiffness = self.arm.stiffness_command
        self._tension = rng.uniform(self.arm.command_lower[stiffness], self.arm.command_upper[stiffness])
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

    steps: int = setting(16, "step", at_least=2)  # of a plan: swing, release, and until the cloth lies
    release: tuple[float, float] = setting((2.0, 12.0), "period", at_least=0)  # earliest and latest
    attempts: int = setting(3, at_least=1)  # from the last of them the cloth is let go in any case
    # Where the cloth must be expected to be let go before the last attempt: so near were all recorded throws that
    # spread hard-1, judged when the hand opened, and few of the others.
    near: float = setting(1.1, "s.d. of z", above=0)
    rest: int = setting(20, "step", at_least=1)  # for which the cloth hangs before an attempt until it is still
    starts: int = setting(4, at_least=1)  # best-looking recorded throws from which the descent begins
    # Of the descent. In development it found plans that promise more and then miss by more: the model is good enough to
    # choose among recorded throws, not to leave them.
    iterations: int = setting(0, at_least=0)
    candidates: int = setting(12, at_least=2)  # step sizes tried at once
    largest_step: float = setting(1.0, above=0)  # in standard deviations of u
    caution: float = setting(1.0, at_least=0)  # weight of the variance of what a promise misses
    bias_scale: float = setting(0.5, "spread of trained p", above=0)  # how far from a foam's p its throws still teach


@dataclass(frozen=True, eq=False)
class Attempt:
    """One attempt.

    Attributes:
        s: state at its start `[D_s]`.
        plan: as `ThrowPolicy` optimises it `[T, D_u]`.
        promise: the model's own, uncorrected, for the plan's end `[D_z]`.
        expected: distance to the target that was expected when it began [s.d. of z].
        before_release: the same when the hand was about to open.
        released: whether it did.
        ended: control steps since the reset when it was over: let go, or held.
    """

    s: Tensor
    plan: Tensor
    promise: Tensor
    expected: float
    before_release: float
    released: bool
    ended: int


class ThrowPolicy(PlanningPolicy):
    """Throws a cloth so that a target image is realised when it has come to lie; the end alone counts.

    Each attempt waits until the cloth hangs still and chooses a plan, commands and a release time: the best of recorded
    throws by the model's promise corrected as in `learning.iterative`, improved by the gradient. Just before the hand
    opens, what is to be expected is computed anew from what has been seen on the way. If that is too far from the
    target, the cloth is held, the arm goes back, and the difference teaches the next attempt.

    Args:
        model: trained network of an arm whose hand opens on command.
        autoencoder: the one that the model was trained with.
        arm: gives home and range of the commands.
        target: mask `[H, W]` of the cloth as it should lie.
        p: parametric bias of the cloth in the hand `[D_p]`.
        runs: recorded throws to choose from, as the model sees them, each from a cloth that hung still. What the model
            misses in them is known; a throw that was tried several times is known so well as its outcomes agree.
        biases: trained p of each material that they were recorded with.
        settings: attempts, release, descent.
        practice: how far what an attempt missed teaches.

    Raises:
        KeyError: a run of a material without p.
        ValueError: as `ControlPolicy` has it, a hand that does not open on command, or no recorded throw that is
            longer than a plan.

    Attributes:
        attempts: since the reset.
        trace: lowest expected distance of each plan at the start of its descent and after each iteration, a list of
            `[iterations + 1]` [s.d. of z].
    """

    name = "throw"

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm | str,
        target: ArrayLike,
        p: ArrayLike,
        runs: Sequence[Sequences],
        biases: Mapping[str, ArrayLike],
        settings: ThrowSettings | None = None,
        practice: IterativeLearningSettings | None = None,
    ):
        self.settings, self.practice = settings or ThrowSettings(), practice or IterativeLearningSettings()
        super().__init__(model, autoencoder, _hand(arm))
        self.lower[-1], self.upper[-1] = self.settings.release  # in the last column of a plan is the release time
        self.scale[-1] = 1.0
        self.set_target(target)
        self.set_bias(p)
        self._learn_from(runs, biases)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last attempts; the cloth hangs still at the arm's home."""
        self.attempts: list[Attempt] = []
        self.trace: list[np.ndarray] = []
        self._held: list[tuple[Tensor, Tensor]] = []  # features of plans that were swung, and what they missed
        self._t, self._step, self.done = 0, 0, False
        self._resting = self.settings.rest
        self._plan: Tensor | None = None
        self._memory = self.model.initial_memory()

    @property
    def released(self) -> bool:
        """Whether the cloth was let go."""
        return bool(self.attempts) and self.attempts[-1].released

    def commands(self, plans: Tensor) -> Tensor:
        """What plans send, `[B, T, D_u]`: in the last column of a plan is the release time [period], in each row."""
        closed = (plans[:, :1, -1] - torch.arange(plans.shape[1])).clamp(0, 1)
        return torch.cat([plans[..., :-1], closed[..., None]], dim=-1)

    def expected(self, s: Tensor, plans: Tensor, correction: ResidualModel) -> Tensor:
        """Expected distance of the cloth to the target after each of the plans `[B, T, D_u]`, `[B]` [s.d. of z]."""
        u = self.commands(plans)
        z = self._predict(s, u, self.model.initial_memory())[:, -1, self.layout.z]
        missed, variance = correction(self._features(s, u))
        squares = (z + missed[:, 0] - self.z_ref).square().sum(-1)
        return (squares + self.settings.caution * len(self.z_ref) * variance).clamp_min(1e-12).sqrt()

    def correction(self) -> ResidualModel:
        """What the model's promises for the end missed, in recorded throws and in the attempts so far."""
        tried, missed = zip(self._recorded, *self._held, strict=True)
        return ResidualModel(torch.cat(tried), torch.cat(missed)[:, None], self.practice)

    def __call__(self, observation: Observation) -> np.ndarray:
        s = torch.as_tensor(observe(self.autoencoder, observation))
        self._t += 1
        if self._resting:
            self._resting -= 1
            return self._home(closed=True)
        if self._plan is None and not self.done:
            self._begin(s)
        if self.done or self._plan is None:
            return self._home(closed=not self.released)
        u = self.commands(self._plan[None])[0, self._step]
        if u[-1] < 1 and not self.released:
            self._decide(s)
            if not self.released:
                self._plan, self._resting = None, self.settings.rest - 1
                return self._home(closed=True)
        self._memory = self._predict.follow(s, u, self._memory)
        self._step += 1
        self.done = self._step == self.settings.steps
        return u.double().numpy()

    def _home(self, *, closed: bool) -> np.ndarray:
        u = self.arm.home_command
        u[self.arm.closed_command] = float(closed)
        return u

    def _learn_from(self, runs: Sequence[Sequences], biases: Mapping[str, ArrayLike]) -> None:
        """Starts from recorded throws, and what the model promises wrongly for them with their own p."""
        steps = self.settings.steps
        runs = [run for run in runs if len(run) > steps]
        if not runs:
            raise ValueError(f"plans of {steps} steps need recorded throws that are longer: none was given")
        s, u = (torch.as_tensor(np.stack([getattr(run, name)[: steps + 1] for run in runs])) for name in ("s", "u"))
        release = u[:, :steps, -1].sum(1)
        plans = torch.cat([u[:, :steps, :-1], release[:, None, None].expand(-1, steps, 1)], dim=-1)
        plans = plans.clamp(self.lower, self.upper)
        first = {plan.numpy().tobytes(): k for k, plan in reversed([*enumerate(plans)])}
        self.starts = plans[sorted(first.values())]  # each once
        known = torch.as_tensor(np.array([np.asarray(p, np.float32) for p in biases.values()]))
        self._bias_unit = self.settings.bias_scale * float((known - known.mean(0)).square().sum(1).mean().sqrt() or 1)
        own = [torch.as_tensor(np.asarray(choose("material", run.material, biases), np.float32)) for run in runs]
        promised = []
        with torch.no_grad():
            for k, p in enumerate(own):
                states = FastDPMPB(self.model, p)(s[k, 0], u[k : k + 1, :steps], self.model.initial_memory())
                promised.append(states[:, -1, self.layout.z])
        features = torch.cat([self._features(s[k, 0], u[k : k + 1, :steps], p) for k, p in enumerate(own)])
        self._recorded = features, s[:, steps, self.layout.z] - torch.cat(promised)

    def _features(self, s: Tensor, u: Tensor, p: Tensor | None = None) -> Tensor:
        """Plan, start and foam: a throw teaches little about another foam, for a stiff one lands where a soft folds."""
        plan = (u / self.model.u_std).flatten(1) / self.practice.plan_scale
        start, bias = s / self.model.s_std / self.practice.state_scale, (self._p if p is None else p) / self._bias_unit
        return torch.cat([plan, torch.cat([start, bias]).expand(len(u), -1)], dim=1)

    def _begin(self, s: Tensor) -> None:
        """Choose a plan for the next attempt."""
        correction, how = self.correction(), self.settings
        with torch.no_grad():
            losses = self.expected(s, self.starts, correction)
        control = ControlSettings(
            candidates=how.candidates, largest_step=how.largest_step, iterations=max(1, how.iterations)
        )
        found = []
        for start in self.starts[losses.argsort()[: how.starts]]:
            if how.iterations:
                expected = lambda plans: self.expected(s, plans, correction)  # noqa: E731
                found.append(
                    optimise_commands(lambda plans: plans, expected, start, self.lower, self.upper, self.scale, control)
                )
            else:
                found.append((start, np.array([float(losses.min())])))
        plan, trace = min(found, key=lambda each: each[1][-1])
        self.trace.append(trace)
        self._plan, self._began, self._step, self._memory = plan, s, 0, self.model.initial_memory()

    def _decide(self, s: Tensor) -> None:
        """Before the hand opens: what is to be expected now, and whether that will do."""
        assert self._plan is not None
        with torch.no_grad():
            u, z = self.commands(self._plan[None]), self.layout.z
            promise = self._predict(self._began, u, self.model.initial_memory())[0, -1, z]
            now = self._predict(s, u[:, self._step :], self._memory)[0, -1, z]
        away = float(torch.linalg.vector_norm(now - self.z_ref))  # what a promise from the start missed is seen by now
        number = len(self.attempts) + 1
        last = number >= self.settings.attempts
        release = last or away <= self.settings.near
        attempt = Attempt(self._began, self._plan, promise, float(self.trace[-1][-1]), away, release, self._t)
        self.attempts.append(attempt)
        self._held.append((self._features(self._began, u), (now - promise)[None]))
