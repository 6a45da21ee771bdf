"""A real drone in wind: is the wind found in p, and what is p worth there?

The flights are those of `neural_fly`: four constant winds, each flown by five
controllers. The wind is what stays the same within a flight
and differs between flights, and no sensor shows it by itself. A training is told which
flights had the same wind, and nothing else.

Every test is with a controller whose flights no training saw. Flights of one
controller, `DEVELOPMENT`, were used to choose settings; they are among the recordings
of every training, and no table is about them. All flights are 50 s, ten steps a second.

**A rival.** Wind tilts a drone that holds its place. So beside each estimate stands the
plainest one, the mean tilt of the same seconds (`by_tilt`).

**The table of predictions.** `drone_prediction` has p beside more rivals (`METHODS`):
another wind's p, being told the wind, p that was trained on windows of 10 s, networks
without p, an encoder of 10 s, a last layer fitted to the flight as Neural-Fly does with
its own, a hover model with a constant residual force, without drag and with it, and a
velocity that stays as it is. After a pause, the memory of a network without p is empty,
or kept from what is known, as in one that was trained to go on with such a memory
(rehearsed). All that is known of a flight comes from its first 25 s. Predictions begin
in the second half, from one state, the commands that were sent, and the last seconds of
the flight (`HISTORY`), which fill the memory. The table is read here, and was made by
the code of commit 97b3ae0d.

**Written before the tables were made.** The unit is a controller: there are four, each
with flights and trainings of its own. A figure is the mean over its four winds and its
trainings, which differ in their seed; the 95 % interval is Student's over controllers
(`crossed_interval` of one column), and so about other controllers in these winds. The
four are not independent: any two trainings share three quarters of their flights. The
measure of a prediction is the root mean square error of velocity after 1 s, the margin
0.05 m/s: p is worth nothing over a rival if the whole interval of the difference lies
within it. The wind is found where its trained p is the nearest of four.

**Development.** The amounts of training were chosen by the error of velocity after 1 s,
the mean of four winds and of two histories, 2 s and none.

**Written afterwards.** The measure of a prediction was chosen after a first look, in
which a model without p had led by the error of all states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from clothlab.analysis import nearest_material
from clothlab.method.data import Run, windows
from clothlab.method.estimation import NewtonSettings, estimate_bias
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from studies._grid import Case, Experiment, grid, shared
from studies.neural_fly import CONTROLLERS, STEP, WINDS, load_flight

DEVELOPMENT = "L1"  # its flights are among those of every training
TESTED = tuple(name for name in CONTROLLERS if name != DEVELOPMENT)
TRAINING = ModelTraining(epochs=1, batch_size=50, stride=5, sequence_length=30)
UPDATES = 1200  # of each training: what served it best in the development
MARGIN = 0.05  # [m/s], written down beforehand
WINDOW = 100  # steps from which p is estimated, longer than a loop of the figure
SEEDS = range(5)  # of the trainings without each controller
MISNAMED = ("NF-C", "NF")  # without which trainings get wrong names, as a control
_SECOND = 10  # steps
_TILT = slice(3, 5)
# With what is predicted in the table `drone_prediction`
ESTIMATED = "estimated p"
LONG_MEMORY = "long memory"
KEPT = "long memory, kept"
REHEARSED = "kept memory, rehearsed"
RIGHT = "right wind's p"
FARTHEST = "farthest p"
TOLD = "wind told"
NO_P = "no p"
CONTEXT = "context encoder"
LAST_LAYER = "last layer"
LONG_P = "p, windows of 10 s"
HOVER = "hover model"
DRAG = "hover model with drag"
STAYS = "velocity stays"
METHODS: tuple[str, ...] = (
    ESTIMATED,
    RIGHT,
    FARTHEST,
    TOLD,
    NO_P,
    LONG_MEMORY,
    CONTEXT,
    LAST_LAYER,
)
METHODS += (LONG_P, KEPT, REHEARSED, HOVER, DRAG, STAYS)
HORIZONS = (1, 3, 5, 10, 20, 30)  # steps
HISTORY = (0, 2, 5, 10, 20, 50, 200)  # steps that fill the memory


# The trainings


class Trained(NamedTuple):
    """What one training gives."""

    model: DPMPB
    biases: dict[str, np.ndarray]  # of each recorded wind [D_p]


@dataclass(frozen=True)
class Recordings:
    """Which flights a training sees."""

    controllers: tuple[str, ...]
    # Whether flights are said to have other winds, others for each controller
    shuffled: bool = False

    def runs(self) -> list[Run]:
        """The flights, each named by its wind."""
        found = []
        for k, controller in enumerate(self.controllers):
            names = list(WINDS)
            if self.shuffled:
                # One place further for each: a name is that of all winds alike
                names = [*names[k:], *names[:k]]
            for wind, name in zip(WINDS, names, strict=True):
                run = load_flight(controller, wind)
                found.append(replace(run, material=name))
        return found


def without(controller: str, *, shuffled: bool = False) -> Recordings:
    """All flights but those of a controller."""
    controllers = tuple(name for name in CONTROLLERS if name != controller)
    return Recordings(controllers, shuffled)


@shared
def train(recordings: Recordings, seed: int) -> Trained:
    """Train a model with p on some flights.

    Args:
        recordings: which flights.
        seed: of the first weights, and of the order of what is seen.
    """
    runs = recordings.runs()
    settings = _with_updates(TRAINING, runs, UPDATES)
    model, biases, _ = train_dpmpb(runs, settings, seed=seed, progress=False)
    return Trained(model.requires_grad_(False), biases)


def _with_updates(
    settings: ModelTraining, runs: Sequence[Run], updates: int
) -> ModelTraining:
    """The same settings, with as many epochs as make so many updates."""
    s, _, _ = windows(runs, settings.sequence_length, settings.stride)
    batches = -(-len(s) // settings.batch_size)
    return replace(settings, epochs=max(1, round(updates / batches)))


# The estimate


def _estimated(learned: Trained, run: Run, window: int) -> np.ndarray:
    """p after each step `[T, D_p]`, from zero."""
    settings = NewtonSettings(window=window)
    _, path = estimate_bias(learned.model, run, method="newton", settings=settings)
    return path


@cache
def _mean_tilts(recordings: Recordings) -> dict[str, np.ndarray]:
    """Mean tilt `[2]` of each wind in some recordings."""
    found: dict[str, list[np.ndarray]] = {}
    for run in recordings.runs():
        found.setdefault(run.material, []).append(run.s[:, _TILT].mean(axis=0))
    return {name: np.mean(each, axis=0) for name, each in found.items()}


def _tilts(run: Run, window: int) -> np.ndarray:
    """Mean tilt of the last steps, at each step `[T, 2]`."""
    tilt = run.s[:, _TILT]
    steps = range(1, len(run) + 1)
    return np.stack([tilt[max(0, t - window) : t].mean(axis=0) for t in steps])


def _seconds_until_right(
    path: np.ndarray, known: Mapping[str, np.ndarray], wind: str
) -> float:
    """From when on the right wind is the nearest until the end [s]; NaN if never."""
    right = np.array([nearest_material(p, dict(known)) == wind for p in path])
    if not right[-1]:
        return float("nan")
    wrong = np.flatnonzero(~right)
    return float(STEP * (wrong[-1] + 1)) if len(wrong) else 0.0


def _ordered(known: Mapping[str, np.ndarray]) -> np.ndarray:
    """What is known of each wind, from the weakest to the strongest `[K, D]`."""
    return np.stack([known[name] for name in WINDS])


def _estimate(
    controller: str, wind: str, seed: int, shuffled: bool = False
) -> dict[str, Any]:
    """Estimate p of a flight in constant wind, from zero, by trainings without it.

    Args:
        controller: whose flights no training saw.
        wind: of the flight.
        seed: of the training.
        shuffled: whether flights had wrong names in the training.
    """
    recordings = without(controller, shuffled=shuffled)
    learned = train(recordings, seed)
    run = load_flight(controller, wind)
    path = _estimated(learned, run, WINDOW)

    # The same by the mean tilt of the same seconds
    known = _mean_tilts(recordings)
    tilts = _tilts(run, WINDOW)
    return {
        "biases": _ordered(learned.biases),
        "p": path[-1],
        "nearest": nearest_material(path[-1], learned.biases),
        "seconds": _seconds_until_right(path, learned.biases, wind),
        "path": path[_SECOND - 1 :: _SECOND].round(4),
        "nearest_by_tilt": nearest_material(tilts[-1], known),
        "seconds_by_tilt": _seconds_until_right(tilts, known, wind),
    }


# The map


def visiting_order(points: np.ndarray, closed: bool = False) -> tuple[int, ...]:
    """The order in which the shortest way, or round, visits all points `[K, D]`.

    A way and its reverse are the same: the one that begins at the lower number is
    returned. A round begins at 0, and goes on with the lower of its two neighbours.
    """
    orders = []
    for order in permutations(range(len(points))):
        ends = (order[1], order[-1]) if closed else (order[0], order[-1])
        if ends[0] < ends[1] and (order[0] == 0 or not closed):
            orders.append(order)
    lengths = []
    for order in orders:
        visited = points[[*order, order[0]] if closed else [*order]]
        lengths.append(np.linalg.norm(np.diff(visited, axis=0), axis=1).sum())
    return orders[int(np.argmin(lengths))]


def wind_read_from(path: np.ndarray, biases: Mapping[str, np.ndarray]) -> np.ndarray:
    """The wind that each p says `[T]` [m/s]: the place on the line through trained p.

    It is the nearest point on the line that joins the p of neighbouring winds, which
    goes on straight at its ends.
    """
    points = _ordered(biases)
    speeds = [*WINDS.values()]
    best = np.full(len(path), np.inf)
    found = np.zeros(len(path))
    last = len(points) - 2
    for k in range(last + 1):
        # Where on this piece, or beyond it at the ends of the line
        way = points[k + 1] - points[k]
        place = (path - points[k]) @ way / (way @ way)
        low = -np.inf if k == 0 else 0.0
        high = np.inf if k == last else 1.0
        place = np.clip(place, low, high)
        distance = np.linalg.norm(path - points[k] - place[:, None] * way, axis=1)

        nearer = distance < best
        best[nearer] = distance[nearer]
        found[nearer] = (speeds[k] + place * (speeds[k + 1] - speeds[k]))[nearer]
    return found


def _estimate_cases(**sizes: Any) -> list[Case]:
    """All trainings with right names, one of each with wrong ones."""
    axes: dict[str, Any] = {"controller": TESTED, "seed": SEEDS, "wind": WINDS}
    axes |= {"shuffled": False}
    right = grid(**(axes | sizes))
    if "shuffled" in sizes:
        return right
    wrong = {"controller": MISNAMED, "seed": 0, "shuffled": True}
    return right + grid(**(axes | sizes | wrong))


EXPERIMENTS = (Experiment("drone_estimates", _estimate, _estimate_cases, slow=True),)
