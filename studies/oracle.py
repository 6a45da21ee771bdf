"""How near can the cloth come to a target, and how fast can the hand move?

Cross-entropy search on the true simulator: an oracle, which tries 220 plans in a copy
of the scene before it sends one. It tells whether a controller falls short or the arm
does, and what variable stiffness is good for at best.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from clothlab import data
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.masks import Observation, iou
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import ControlSettings
from clothlab.method.policy import Policy
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import Arm, MuscleArm, get_arm
from clothlab.simulation.cloth import Cloth, get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, recorded_plans, rollout
from studies._grid import Case, Experiment, grid, over
from studies._runs import (
    NEW,
    RECORDINGS,
    SAMPLES,
    TASKS,
    best_iou,
    find_cloth,
    new_trial,
    own_cloth,
)
from studies.motion import MotionWatch

TENSIONS = (10.0, 30.0, 70.0)  # [N] at which f_const is held


@dataclass(frozen=True)
class SearchSettings:
    """How many plans are tried, and how widely they are drawn."""

    starts: int = 60  # plans that are tried first
    remembered: int = (
        8  # of these: the best of the search before; the others are recorded ones
    )
    rounds: int = 4
    tries: int = 40  # plans drawn in each round
    elite: int = 8  # the best so far, around which a round draws
    first_width: float = (
        0.1  # least standard deviation of the first round [range of the command]
    )
    least_width: float = 0.02  # and of the others


_SPEED_SEARCH = SearchSettings(
    starts=80, rounds=20, tries=48, elite=10, least_width=0.03
)
_GAIN_SEARCH = SearchSettings(starts=40, rounds=6, tries=24, elite=8, least_width=0.03)
_MORE_TENSIONS = (10.0, 20.0, 30.0, 50.0, 70.0)


def cross_entropy(
    cost: Callable[[np.ndarray], np.ndarray],
    starts: np.ndarray,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SearchSettings | None = None,
    *,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw plans around the best ones so far, again and again, and keep the best (the
    cross-entropy method).

    The first round draws around the single best start, since starts that are good in
    different ways have a mean that is good in none. A command whose range is a point
    stays there.

    `cost` says what plans `[N, T, D_u]` cost `[N]`. Returns the best plans found, best
    first `[elite, T, D_u]`, and the lowest cost after the starts and after each round
    `[rounds + 1]`.
    """
    settings, lower, upper = (
        settings or SearchSettings(),
        np.asarray(lower),
        np.asarray(upper),
    )
    plans = np.clip(starts, lower, upper)
    costs, trace = cost(plans), []
    for left in reversed(range(settings.rounds + 1)):
        best = np.argsort(costs, kind="stable")[: settings.elite]
        plans, costs = plans[best], costs[best]
        trace.append(costs[0])
        if left:
            first = left == settings.rounds
            centre = plans[0] if first else plans.mean(axis=0)
            width = (settings.first_width if first else settings.least_width) * (
                upper - lower
            )
            deviation = np.maximum(plans.std(axis=0), width)
            drawn = np.clip(
                rng.normal(centre, deviation, (settings.tries, *centre.shape)),
                lower,
                upper,
            )
            plans, costs = (
                np.concatenate([plans, drawn]),
                np.concatenate([costs, cost(drawn)]),
            )
    return plans, np.array(trace)


@dataclass(eq=False)
class SimulatorMPC(Policy):
    """Tries plans in a copy of the scene at the beginning of each period, and sends the
    one that ends nearest.

    A plan is judged by its last step alone, since each picture takes as long as four
    steps of physics. Each search starts from the best plans of the one before, and for
    the rest from recorded `plans` `[N, period, D_u]`, drawn at random. Another `arm`
    than the scene's may have other limits, such as `env.arm.with_stiffness(10)`.
    `trace` has the lowest distances [s.d. of z] of each search since the reset,
    `[rounds + 1]`.
    """

    env: ClothEnv
    autoencoder: Autoencoder
    target: np.ndarray
    plans: np.ndarray
    settings: SearchSettings
    arm: Arm
    # Whether plans are judged by 1 - IoU of image and target in place of the distance
    # of z
    overlap: bool = False

    name = "simulator MPC"

    def __post_init__(self) -> None:
        self._copy = ClothEnv(self.env.arm, self.env.cloth, scene=self.env.scene)
        self._z_ref = encode(self.autoencoder, self.target)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run; the same seed tries the same plans."""
        self.trace: list[np.ndarray] = []
        self._rng = np.random.default_rng(seed)
        self._elite = self.plans[:0]
        self._left: Iterator[np.ndarray] = iter(())

    def __call__(self, observation: Observation) -> np.ndarray:
        u = next(self._left, None)
        if u is None:
            self._left = iter(self.search())
            u = next(self._left)
        return u

    def search(self) -> np.ndarray:
        """Look for the plan `[period, D_u]` that brings the scene as it is now nearest
        to the target.
        """
        remembered = self._elite[: min(self.settings.remembered, self.settings.starts)]
        drawn = min(self.settings.starts - len(remembered), len(self.plans))
        starts = np.concatenate(
            [remembered, self._rng.choice(self.plans, drawn, replace=False)]
        )
        lower, upper = self.arm.command_lower, self.arm.command_upper
        self._elite, trace = cross_entropy(
            self.distances, starts, lower, upper, self.settings, rng=self._rng
        )
        self.trace.append(trace)
        return self._elite[0].copy()

    def distances(self, plans: np.ndarray) -> np.ndarray:
        """Distance ‖z_ref - z‖₂ to the target after each of the plans `[N, T, D_u]` is
        sent from here, `[N]`.
        """
        images = []
        for plan in plans:
            mujoco.mj_copyData(self._copy.data, self._copy.model, self.env.data)
            for u in plan:
                self._copy.advance(u)
            images.append(self._copy.observe()["image"])
        if self.overlap:
            return 1 - iou(np.stack(images), self.target)
        return np.linalg.norm(
            encode(self.autoencoder, np.stack(images)) - self._z_ref, axis=1
        )

    def close(self) -> None:
        """Release the copy's OpenGL context."""
        self._copy.close()


def search_trial(
    autoencoder: Autoencoder,
    arm: Arm | str,
    cloth: Cloth | str,
    target: np.ndarray,
    plans: np.ndarray,
    periods: int,
    *,
    f_const: float | None = None,
    search: SearchSettings | None = None,
    overlap: bool = False,
    seed: int = 0,
) -> tuple[Trial, np.ndarray]:
    """Realise a target with the simulator known; arguments as `SimulatorMPC`, `f_const`
    held [N] where it is given.

    Returns: The run of `periods` periods, and the predicted distances `[periods, rounds
        + 1]` (`SimulatorMPC.trace`).
    """
    with closing(ClothEnv(arm, cloth)) as env:
        limited = env.arm if f_const is None else env.arm.with_stiffness(f_const)
        search = search or SearchSettings()
        with closing(
            SimulatorMPC(env, autoencoder, target, plans, search, limited, overlap)
        ) as policy:
            trial = rollout(env, policy, periods * policy.plans.shape[1], seed=seed)
            return trial, np.array(policy.trace)


def _run_one(
    arm: str,
    target: str,
    cloth: str,
    f_const: float | None,
    remembers: bool,
    seed: int,
    periods: int = 16,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """Distance at each step `[T]`, and its predictions; without memory each search
    starts from recorded plans alone.
    """
    autoencoder, _ = data.load_autoencoder(arm)
    # Of these recorded stretches each search draws its starts.
    plans = recorded_plans(
        data.load_trials(RECORDINGS[arm]), ControlSettings.period, 400, seed=seed
    )
    settings, mask = search or SearchSettings(), data.load_target(target)
    settings = settings if remembers else replace(settings, remembered=0)
    trial, trace = search_trial(
        autoencoder,
        arm,
        cloth,
        mask,
        plans,
        periods,
        f_const=f_const,
        search=settings,
        seed=seed,
    )
    return {
        "distance": target_distance(autoencoder, trial, mask).round(4),
        "trace": trace.round(4),
    }


def _run_transfer(
    arm: str,
    target: str,
    cloth: str,
    other: str,
    overlap: bool,
    periods: int = 3,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """The best plans for a cloth, searched by distance or by IoU, sent with it and with
    another cloth `[P]`.
    """
    autoencoder, _ = data.load_autoencoder(arm)
    plans, mask = (
        recorded_plans(data.load_trials(RECORDINGS[arm]), ControlSettings.period, 400),
        data.load_target(target),
    )
    held, given = find_cloth(cloth), find_cloth(other)
    trial, _ = search_trial(
        autoencoder, arm, held, mask, plans, periods, search=search, overlap=overlap
    )
    elsewhere = new_trial(ReplayPolicy(trial.commands), arm, given, len(trial), 0)
    return {
        "best": best_per_period(target_distance(autoencoder, trial, mask)).round(4),
        "elsewhere": best_per_period(
            target_distance(autoencoder, elsewhere, mask)
        ).round(4),
        "iou": best_iou(trial, mask).round(4),
    }


def _transfer_cases(**same: Any) -> list[Case]:
    """New cloths and recorded targets; new targets with the cloths at both ends of the
    range; by IoU with their own.
    """
    found = []
    for arm, cloths in NEW.items():
        targets = [target for each, target, _ in TASKS if each == arm]
        *_, light, heavy = names = [cloth.name for cloth in cloths]
        pairs = [(name, light if name == heavy else heavy) for name in names]
        found += [
            (arm, target, *pair, False)
            for target in dict.fromkeys(targets)
            for pair in pairs
        ]
        if arm == "torque":
            held, drawn = (
                list(data.load_targets(name)) for name in ("held-out", "drawn")
            )
            found += [
                (arm, target, *pair, False)
                for target in [*held[::2], *drawn]
                for pair in pairs[-2:]
            ]
            found += [
                (arm, target, own_cloth(target), own_cloth(target), True)
                for target in [*held, *drawn]
            ]
    axes = ("arm", "target", "cloth", "other", "overlap")
    return [dict(zip(axes, case, strict=True)) | same for case in found]


def _cases(seeds: Iterable[int] = (0, 1), **same: Any) -> list[Case]:
    """Every task with free stiffness, on the muscle arm with held stiffness too; one
    seed without memory.
    """
    found = []
    for tensions, remembers, chosen in (
        ((None,), True, seeds),
        (TENSIONS, True, seeds),
        ((None,), False, (0,)),
    ):
        for arm, target, cloth in TASKS:
            if tensions == (None,) or get_arm(arm).has_stiffness:
                axes = {
                    "arm": arm,
                    "target": target,
                    "cloth": cloth,
                    "f_const": tensions,
                    "remembers": remembers,
                }
                found += grid(**axes, seed=chosen, **same)
    return found


def best_possible(table: pd.DataFrame) -> pd.Series:
    """Best distance of a period with free stiffness, median of the last ten, mean over
    seeds, by target and cloth.
    """
    free = table[table["f_const"].isna() & table["remembers"]]
    last = free["distance"].map(lambda distance: late_median(best_per_period(distance)))
    return last.groupby([free["target"], free["cloth"]], sort=False).mean()


def _run_speed(
    seed: int,
    foam: str = "hard-1",
    steps: int = 16,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """Peak speeds of the hand [m/s] from rest, with f_const held at 10, 30 and 70 N and
    free, and the commands for it.

    The free search starts from the best plans of the others too: it may do all that
    they do.
    """
    return _peak_speeds(
        get_arm("muscle"),
        get_cloth(foam),
        TENSIONS,
        seed,
        steps,
        search or _SPEED_SEARCH,
    )


def _run_gain(
    motor_speed: float, load: float, softness: float, seed: int, steps: int = 12
) -> dict[str, Any]:
    """The same at a motor speed [m/s], with so many times the cloth's mass, and springs
    so many times as soft.
    """
    arm, cloth = MuscleArm(), get_cloth("hard-1")
    linear, cubic = arm.spring_linear / softness, arm.spring_cubic / softness
    arm = replace(
        arm, motor_speed=motor_speed, spring_linear=linear, spring_cubic=cubic
    )
    found = _peak_speeds(
        arm,
        replace(cloth, mass=load * cloth.mass),
        _MORE_TENSIONS,
        seed,
        steps,
        _GAIN_SEARCH,
    )
    del found["commands"], found["trace"]
    return found


def _peak_speeds(
    arm: Arm,
    cloth: Cloth,
    tensions: Iterable[float],
    seed: int,
    steps: int,
    search: SearchSettings,
) -> dict[str, Any]:
    home, env = ClothEnv(arm, cloth), ClothEnv(arm, cloth)

    def slowness(plans: np.ndarray) -> np.ndarray:
        peaks = []
        for plan in plans:
            mujoco.mj_copyData(env.data, env.model, home.data)
            watch = MotionWatch(env)
            for u in plan:
                env.advance(u, watch, SAMPLES)
            peaks.append(watch.hand_speed.max())
        return -np.array(peaks)

    starts = recorded_plans(
        data.load_trials(RECORDINGS["muscle"]), steps, search.starts, seed=seed
    )
    best, traces = [starts], []
    for f_const in (*tensions, None):
        limited = arm if f_const is None else arm.with_stiffness(f_const)
        lower, upper, rng = (
            limited.command_lower,
            limited.command_upper,
            np.random.default_rng(seed),
        )
        begin = np.concatenate(best) if f_const is None else starts
        plans, trace = cross_entropy(slowness, begin, lower, upper, search, rng=rng)
        best.append(plans)
        traces.append(-trace)
    return {
        "f_const": np.array([*tensions, np.nan]),
        "peak": np.array(traces)[:, -1],
        "trace": np.array(traces).round(4),
        "commands": np.array([plans[0] for plans in best[1:]]).round(4),
    }


_GAINS: dict[str, Any] = {
    "motor_speed": (0.05, 0.1, 0.4),
    "load": (1, 5),
    "softness": (1, 5),
    "seed": (0, 1),
}
EXPERIMENTS = (
    Experiment("oracle", _run_one, _cases, seconds=120, slow=True),
    Experiment(
        "oracle_transfer", _run_transfer, _transfer_cases, seconds=30, slow=True
    ),
    Experiment("peak_speed", _run_speed, over(seed=range(3)), seconds=600, slow=True),
    Experiment("stiffness_gain", _run_gain, over(**_GAINS), seconds=250, slow=True),
)
