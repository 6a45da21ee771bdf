"""What is possible? Search on the true simulator: how near the cloth comes to a target, and how fast the hand moves.

The paper has no such figure. Without one, nobody knows whether a controller falls short or the arm does, nor what
*variable* stiffness is good for at best, and what of it is merely being stiff.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import best_per_period, late_median, target_distance
from clothlab.experiments._record import RECORDINGS, run_jobs
from clothlab.experiments.oracle import SearchSettings, SimulatorSearch, copy_state, cross_entropy
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import ControlSettings, recorded_plans
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.trials import MotionWatch, Trial, rollout

PERIOD = ControlSettings.period
POOL = 400  # recorded stretches, of which each search draws its starts
SEARCH = SearchSettings()
SPEED_SEARCH = SearchSettings(starts=80, rounds=20, tries=48, elite=10, least_width=0.03)


@dataclass(frozen=True)
class Settings(Checked):
    """Which cases; the defaults are the full size."""

    weights: str = setting("torque")  # autoencoder of the torque arm's camera, by which distances are measured
    targets: tuple[str, ...] = setting(("target-1", "target-2"))
    cloths: tuple[str, ...] = setting((cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)))
    muscle_weights: str = setting("muscle")  # autoencoder of the muscle arm's camera
    foam_targets: tuple[str, ...] = setting(("muscle",))
    foams: tuple[str, ...] = setting(("hard-1", "soft-1"))
    tensions: tuple[float, ...] = setting((10.0, 30.0, 70.0), "N", above=0)  # at which f_const is held; it is free too
    periods: int = setting(16, at_least=2)
    search: SearchSettings = SEARCH  # of each period
    seeds: tuple[int, ...] = setting((0, 1), at_least=0)  # of the search
    forgetful_seeds: tuple[int, ...] = setting((0,), at_least=0)  # of searches that begin anew each period
    speed_foam: str = setting("hard-1")  # in the hand whose peak speed is looked for
    speed_steps: int = setting(16, "step", at_least=1)  # from rest: room for a swing back
    speed_search: SearchSettings = SPEED_SEARCH
    speed_seeds: tuple[int, ...] = setting((0, 1, 2), at_least=0)


@dataclass(frozen=True)
class Case:
    """What is to be realised, with what.

    Attributes:
        arm: its name.
        target: name of the target.
        cloth: name of the cloth in the hand.
        f_const: at which the stiffness command is held [N]; None: it is free, or the arm has none.
        remembers: whether each search starts from the best plans of the one before, or from recorded ones alone.
        seed: of the search.
    """

    arm: str
    target: str
    cloth: str
    f_const: float | None
    remembers: bool
    seed: int


@dataclass(frozen=True, eq=False)
class Run:
    """How near a case came.

    Attributes:
        case: which.
        distance: at each step `[T]` [s.d. of z]; the first is that of the cloth that hangs still.
        trace: lowest distance promised at each period's end, after the starts and after each round,
            `[periods, rounds + 1]` [s.d. of z].
    """

    case: Case
    distance: np.ndarray
    trace: np.ndarray

    @property
    def best(self) -> np.ndarray:
        """Smallest distance in each period but the first [s.d. of z]: what the tables of control count."""
        return best_per_period(self.distance)

    @property
    def ends(self) -> np.ndarray:
        """Distance at the end of each period but the last [s.d. of z]: what the search looks at."""
        return self.distance[PERIOD::PERIOD]

    @property
    def median(self) -> float:
        """Median of `best` [s.d. of z]."""
        return float(np.median(self.best))

    @property
    def last_ten(self) -> float:
        """Median of the last ten of `best` [s.d. of z]."""
        return late_median(self.best)


@dataclass(frozen=True, eq=False)
class Speed:
    """The fastest motion found.

    Attributes:
        f_const: at which the stiffness command was held [N]; None: it was free.
        seed: of the search.
        peak: speed of the hand [m/s].
        trace: the same after the starts and after each round `[rounds + 1]` [m/s].
        commands: that do it, from rest at the arm's home `[N, 3]` [rad] [rad] [N].
    """

    f_const: float | None
    seed: int
    peak: float
    trace: np.ndarray
    commands: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each case.
        speeds: one for each seed and stiffness.
    """

    settings: Settings
    runs: tuple[Run, ...]
    speeds: tuple[Speed, ...]

    def case(self, target: str, cloth: str, f_const: float | None = None, *, remembers: bool = True) -> list[Run]:
        """The runs with a target and a cloth, one for each seed."""

        def asked(case: Case) -> bool:
            return (case.target, case.cloth, case.f_const, case.remembers) == (target, cloth, f_const, remembers)

        return [run for run in self.runs if asked(run.case)]

    def possible(self, target: str, cloth: str, f_const: float | None = None) -> float:
        """The yardstick of control: best distance a period, median of the last ten, mean over the seeds [s.d. of z]."""
        return float(np.mean([run.last_ten for run in self.case(target, cloth, f_const)]))

    def best_constant(self, target: str, cloth: str) -> float:
        """The f_const [N], of those at which it was held, that comes nearest."""
        return min(self.settings.tensions, key=lambda f_const: self.possible(target, cloth, f_const))

    def peak_speeds(self, f_const: float | None = None) -> np.ndarray:
        """Largest speed of the hand found with each seed, `[seeds]` [m/s]."""
        return np.array([each.peak for each in self.speeds if each.f_const == f_const])


def cases(settings: Settings) -> list[Case]:
    """All that is searched: on the muscle arm with free and with fixed stiffness, forgetful only where it is free."""
    free = [("torque", *pair) for pair in product(settings.targets, settings.cloths)]
    free += [("muscle", *pair) for pair in product(settings.foam_targets, settings.foams)]
    fixed = [(*each, f_const) for each in free if get_arm(each[0]).has_stiffness for f_const in settings.tensions]
    kept = [Case(*each, None, True, seed) for each, seed in product(free, settings.seeds)]
    kept += [Case(*each, True, seed) for each, seed in product(fixed, settings.seeds)]
    return kept + [Case(*each, None, False, seed) for each, seed in product(free, settings.forgetful_seeds)]


def search_trial(
    autoencoder: Autoencoder,
    arm: Arm | str,
    cloth: Cloth | str,
    target: ArrayLike,
    plans: ArrayLike,
    periods: int,
    *,
    f_const: float | None = None,
    search: SearchSettings | None = None,
    seed: int = 0,
) -> tuple[Trial, np.ndarray]:
    """Realise any target with any cloth, the simulator being known.

    Args:
        autoencoder: by whose z distances are measured.
        arm: the arm; it starts from its home, whatever `f_const` says.
        cloth: the cloth in its hand.
        target: mask `[H, W]`.
        plans: recorded stretches `[N, period, D_u]` to start from.
        periods: how many are run.
        f_const: at which the stiffness command is held [N].
        search: how much is tried in each period.
        seed: of the search.

    Returns:
        The run, and its promises `[periods, rounds + 1]`, as `SimulatorSearch.trace` has them.

    Raises:
        ValueError: a stiffness that the arm does not have, or a target or plans that do not fit.
    """
    env = ClothEnv(arm, cloth)
    limited = env.arm if f_const is None else env.arm.with_stiffness(f_const)
    policy = SimulatorSearch(env, autoencoder, target, plans, search, arm=limited)
    try:
        trial = rollout(env, policy, periods * policy.plans.shape[1], seed=seed)
    finally:
        policy.close()
        env.close()
    return trial, np.array(policy.trace)


def run_case(settings: Settings, case: Case) -> Run:
    """How near one case comes."""
    weights = {"torque": settings.weights, "muscle": settings.muscle_weights}
    autoencoder, _ = artifacts.load_autoencoder(weights[case.arm])
    target = artifacts.load_target(case.target)
    trial, trace = search_trial(
        autoencoder,
        case.arm,
        case.cloth,
        target,
        recorded_plans(artifacts.load_trials(RECORDINGS[case.arm]), PERIOD, POOL, seed=case.seed),
        settings.periods,
        f_const=case.f_const,
        search=settings.search if case.remembers else replace(settings.search, remembered=0),
        seed=case.seed,
    )
    return Run(case, target_distance(autoencoder, trial, target).round(4), trace.round(4))


def run_speeds(settings: Settings, seed: int) -> list[Speed]:
    """The fastest motions with f_const held at each tension, and with a free one.

    The free search starts from the fixed ones' best plans too: it may do all that they do.
    """
    arm, search = get_arm("muscle"), settings.speed_search
    home, env = ClothEnv(arm, settings.speed_foam), ClothEnv(arm, settings.speed_foam)

    def slowness(plans: np.ndarray) -> np.ndarray:
        peaks = []
        for plan in plans:
            copy_state(home, env)
            watch = MotionWatch(env)
            for u in plan:
                env.advance(u, watch, 50)
            peaks.append(watch.hand_speed.max())
        return -np.array(peaks)

    starts = recorded_plans(artifacts.load_trials(RECORDINGS["muscle"]), settings.speed_steps, search.starts, seed=seed)
    found, speeds = [starts], []
    for f_const in (*settings.tensions, None):
        limited = arm if f_const is None else arm.with_stiffness(f_const)
        lower, upper, rng = limited.command_lower, limited.command_upper, np.random.default_rng(seed)
        begin = np.concatenate(found) if f_const is None else starts
        plans, trace = cross_entropy(slowness, begin, lower, upper, search, rng=rng)
        found.append(plans)
        speeds.append(Speed(f_const, seed, -float(trace[-1]), -trace.round(4), plans[0].round(4)))
    return speeds


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """Every case and every seed."""
    settings = settings or Settings()
    jobs = [(settings, case) for case in cases(settings)]
    runs = run_jobs(run_case, jobs, workers=workers, progress=progress, what="limits")
    swings = [(settings, seed) for seed in settings.speed_seeds]
    speeds = run_jobs(run_speeds, swings, workers=workers, progress=progress, what="peak speed")
    return Record(settings, tuple(runs), tuple(speed for rows in speeds for speed in rows))
