"""Stiff when it helps: the paper's section "Actual Robot Experiment", on the simulated muscle arm with foams."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab import artifacts
from clothlab._validation import Checked, setting
from clothlab.analysis import (
    best_per_period,
    bias_error,
    empty_distance,
    nearest_material,
    principal_axes,
    success_rate,
    target_distance,
)
from clothlab.experiments._record import (
    RECORDINGS,
    estimate_at_random,
    interleaved,
    new_trial,
    random_trial,
    run_jobs,
    trained,
)
from clothlab.learning.control import recorded_plans
from clothlab.learning.estimation import estimate_bias
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.stiffness import ellipse_area, stiffness_ellipse
from clothlab.trials import Trial, replay

ARM = MuscleArm()
SPRINGS = {  # the second is as stiff as the first at about 30 N
    "nonlinear": ARM,
    "linear": replace(ARM, spring_linear=5000.0, spring_cubic=0.0),
}
CORRECT, WRONG, FIXED, WARM, RANDOM = (
    "Correct",
    "Wrong",
    "Correct w/o stiffness",
    "Correct, warm start only",  # the others also try recorded commands at the start of each period
    "Random",
)
CONDITIONS = (CORRECT, WRONG, FIXED, WARM, RANDOM)
PAPERS = (CORRECT, WRONG, FIXED, RANDOM)  # those of them that the paper has
QUANTITIES: dict[
    str, tuple[Callable, int]
] = {  # the paper's three, and the sign that it reports for Correct minus others
    "rate below 0.5": (lambda run: run.rate, 1),
    "minimum distance": (lambda run: run.distance.min(), -1),
    "maximum distance": (lambda run: run.distance.max(), 1),
}
VARIANTS: dict[str, dict[str, Any]] = {  # what the hand's speed may depend on, and the paper does not publish
    "as assumed": {},
    "motor speed 0.05 m/s": {"motor_speed": 0.05},
    "motor speed 0.20 m/s": {"motor_speed": 0.20},
    "hinge damping 0.5 N m s/rad": {"hinge_damping": 0.5},
    "hinge damping 2 N m s/rad": {"hinge_damping": 2.0},
}


@dataclass(frozen=True)
class Settings(Checked):
    """Which cases; the defaults are the full size."""

    weights: str = setting("muscle")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings
    posture: tuple[float, float] = setting((0.0, -np.pi / 2), "rad")  # of the ellipses: elbow at 90°, as in the paper
    tensions: tuple[float, ...] = setting((10.0, 30.0, 50.0, 70.0), "N", above=0)  # of the ellipses
    trials: str = setting("muscle-evaluation")  # recorded, never trained on
    estimated: tuple[str, ...] = setting(("hard-1", "hard-2", "hard-3"))  # first and last are the ends of the scale
    estimation_steps: int = setting(150, "step", at_least=12)  # 30 s
    estimation_seed: int = setting(16000, at_least=0)  # of the commands: this + 100 model + number of the foam
    conditions: tuple[str, ...] = setting(CONDITIONS)
    cloths: tuple[str, ...] = setting(("hard-1", "soft-1"))  # each is the wrong one for the other
    control_steps: int = setting(125, "step", at_least=16)  # 25 s
    speed_steps: int = setting(100, "step", at_least=1)  # 20 s, in which the hand's peak speed is looked for
    random_seed: int = setting(17000, at_least=0)  # of random commands: this + model
    fixed_tension: float = setting(10.0, "N", above=0)  # the paper's "w/o stiffness"
    threshold: float = setting(0.5, "s.d. of z", above=0)  # of the rate, the paper's


@dataclass(frozen=True, eq=False)
class Ellipse:
    """One stiffness ellipse.

    Attributes:
        spring: which springs, of `SPRINGS`.
        f_const: co-contraction [N].
        area: [m²] for a push of 1 N.
        semi_axes: longest first `[2]` [m].
    """

    spring: str
    f_const: float
    area: float
    semi_axes: np.ndarray


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The estimate from a recorded trial that the training has not seen.

    Attributes:
        model: seed of the training.
        cloth: name of the foam.
        policy: who moved it.
        nearest: the foam whose trained p is nearest in the end.
        distance: to the right p [spreads of the trained p].
    """

    model: int
    cloth: str
    policy: str
    nearest: str
    distance: float


@dataclass(frozen=True, eq=False)
class Estimation:
    """The estimate of a foam that is moved at random, from p = 0.

    Attributes:
        cloth: name of the foam.
        model: seed of the training.
        trace: p after each step `[T, D_p]`.
        place: where the last one lies from the first trained foam of `Settings.estimated` (0) to the last (1).
    """

    cloth: str
    model: int
    trace: np.ndarray
    place: float


@dataclass(frozen=True, eq=False)
class Control:
    """One run under one condition.

    Attributes:
        condition: one of `CONDITIONS`.
        cloth: name of the foam in the hand.
        model: seed of the training.
        empty: distance of an image without cloth [s.d. of z].
        distance: to the target at each step `[T]` [s.d. of z]; the first is that of the foam hanging still.
        rate: share of steps nearer than the threshold.
        peak_hand_speed: for each of `VARIANTS` [m/s]; empty for the conditions whose speed nobody asks for.
        commands: as sent `[T, 3]` [rad] [rad] [N]; of model 0.
        theta: joint angles ten times a step `[10 T, 2]` [rad]; of model 0.
    """

    condition: str
    cloth: str
    model: int
    empty: float
    distance: np.ndarray
    rate: float
    peak_hand_speed: dict[str, float]
    commands: np.ndarray
    theta: np.ndarray

    @property
    def best(self) -> np.ndarray:
        """Smallest distance in each period but the first [s.d. of z]."""
        return best_per_period(self.distance)


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        ellipses: one for each kind of spring and tension.
        pca_share: share of the variance of p along PC1 and PC2, `[models, 2]`.
        held_out: one for each training and recorded trial.
        estimation: one for each foam and training.
        control: one for each condition, foam and training.
    """

    settings: Settings
    ellipses: tuple[Ellipse, ...]
    pca_share: np.ndarray
    held_out: tuple[HeldOut, ...]
    estimation: tuple[Estimation, ...]
    control: tuple[Control, ...]

    def case(self, condition: str, cloth: str) -> list[Control]:
        """The runs of a condition with a foam, one for each training."""
        return [run for run in self.control if (run.condition, run.cloth) == (condition, cloth)]

    def estimates(self, model: int) -> dict[str, np.ndarray]:
        """p over time of each foam that was estimated by one training, from p = 0 on `[T + 1, D_p]`, by a label."""
        paths = {
            f"estimate of {get_cloth(each.cloth).label}": each.trace for each in self.estimation if each.model == model
        }
        return {label: np.vstack([np.zeros(path.shape[1]), path]) for label, path in paths.items()}

    def rates(self, thresholds: ArrayLike, conditions: Iterable[str] = PAPERS) -> dict[str, dict[str, np.ndarray]]:
        """Share of steps nearer than each threshold `[N]` [s.d. of z], by foam's label and condition, `[models, N]`."""
        return {
            get_cloth(cloth).label: {
                name: np.array([success_rate(run.distance, thresholds) for run in self.case(name, cloth)])
                for name in conditions
            }
            for cloth in self.settings.cloths
        }

    def gap(self, measure: Callable[[Control], float], cloth: str, other: str) -> np.ndarray:
        """A figure of a run under Correct minus that under another condition, for each training `[models]`."""
        pairs = zip(self.case(CORRECT, cloth), self.case(other, cloth), strict=True)
        return np.array([measure(a) - measure(b) for a, b in pairs])

    def speed_gains(self) -> np.ndarray:
        """Peak hand speed with optimised stiffness over that without, minus one, `[foams, models, variants]`."""
        peaks = [
            [[[*run.peak_hand_speed.values()] for run in self.case(name, cloth)] for cloth in self.settings.cloths]
            for name in (CORRECT, FIXED)
        ]
        return np.divide(*np.array(peaks)) - 1

    def area(self, spring: str, f_const: float) -> float:
        """Area of a stiffness ellipse [m²]."""
        return next(each.area for each in self.ellipses if (each.spring, each.f_const) == (spring, f_const))


def run_ellipse(settings: Settings, spring: str, f_const: float) -> Ellipse:
    """Push the hand from all sides."""
    displacements = stiffness_ellipse(SPRINGS[spring], settings.posture, f_const)
    axes = np.linalg.svd(displacements, compute_uv=False) * np.sqrt(2 / len(displacements))
    return Ellipse(spring, f_const, ellipse_area(displacements), axes)


def run_share(settings: Settings, model: int) -> np.ndarray:
    """Share of the variance of p along PC1 and PC2 in one training, `[2]`."""
    return principal_axes(trained(f"{settings.weights}-{model}").biases).explained_variance_ratio_


def run_held_out(settings: Settings, model: int, number: int) -> HeldOut:
    """Estimate p from one of the recorded trials that the training has not seen, by its number."""
    learned, trial = trained(f"{settings.weights}-{model}"), artifacts.load_trials(settings.trials)[number]
    p, _ = estimate_bias(learned.model, learned.sequences(trial))
    name, nearest = trial.cloth.name, nearest_material(p, learned.biases)
    return HeldOut(model, name, trial.policy, nearest, bias_error(p, name, learned.biases))


def run_estimation(settings: Settings, cloth: str, model: int) -> Estimation:
    """Estimate p of a foam from 0 while it is moved at random."""
    learned = trained(f"{settings.weights}-{model}")
    seed = settings.estimation_seed + 100 * model + settings.estimated.index(cloth)
    p, trace = estimate_at_random(learned, cloth, settings.estimation_steps, seed)
    first, last = (learned.biases[settings.estimated[end]] for end in (0, -1))
    place = float((p - first) @ (last - first) / ((last - first) @ (last - first)))
    return Estimation(cloth, model, trace.round(4), place)


def run_control(settings: Settings, condition: str, cloth: str, model: int) -> Control:
    """Distances to the target, commands, and the arm's motion under one of the paper's conditions."""
    learned, mask = trained(f"{settings.weights}-{model}"), artifacts.load_target("muscle")
    if condition == RANDOM:
        trial = random_trial(learned.arm.name, cloth, settings.control_steps, settings.random_seed + model)
    else:
        trial = _controlled(settings, condition, cloth, model, mask)
    distance = target_distance(learned.autoencoder, trial, mask)
    asked = VARIANTS if condition in (CORRECT, FIXED, WARM) else {}
    peaks = {
        name: float(replay(trial[: settings.speed_steps], arm=replace(ARM, **change)).hand_speed.max())
        for name, change in asked.items()
    }
    keep = slice(None) if model == 0 else slice(0)
    theta = replay(trial[keep], samples=10).theta if model == 0 else np.empty((0, 2))
    return Control(
        condition=condition,
        cloth=cloth,
        model=model,
        empty=empty_distance(learned.autoencoder, mask),
        distance=distance.round(4),
        rate=float(success_rate(distance, [settings.threshold])[0]),
        peak_hand_speed=peaks,
        commands=trial.commands[keep].round(4),
        theta=theta.round(4),
    )


def _controlled(settings: Settings, condition: str, cloth: str, model: int, mask: np.ndarray) -> Trial:
    learned = trained(f"{settings.weights}-{model}")
    other = next(each for each in settings.cloths if each != cloth)
    plans = None if condition == WARM else recorded_plans(artifacts.load_trials(RECORDINGS["muscle"]), seed=model)
    arm = learned.arm.with_stiffness(settings.fixed_tension) if condition == FIXED else learned.arm
    policy = learned.controller(mask, other if condition == WRONG else cloth, plans=plans, arm=arm)
    return new_trial(policy, learned.arm, cloth, settings.control_steps, model)


def run(settings: Settings | None = None, *, workers: int = 1, progress: bool = False) -> Record:
    """Everything, several at once."""
    settings = settings or Settings()
    options: dict[str, Any] = {"workers": workers, "progress": progress}
    cases = [(settings, *each) for each in product(settings.conditions, settings.cloths, settings.models)]
    foams = [(settings, *each) for each in product(settings.estimated, settings.models)]
    pushes = [(settings, *each) for each in product(SPRINGS, settings.tensions)]
    recorded = [
        (settings, *each) for each in product(settings.models, range(len(artifacts.load_trials(settings.trials))))
    ]
    return Record(
        settings=settings,
        ellipses=tuple(run_jobs(run_ellipse, pushes, what="ellipses", **options)),
        pca_share=np.array([run_share(settings, k) for k in settings.models]),
        held_out=tuple(run_jobs(run_held_out, recorded, what="held-out foams", **options)),
        estimation=tuple(run_jobs(run_estimation, foams, what="foams", **options)),
        control=tuple(run_jobs(run_control, cases, what="control of foams", **options)),
    )


def merged(settings: Settings, records: Sequence[Record]) -> Record:
    """One record from those of single trainings, in the order of `settings`, as `run` finds it for all of them."""
    return Record(
        settings=settings,
        ellipses=records[0].ellipses,
        pca_share=np.concatenate([each.pca_share for each in records]),
        held_out=tuple(found for each in records for found in each.held_out),
        estimation=interleaved([each.estimation for each in records]),
        control=interleaved([each.control for each in records]),
    )
