"""How near can the cloth come to a target, and how fast can the hand move?

Cross-entropy search on the true simulator: an oracle, which tries 220 plans in a copy
of the scene before it sends one. It tells whether a controller falls short or the arm
does, and what variable stiffness is good for at best. Its experiments vary the task and
the held stiffness, take new cloths and targets, and ask at which stiffness the hand is
fast.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from clothlab import data
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import ControlSettings
from clothlab.method.rollout import Policy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import Observation, iou
from clothlab.trials import Trial, recorded_plans, rollout
from studies._grid import Case, Experiment, grid, over
from studies._runs import (
    HEAVY,
    NEW,
    RECORDINGS,
    SAMPLES,
    TASKS,
    best_iou,
    find_cloth,
    own_cloth,
)
from studies.motion import MotionWatch

TENSIONS = (10.0, 30.0, 70.0)  # [N] at which f_const is held


@dataclass(frozen=True)
class SearchSettings:
    """How many plans are tried, and how widely they are drawn."""

    starts: int = 60  # plans that are tried first
    remembered: int = 8  # of these: the best of the last search; others are recorded
    rounds: int = 4
    tries: int = 40  # plans drawn in each round
    elite: int = 8  # the best so far, around which a round draws
    # Least standard deviation of what a round draws [range of the command]
    first_width: float = 0.1  # of the first round
    least_width: float = 0.02  # of the others


_SPEED_SEARCH = SearchSettings(
    starts=80, rounds=20, tries=48, elite=10, least_width=0.03
)
_RECORDED_PLANS = 400  # stretches of commands from which searches draw their starts


def cross_entropy(
    cost: Callable[[np.ndarray], np.ndarray],
    starts: np.ndarray,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SearchSettings | None = None,
    *,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Look for plans of low cost by the cross-entropy method.

    Plans are drawn around the best ones so far, again and again, and the best are kept.
    The first round draws around the single best start, since starts that are good in
    different ways have a mean that is good in none. A command whose range is a point
    stays there.

    Args:
        cost: what plans `[N, T, D_u]` cost, `[N]`.
        starts: plans to begin with `[N, T, D_u]`.
        lower: least commands `[D_u]`.
        upper: largest commands `[D_u]`.
        settings: how many plans are drawn, and how widely.
        rng: draws them.

    Returns: the best plans found, best first `[elite, T, D_u]`, and the lowest cost
        after the starts and after each round `[rounds + 1]`.
    """
    settings = settings or SearchSettings()
    lower = np.asarray(lower)
    upper = np.asarray(upper)

    plans = np.clip(starts, lower, upper)
    costs = cost(plans)
    plans, costs = _elite(plans, costs, settings.elite)
    trace = [costs[0]]
    for round_ in range(settings.rounds):
        # Around the best plan at first, then around the mean of the best
        centre = plans[0] if round_ == 0 else plans.mean(axis=0)
        width = settings.first_width if round_ == 0 else settings.least_width
        deviation = np.maximum(plans.std(axis=0), width * (upper - lower))
        drawn = rng.normal(centre, deviation, (settings.tries, *centre.shape))
        drawn = np.clip(drawn, lower, upper)

        # The best of the old and of the new ones go on
        plans = np.concatenate([plans, drawn])
        costs = np.concatenate([costs, cost(drawn)])
        plans, costs = _elite(plans, costs, settings.elite)
        trace.append(costs[0])
    return plans, np.array(trace)


def _elite(
    plans: np.ndarray, costs: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The plans of lowest cost and their costs, best first."""
    best = np.argsort(costs, kind="stable")[:count]
    return plans[best], costs[best]


@dataclass(eq=False)
class SimulatorMPC(Policy):
    """Tries plans in a copy of the scene each period, and sends the best one.

    A plan is judged by its last step alone, since each picture takes as long as four
    steps of physics. Each search starts from the best plans of the one before, and for
    the rest from recorded ones, drawn at random. `trace` has the lowest distances
    [s.d. of z] of each search since the reset, `[rounds + 1]`.

    Args:
        env: the scene that is controlled.
        autoencoder: sees z.
        target: mask `[H, W]`.
        plans: recorded ones `[N, period, D_u]`.
        settings: of the search.
        arm: whose limits the commands keep, such as `env.arm.with_stiffness(10)`.
        overlap: whether plans are judged by 1 - IoU of image and target in place of the
            distance of z.
    """

    env: ClothEnv
    autoencoder: Autoencoder
    target: np.ndarray
    plans: np.ndarray
    settings: SearchSettings
    arm: Arm
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
        """The plan `[period, D_u]` that brings the scene nearest to the target."""
        # Start from what the last search found, and from recorded plans
        remembered = self._elite[: min(self.settings.remembered, self.settings.starts)]
        count = min(self.settings.starts - len(remembered), len(self.plans))
        recorded = self._rng.choice(self.plans, count, replace=False)
        starts = np.concatenate([remembered, recorded])

        # Keep the best for the next search
        self._elite, trace = cross_entropy(
            self.distances,
            starts,
            self.arm.command_lower,
            self.arm.command_upper,
            self.settings,
            rng=self._rng,
        )
        self.trace.append(trace)
        return self._elite[0].copy()

    def distances(self, plans: np.ndarray) -> np.ndarray:
        """Distance to the target after each of some plans is sent from here, `[N]`.

        It is ‖z_ref - z‖₂ [s.d. of z], or 1 - IoU, of plans `[N, T, D_u]`.
        """
        images = []
        for plan in plans:
            mujoco.mj_copyData(self._copy.data, self._copy.model, self.env.data)
            for u in plan:
                self._copy.advance(u)
            images.append(self._copy.observe()["image"])

        last = np.stack(images)
        if self.overlap:
            return 1 - iou(last, self.target)
        return np.linalg.norm(encode(self.autoencoder, last) - self._z_ref, axis=1)

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
) -> Trial:
    """Realise a target with the simulator known.

    Args:
        autoencoder: sees z.
        arm: of the scene.
        cloth: in its hand.
        target: mask `[H, W]`.
        plans: recorded ones, from which searches start `[N, period, D_u]`.
        periods: searches, and plans that are sent.
        f_const: held [N] where it is given.
        search: settings; its defaults where left out.
        overlap: whether plans are judged by IoU in place of the distance of z.
        seed: of the run and of what is drawn.
    """
    settings = search or SearchSettings()
    with closing(ClothEnv(arm, cloth)) as env:
        # The search keeps the limits of an arm that may be another one than the scene's
        limited = env.arm if f_const is None else env.arm.with_stiffness(f_const)
        policy = SimulatorMPC(
            env, autoencoder, target, plans, settings, limited, overlap
        )

        # Each search sends one plan
        with closing(policy):
            return rollout(env, policy, periods * plans.shape[1], seed=seed)


def _run_one(
    arm: str,
    target: str,
    cloth: str,
    f_const: float | None,
    seed: int,
    periods: int = 16,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """Distance at each step `[T]`.

    Args:
        arm, target, cloth: of the task, by name.
        f_const: tension that every command has to send [N]; None: it is free, or the
            arm has none.
        seed: of the run and of what is drawn.
        periods: of the run.
        search: settings; its defaults where left out.
    """
    autoencoder, _ = data.load_autoencoder(arm)
    mask = data.load_target(target)
    recordings = data.load_trials(RECORDINGS[arm])
    plans = recorded_plans(
        recordings, ControlSettings.period, _RECORDED_PLANS, seed=seed
    )

    # Search and send
    trial = search_trial(
        autoencoder,
        arm,
        cloth,
        mask,
        plans,
        periods,
        f_const=f_const,
        search=search,
        seed=seed,
    )
    return {"distance": target_distance(autoencoder, trial, mask).round(4)}


def _run_throws(
    target: str,
    cloth: str,
    seed: int,
    periods: int = 5,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """The commands `[T, D_u]` of a run of the torque arm, for a film of it.

    Args:
        target, cloth: of the task, by name.
        seed: of the run and of what is drawn.
        periods: of the run.
        search: settings; its defaults where left out.
    """
    autoencoder, _ = data.load_autoencoder("torque")
    mask = data.load_target(target)
    recordings = data.load_trials(RECORDINGS["torque"])
    plans = recorded_plans(
        recordings, ControlSettings.period, _RECORDED_PLANS, seed=seed
    )
    trial = search_trial(
        autoencoder, "torque", cloth, mask, plans, periods, search=search, seed=seed
    )
    return {"commands": trial.commands.round(4)}


def _cases(seed: Iterable[int] = (0, 1), **same: Any) -> list[Case]:
    """Every task with free stiffness, and those of the muscle arm with a held one."""
    cases = []
    for f_const in ((None,), TENSIONS):
        for arm, target, cloth in TASKS:
            if f_const == TENSIONS and not get_arm(arm).has_stiffness:
                continue
            task = {"arm": arm, "target": target, "cloth": cloth}
            cases += grid(**task, f_const=f_const, seed=seed, **same)
    return cases


def best_possible(table: pd.DataFrame) -> pd.Series:
    """Distance that the oracle reaches with free stiffness, by target and cloth.

    The best of a period, median of the last ten periods, mean over seeds.
    """
    free = table[table["f_const"].isna()]
    last = free["distance"].map(lambda distance: late_median(best_per_period(distance)))
    return last.groupby([free["target"], free["cloth"]], sort=False).mean()


def _run_transfer(
    arm: str,
    target: str,
    cloth: str,
    overlap: bool,
    periods: int = 3,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """How near the best plans for a cloth come, in each period `[P]`.

    Args:
        arm, target, cloth: of the task, by name.
        overlap: whether plans are judged by IoU in place of the distance of z.
        periods: of the run.
        search: settings; its defaults where left out.
    """
    autoencoder, _ = data.load_autoencoder(arm)
    mask = data.load_target(target)
    recordings = data.load_trials(RECORDINGS[arm])
    plans = recorded_plans(recordings, ControlSettings.period, _RECORDED_PLANS)
    held = find_cloth(cloth)
    trial = search_trial(
        autoencoder, arm, held, mask, plans, periods, search=search, overlap=overlap
    )
    distance = target_distance(autoencoder, trial, mask)
    return {
        "best": best_per_period(distance).round(4),
        "iou": best_iou(trial, mask).round(4),
    }


def _transfer_cases(**same: Any) -> list[Case]:
    """New cloths with recorded and with held-out targets, and new targets by IoU."""
    cases = []

    def add(overlap: bool, **task: str) -> None:
        cases.append(task | {"overlap": overlap} | same)

    for arm, new_cloths in NEW.items():
        names = [cloth.name for cloth in new_cloths]
        targets = [target for each, target, _ in TASKS if each == arm]
        for target in dict.fromkeys(targets):
            for name in names:
                add(False, arm=arm, target=target, cloth=name)
        if arm != "torque":
            continue

        # Some of the held-out targets with the cloths at both ends
        held_out = list(data.load_targets("held-out"))
        drawn = list(data.load_targets("drawn"))
        for target in held_out[::6]:
            for name in names[-2:]:
                add(False, arm=arm, target=target, cloth=name)

        # By IoU with the cloth that belongs to the target
        for target in [*held_out, *drawn]:
            add(True, arm=arm, target=target, cloth=own_cloth(target))
    return cases


def _run_speed(
    seed: int,
    foam: str = "hard-1",
    steps: int = 16,
    search: SearchSettings | None = None,
) -> dict[str, Any]:
    """Peak speeds of the hand [m/s] from rest.

    f_const is held at 10, 30 and 70 N, and free. The free search starts from the best
    plans of the others too: it may do all that they do.
    """
    arm = get_arm("muscle")
    settings = search or _SPEED_SEARCH
    slowness = _slowness(arm, get_cloth(foam))

    def fastest(limited: Arm, starts: np.ndarray) -> tuple[np.ndarray, float]:
        """The best plans within an arm's limits, and their peak speed."""
        lower = limited.command_lower
        upper = limited.command_upper
        rng = np.random.default_rng(seed)
        plans, trace = cross_entropy(slowness, starts, lower, upper, settings, rng=rng)
        return plans, -trace[-1]

    # With each held tension, from recorded plans
    recordings = data.load_trials(RECORDINGS["muscle"])
    recorded = recorded_plans(recordings, steps, settings.starts, seed=seed)
    searches = [fastest(arm.with_stiffness(f_const), recorded) for f_const in TENSIONS]

    # With a free one, from all that the others found, too
    held = [plans for plans, _ in searches]
    searches.append(fastest(arm, np.concatenate([recorded, *held])))
    return {
        "f_const": np.array([*TENSIONS, np.nan]),
        "peak": np.array([peak for _, peak in searches]),
    }


def _slowness(arm: Arm, cloth: Cloth) -> Callable[[np.ndarray], np.ndarray]:
    """The function from plans `[N, T, D_u]` to minus the hand's peak speed `[N]`.

    Each plan begins with the cloth hanging still.
    """
    home = ClothEnv(arm, cloth)
    env = ClothEnv(arm, cloth)

    def slowness(plans: np.ndarray) -> np.ndarray:
        peaks = []
        for plan in plans:
            mujoco.mj_copyData(env.data, env.model, home.data)
            watch = MotionWatch(env)
            for u in plan:
                env.advance(u, watch, SAMPLES)
            peaks.append(watch.hand_speed.max())
        return -np.array(peaks)

    return slowness


_SPEED_CASES = over(seed=range(3))
_THROWN = over(target="target-1", cloth=HEAVY, seed=1)
EXPERIMENTS = (
    Experiment("oracle", _run_one, _cases, slow=True),
    Experiment("searched_throws", _run_throws, _THROWN),
    Experiment("oracle_transfer", _run_transfer, _transfer_cases, slow=True),
    Experiment("peak_speed", _run_speed, _SPEED_CASES, slow=True),
)
