"""Setting the table: is the whole run reliable, and does throwing the cloth beat laying it down slowly?

The cloth is spread by the throw that the model chooses, that throw improved by the gradient, a slow hand, and the best
recorded throw with this very cloth. All of them meet the same episodes, with the same rack and basket. And a study of
the border: how far away the table may be until slow laying stops working, and where throws still do.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np

from clothlab import artifacts
from clothlab._validation import Checked, choose, choose_all, setting
from clothlab.analysis import difference_interval, nearest_material
from clothlab.experiments._kept import piece
from clothlab.experiments._record import run_jobs, trained
from clothlab.learning.autoencoder import encode
from clothlab.learning.dpmpb import Sequences, to_sequences
from clothlab.learning.estimation import EstimatingPolicy, NewtonEstimator, NewtonSettings, estimate_bias
from clothlab.learning.trained import Trained
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import Arm
from clothlab.table_scene.scene import Furniture
from clothlab.table_scene.servoing import Mover, ReachSettings, lay_slowly
from clothlab.table_scene.table_env import TableEnv
from clothlab.table_scene.task import Episode, Outcome, Spreader, throw
from clothlab.table_scene.throwing import OperatorThrow, Swing, ThrowPolicy, ThrowSettings, laid_by_hand, was_spread
from clothlab.trials import rollout

ARM, THROWS = "muscle-hand", "table-throws"
FOLDER = Path("build") / "table_setting"  # where runs are kept, from the folder in which the experiment is run
DYNAMIC, DESCENT, SLOW_HAND, RECORDED = "dynamic", "descent", "slow", "best recorded"
REACH = ReachSettings()
THROW = ThrowSettings()


@dataclass(frozen=True)
class Settings(Checked):
    """What is run; the defaults are the full size."""

    weights: str = setting("table")
    models: tuple[int, ...] = setting((0, 1, 2, 3, 4), at_least=0)  # seeds of the trainings, episode by episode in turn
    methods: tuple[str, ...] = setting((DYNAMIC, DESCENT, SLOW_HAND, RECORDED))
    episodes: int = setting(50, at_least=1)
    first_seed: int = setting(500_000, at_least=0)
    foam: str = setting("hard-1")  # in the hand
    ahead: float = setting(0.66, "m", above=0)  # of the target, so near that the basket can be put on its middle
    noise: float = setting(0.002, "m", at_least=0)  # of the depth image at 1 m
    swing: int = setting(20, "step", at_least=12)  # of the motion that gets to know a cloth
    descent: int = setting(3, at_least=1)  # iterations, of the method that has one
    reach: ReachSettings = REACH
    throw: ThrowSettings = THROW
    foams: tuple[str, ...] = setting(("soft-1", "soft-2", "hard-1", "hard-3"))  # that are told apart
    guesses: int = setting(5, at_least=0)  # for each of them and each training
    # The border, in the hand from the start: how far the table's edge is ahead of the shoulder.
    border_foams: tuple[str, ...] = setting(("soft-1", "soft-2", "hard-1", "hard-3"))
    border: tuple[float, ...] = setting((0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.50), "m", above=0)
    margins: tuple[float, ...] = setting(tuple(round(0.09 + 0.005 * k, 3) for k in range(25)), "m", at_least=0)  # slow
    border_throws: int = setting(200, at_least=1)  # of an operator who knows nothing of where the table is
    choosing: int = setting(3, at_least=1)  # starts by which the best margin and the best throw are chosen,
    judging: int = setting(20, at_least=1)  # and others by which they are judged

    def __post_init__(self) -> None:
        """Refuse unknown methods and what leaves nothing to run."""
        super().__post_init__()
        choose_all("method", self.methods, METHODS)
        if not self.models or self.episodes % len(self.models):
            raise ValueError(
                f"Settings.episodes must be a multiple of the {len(self.models)} models, got {self.episodes}"
            )


@dataclass(frozen=True, eq=False)
class Run:
    """One episode.

    Attributes:
        method: who spreads the cloth.
        model: seed of the training.
        seed: of the episode.
        failed: phase that failed, one of `episode.PHASES`; empty where the robot noticed none.
        cause: why, in words.
        grasped: whether the cloth was.
        seen: whether the robot thought the cloth spread.
        spread: whether it was.
        flat: part of its points on the table; 0 where it did not get that far.
        area: that it covers, as a part of the flat cloth's; likewise.
        angle: of its length from straight ahead [degree]; likewise.
        placed: whether the basket was.
        tilt: of the basket from upright [degree]; None where it was not fetched.
        off_centre: from the basket's middle to the cloth's [m]; likewise.
        dragged: way of the cloth meanwhile [m]; likewise.
        foam: whose p is nearest to that estimated in the first swing; empty where it was not.
        bias: that p; empty likewise.
        expected: distance to the target that was expected when each attempt began [s.d. of z]; empty likewise.
        before_release: the same before the hand would have opened; empty likewise.
        steps: control steps.
    """

    method: str
    model: int
    seed: int
    failed: str
    cause: str
    grasped: bool
    seen: bool
    spread: bool
    flat: float
    area: float
    angle: float
    placed: bool
    tilt: float | None
    off_centre: float | None
    dragged: float | None
    foam: str
    bias: np.ndarray
    expected: np.ndarray
    before_release: np.ndarray
    steps: int

    @property
    def success(self) -> bool:
        """Whether the table was set: cloth spread, basket placed."""
        return self.spread and self.placed


@dataclass(frozen=True, eq=False)
class Guess:
    """Which foam it is, after the first swing.

    Attributes:
        foam: in the hand.
        model: seed of the training.
        seed: how long and where it was held before.
        nearest: the foam whose trained p is nearest to the estimate.
        bias: the estimate.
    """

    foam: str
    model: int
    seed: int
    nearest: str
    bias: np.ndarray


@dataclass(frozen=True, eq=False)
class Border:
    """What spreads a cloth on a table so far away.

    Attributes:
        foam: in the hand.
        near: from the shoulder to the table's edge [m].
        slow: from which of the first starts slow laying did, with each of the margins `[margins, choosing]`, bool.
        thrown: whether each of an operator's throws did, from the very first start `[border_throws]`, bool.
        best_slow: from which of the other starts the best of these margins did `[judging]`, bool.
        best_thrown: the same of the best of these throws; nowhere if none worked.
    """

    foam: str
    near: float
    slow: np.ndarray
    thrown: np.ndarray
    best_slow: np.ndarray
    best_thrown: np.ndarray


@dataclass(frozen=True, eq=False)
class Record:
    """What was found.

    Attributes:
        settings: of the experiment.
        runs: one for each method and episode.
        guesses: some for each training and foam.
        border: one for each foam and place of the table.
    """

    settings: Settings
    runs: tuple[Run, ...]
    guesses: tuple[Guess, ...]
    border: tuple[Border, ...]

    def select(self, method: str) -> list[Run]:
        """The episodes of a method."""
        return [run for run in self.runs if run.method == method]

    def rate(self, what: str, method: str = DYNAMIC, given: str = "") -> float:
        """Part of a method's episodes of which something holds; of those alone of which `given` holds.

        Args:
            what: a yes-or-no attribute of `Run`, such as `"grasped"`, `"spread"`, `"placed"`, `"success"`.
            method: which.
            given: another of them.
        """
        runs = [run for run in self.select(method) if not given or getattr(run, given)]
        return float(np.mean([getattr(run, what) for run in runs])) if runs else float("nan")

    def difference(self, first: str, second: str, what: str = "spread") -> tuple[float, float, float]:
        """How much more often something holds with one method than with another: mean, 95 % interval."""

        def held(method: str) -> np.ndarray:
            runs = self.select(method)
            return np.array([[getattr(run, what) for run in runs if run.model == k] for k in self.settings.models])

        return difference_interval(held(first).astype(float) - held(second).astype(float))

    def failures(self, method: str) -> dict[tuple[str, str], int]:
        """How often a method's episodes failed in each phase for each cause, the most frequent first.

        What the robot did not notice has its phase too: the cloth was not spread after all, the basket not placed.
        """
        found = Counter(_failure(run) for run in self.select(method) if not run.success)
        return dict(found.most_common())


def _failure(run: Run) -> tuple[str, str]:
    if run.failed:
        return run.failed, run.cause
    return ("look", "taken for spread") if not run.spread else ("put basket", "not noticed")


@dataclass(frozen=True, eq=False)
class _Notes:
    """What a spreader knows beside the outcome."""

    foam: str = ""
    bias: tuple[float, ...] = ()
    expected: tuple[float, ...] = ()
    before_release: tuple[float, ...] = ()


Method = Callable[[Settings, Trained, Mover], _Notes]


@cache
def good_throws(weights: str) -> tuple[Sequences, ...]:
    """Recorded throws that spread a foam as far as was seen, and their repetitions, as the models of these weights see.

    Those of one throw have the same commands.
    """
    autoencoder, trials = trained(weights).autoencoder, artifacts.load_trials(THROWS)
    good = {(trial.cloth.name, trial.commands.tobytes()) for trial in trials if was_spread(trial)}
    chosen = [trial for trial in trials if (trial.cloth.name, trial.commands.tobytes()) in good]
    return tuple(to_sequences(autoencoder, trial) for trial in chosen)


@cache
def target(foam: str, ahead: float) -> np.ndarray:
    """Mask of the foam as it should lie, laid by hand."""
    with closing(TableEnv(ARM, foam, start_in="hand")) as env:
        return laid_by_hand(env, ahead)


def get_to_know(learned: Trained, mover: Mover, steps: int) -> np.ndarray:
    """Swing the cloth in the hand for some control steps, and estimate its p, `[D_p]`."""
    estimator = NewtonEstimator(learned.model, np.zeros(learned.model.bias_size))
    policy = EstimatingPolicy(Swing(mover.env.arm), estimator, learned.autoencoder)
    throw(mover, policy, steps)
    return policy.trace[-1]


def thrower(settings: Settings, learned: Trained, arm: Arm, bias: np.ndarray) -> ThrowPolicy:
    """Throws the foam whose p is nearest to an estimate `[D_p]`, with an arm whose home is where the scene begins.

    With the trained p, not the estimate: what the model misses in throws is known for that one.
    """
    foam, mask = nearest_material(bias, learned.biases), target(settings.foam, settings.ahead)
    return ThrowPolicy(
        learned.model,
        learned.autoencoder,
        arm,
        mask,
        learned.biases[foam],
        good_throws(learned.name),
        learned.biases,
        settings.throw,
    )


def _dynamic(settings: Settings, learned: Trained, mover: Mover) -> _Notes:
    """Swing the cloth to find p, then throw as the model says."""
    bias = get_to_know(learned, mover, settings.swing)
    policy = thrower(settings, learned, mover.env.arm, bias)
    throw(mover, policy, done=lambda: policy.done)
    return _Notes(
        nearest_material(bias, learned.biases),
        tuple(map(float, bias.round(4))),
        tuple(round(each.expected, 4) for each in policy.attempts),
        tuple(round(each.before_release, 4) for each in policy.attempts),
    )


def _descent(settings: Settings, learned: Trained, mover: Mover) -> _Notes:
    return _dynamic(replace(settings, throw=replace(settings.throw, iterations=settings.descent)), learned, mover)


def _slow(settings: Settings, learned: Trained, mover: Mover) -> _Notes:
    lay_slowly(mover)
    return _Notes()


def best_recorded(settings: Settings, learned: Trained) -> np.ndarray:
    """Commands `[T, D_u]` of the recorded throw after which this foam lay nearest to the target, mean of its trials.

    Raises:
        ValueError: none of them spread this foam.
    """
    steps, away = settings.throw.steps, dict[bytes, list[float]]()
    runs = {run.u.tobytes(): run for run in good_throws(learned.name) if run.material == settings.foam}
    if not runs:
        raise ValueError(f"no recorded throw spread {settings.foam}")
    z_ref = encode(learned.autoencoder, target(settings.foam, settings.ahead))
    for run in good_throws(learned.name):
        if run.material == settings.foam:
            away.setdefault(run.u.tobytes(), []).append(float(np.linalg.norm(run.s[steps, : len(z_ref)] - z_ref)))
    return runs[min(away, key=lambda u: np.mean(away[u]))].u[:steps].astype(np.float64)


def _recorded(settings: Settings, learned: Trained, mover: Mover) -> _Notes:
    commands = best_recorded(settings, learned)
    throw(mover, ReplayPolicy(commands), len(commands))
    return _Notes()


METHODS: dict[str, Method] = {DYNAMIC: _dynamic, DESCENT: _descent, SLOW_HAND: _slow, RECORDED: _recorded}


def play(
    settings: Settings,
    spreader: Spreader,
    seed: int,
    *,
    watch: Callable[[TableEnv], None] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Outcome:
    """One episode with whoever spreads the cloth.

    Args:
        settings: foam, noise, how the hand reaches.
        spreader: spreads the cloth.
        seed: where rack and basket stand, and the camera's noise.
        watch: told the scene after each control period. What it raises ends the episode: so can a person.
        progress: told the name of each phase as it begins.
    """
    with closing(TableEnv(ARM, settings.foam)) as env:
        env.start(seed=seed)
        mover = Mover(
            env,
            replace(settings.reach, noise=settings.noise),
            watch=None if watch is None else partial(watch, env),
            samples=1,
            rng=np.random.default_rng(seed),
        )
        return Episode(mover, spreader, progress).run()


def run_one(settings: Settings, method: str, model: int, seed: int) -> Run:
    """One episode with one method."""
    spread_it = choose("method", method, METHODS)
    learned, notes = trained(f"{settings.weights}-{model}"), _Notes()

    def spreader(mover: Mover) -> None:
        nonlocal notes
        notes = spread_it(settings, learned, mover)

    return as_run(method, model, seed, play(settings, spreader, seed), notes)


def as_run(method: str, model: int, seed: int, outcome: Outcome, notes: _Notes) -> Run:
    """What is kept of an episode."""
    lies, stands = outcome.spread, outcome.placement
    return Run(
        method=method,
        model=model,
        seed=seed,
        failed=outcome.failed,
        cause=outcome.cause,
        grasped=outcome.grasped,
        seen=outcome.seen is not None,
        spread=outcome.spread_out,
        flat=round(lies.flat, 3) if lies else 0.0,
        area=round(lies.area, 3) if lies else 0.0,
        angle=round(lies.angle, 1) if lies else 0.0,
        placed=outcome.placed,
        tilt=round(stands.tilt, 2) if stands else None,
        off_centre=round(stands.off_centre, 4) if stands else None,
        dragged=round(outcome.dragged, 4) if outcome.dragged is not None else None,
        foam=notes.foam,
        bias=np.array(notes.bias),
        expected=np.array(notes.expected),
        before_release=np.array(notes.before_release),
        steps=outcome.steps,
    )


def run_guess(settings: Settings, foam: str, model: int, seed: int) -> Guess:
    """Swing a foam that starts in the hand, and estimate p."""
    learned = trained(f"{settings.weights}-{model}")
    with closing(TableEnv(ARM, foam, start_in="hand")) as env:
        trial = rollout(env, Swing(env.arm), settings.swing, seed=seed)
    p, _ = estimate_bias(learned.model, learned.sequences(trial), settings=NewtonSettings())
    return Guess(foam, model, seed, nearest_material(p, learned.biases), p.round(4))


def run_border(settings: Settings, foam: str, near: float) -> Border:
    """Slow laying and an operator's throws, each the best of many, with the table so far away: no model, no camera."""
    with closing(TableEnv(ARM, foam, start_in="hand", furniture=replace(Furniture(), near=near))) as env:

        def spreads(attempt: Callable[[], None], start: int) -> bool:
            env.start(seed=settings.first_seed + start)
            attempt()
            u = env.arm.home_command
            u[env.arm.closed_command] = 0.0
            for _ in range(8):
                env.advance(u)
            return env.lies().success

        def throws(number: int) -> None:
            operator = OperatorThrow(env.arm)
            operator.reset(settings.first_seed + number)
            for _ in range(settings.throw.steps):
                env.advance(operator({}))

        def lays(margin: float) -> None:
            lay_slowly(Mover(env, samples=1), margin=margin)

        def from_starts(attempt: Callable[[], None], starts: range) -> np.ndarray:
            return np.array([spreads(attempt, start) for start in starts])

        choosing = range(settings.choosing)
        judging = range(settings.choosing, settings.choosing + settings.judging)
        slow = np.array([from_starts(partial(lays, margin), choosing) for margin in settings.margins])
        best_slow = from_starts(partial(lays, settings.margins[middle_of_best(slow)]), judging)
        thrown = np.array([spreads(partial(throws, number), 0) for number in range(settings.border_throws)])
        best_thrown = np.zeros(settings.judging, bool)
        if thrown.any():
            worked = np.flatnonzero(thrown).tolist()
            again = np.array([from_starts(partial(throws, number), choosing) for number in worked])
            best_thrown = from_starts(partial(throws, worked[middle_of_best(again)]), judging)
    return Border(foam, near, slow, thrown, best_slow, best_thrown)


def middle_of_best(worked: np.ndarray) -> int:
    """Which one worked most often `[N, starts]`; of several, the middle one: its neighbours are good, too."""
    (best,) = np.nonzero(worked.sum(axis=1) == worked.sum(axis=1).max())
    return int(best[len(best) // 2])


def run(
    settings: Settings | None = None, *, workers: int = 1, progress: bool = False, folder: str | Path = FOLDER
) -> Record:
    """All episodes with all methods, and the border.

    Args:
        settings: what is run.
        workers: processes.
        progress: show a progress bar.
        folder: where each run is kept as soon as it is done; an interrupted experiment goes on from there.
    """
    settings, folder = settings or Settings(), Path(folder)
    models = settings.models
    episodes = [(models[k % len(models)], settings.first_seed + k) for k in range(settings.episodes)]
    todo = [(folder, settings, method, *each) for each, method in product(episodes, settings.methods)]
    runs = run_jobs(_kept_run, todo, workers=workers, progress=progress, what="episodes")
    swung = product(settings.foams, models, range(settings.first_seed, settings.first_seed + settings.guesses))
    guesses = run_jobs(run_guess, [(settings, *each) for each in swung], workers=workers, progress=progress, what="p")
    places = [(folder, settings, *each) for each in product(settings.border_foams, settings.border)]
    border = run_jobs(_kept_border, places, workers=workers, progress=progress, what="border")
    return Record(settings, tuple(runs), tuple(guesses), tuple(border))


def _kept_run(folder: Path, settings: Settings, method: str, model: int, seed: int) -> Run:
    made_with = {
        "weights": settings.weights,
        "foam": settings.foam,
        "ahead": settings.ahead,
        "noise": settings.noise,
        "reach": asdict(settings.reach),
        "throw": asdict(settings.throw),
        "swing": settings.swing,
        "descent": settings.descent,
    }
    return piece((method, model, seed), made_with, lambda: run_one(settings, method, model, seed), Run, folder)


def _kept_border(folder: Path, settings: Settings, foam: str, near: float) -> Border:
    made_with = {
        "margins": settings.margins,
        "throws": settings.border_throws,
        "choosing": settings.choosing,
        "judging": settings.judging,
        "steps": settings.throw.steps,
        "first_seed": settings.first_seed,
    }
    about = ("border", foam, round(100 * near))
    return piece(about, made_with, lambda: run_border(settings, foam, near), Border, folder)
