"""A real drone in wind: is the wind found in p, and what is p worth there?

The flights are those of `neural_fly`: four constant winds and one that changes as
sin t, each flown by five controllers. The wind is what stays the same within a flight
and differs between flights, and no sensor shows it by itself. A training is told which
flights had the same wind, and nothing else.

Every test is with a controller whose flights no training saw. Flights of one
controller, `DEVELOPMENT`, were used to choose settings; they are among the recordings
of every training, and no table is about them. All flights are 50 s, ten steps a second.

**Rivals.** Wind tilts a drone that holds its place. So beside each estimate stands the
plainest one, the mean tilt of the same seconds (`by_tilt`). Predictions have these
rivals: another wind's p, being told the wind, p that was trained on windows of 10 s,
networks without p (trained on windows of 3 s, or of 10 s), the same with the memory
that it had at the end of what is known, one that was trained to go on with such a
memory, an encoder of 10 s, a last layer fitted to the flight as Neural-Fly does with
its own, a hover model with a constant residual force, without drag and with it, and a
velocity that stays as it is.

**What a prediction may know.** All that is known of a flight, which is p, the code of
the encoder, the last layer, and the force, comes from its first 25 s and is held from
there on. Predictions begin in the second half, from one state, the commands that were
sent, and the last seconds of the flight, from none to twenty, which fill the memory.
With none, the memory is empty, as after a pause, or kept from before it.

**Harder cases.** `drone_harder` asks the same where memory and tilt might not do: with
states without tilt (the commanded one is still sent), of which there is a table, and
with the recordings of one or two controllers.

**Written before the tables were made.** The unit is a controller: there are four, each
with flights and trainings of its own. A figure is the mean over its four winds and its
trainings, which differ in their seed; the 95 % interval is Student's over controllers
(`crossed_interval` of one column), and so about other controllers in these winds. The
four are not independent: any two trainings share three quarters of their flights. The
measure of a prediction is the root mean square error of velocity after 1 s, the margin
0.05 m/s: p is worth nothing over a rival if the whole interval of the difference lies
within it. The wind is found where its trained p is the nearest of four. The changing
wind is followed where the correlation of the wind read from p with the stated one is
greater than in the same controller's flight in constant wind, by more than 0.1: the
figure of eight has the same period as the changing wind, so that a correlation alone
says nothing.

**Development.** Settings were first chosen by predictions over 1 s, of which no table
was kept. `drone_development` asks again: by the error of velocity after 1 s, the mean
of four winds and of two histories, 2 s and none (`development_errors`). What is in use
stays where nothing is better by more than `CLOSE`, a fifth of the margin: one
controller with one training can't say more. This was written before its table, which
then took the last layer's price from 10 to 0.01, and added the prices below 0.1.

**Written afterwards.** The measure of a prediction was chosen after a first look, in
which a model without p had led by the error of all states. The wind is read along a
line with corners (`wind_read_from`), which was seen later to hold back a third of the
readings at one corner; so it is read by `wind_by_kernel`, too. When a kept memory was
seen to be the worst of all after a pause, `drone_pause` was added, which has pauses of
many lengths. The sine is that of the log's clock, as its authors state the wind; that
the fans began with it is assumed.
"""

from collections.abc import Mapping
from functools import cache
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from clothlab.analysis import nearest_material
from clothlab.method.data import Run
from clothlab.method.gauss_newton import NewtonSettings, estimate_bias
from clothlab.method.model import AnyMemory, PredictiveModel
from studies import _drone_models as models
from studies._drone_models import (
    CONTEXT,
    DEVELOPMENT,
    LONG_MEMORY,
    LONG_P,
    NO_P,
    REHEARSED,
    TESTED,
    TOLD,
    Forecasts,
    HoverModel,
    P,
    Recordings,
    without,
)
from studies._grid import Case, Experiment, grid, over
from studies._rival_models import TrainedKind, memory_of
from studies.neural_fly import CHANGING, STEP, WINDS, load_flight, stated_wind

MARGIN = 0.05  # [m/s], written down beforehand
CLOSE = 0.01  # [m/s] by which a setting must be better to take another one's place
WINDOW = 100  # steps from which p is estimated, longer than a loop of the figure
WINDOWS = (20, 30, 50, 100)  # steps, in the changing wind
HORIZONS = (1, 3, 5, 10, 20, 30)  # steps
HISTORY = (0, 2, 5, 10, 20, 50, 200)  # steps that fill the memory
SEEDS = range(5)  # of the trainings without each controller
MISNAMED = ("NF-C", "NF")  # without which trainings get wrong names, as a control
_HALF = 250  # steps from which all is known that is held
_STARTS = range(_HALF, 470, 5)  # of predictions
_SECOND = 10  # steps
PAUSED = range(_HALF, 490, 2)  # where a flight goes on after a pause that began at half
_RIDGE = 0.01  # price of a change of the last layer, chosen on the development flights
# Among what settings were chosen: of a training, and of a last layer's price
AMOUNTS = (300, 600, 1200, 2400)
RIDGES = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0)
_TILT = slice(3, 5)
# What is predicted with
ESTIMATED = "estimated p"
RIGHT = "right wind's p"
FARTHEST = "farthest p"
LAST_LAYER = "last layer"
HOVER = "hover model"
DRAG = "hover model with drag"
STAYS = "velocity stays"
KEPT = "long memory, kept"
_KINDS = {ESTIMATED: P, RIGHT: P, FARTHEST: P, TOLD: TOLD, NO_P: NO_P}
_KINDS |= {LONG_MEMORY: LONG_MEMORY, CONTEXT: CONTEXT, LAST_LAYER: NO_P}
_KINDS |= {LONG_P: LONG_P, KEPT: LONG_MEMORY, REHEARSED: REHEARSED}
METHODS = (*_KINDS, HOVER, DRAG, STAYS)
# Where memory and tilt might not do: what a model may see, and which are asked. The
# table has the last case alone; a longer run asks for `case=HARDER`
HARDER = ("one controller", "two controllers", "no tilt")
_ASKED = (ESTIMATED, NO_P, LONG_MEMORY, KEPT)
_PAUSING = (ESTIMATED, LONG_MEMORY, KEPT, REHEARSED)


# The estimate


def _estimated(learned: TrainedKind, run: Run, window: int) -> np.ndarray:
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
    return np.stack([known[name] for name in WINDS if name in known])


def _speeds(known: Mapping[str, np.ndarray]) -> np.ndarray:
    """Those of the winds of which something is known, in the same order `[K]` [m/s]."""
    return np.array([speed for name, speed in WINDS.items() if name in known])


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
    learned = models.train(P, recordings, seed)
    run = load_flight(controller, wind).run
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


# A wind that no training saw


def neighbours(wind: str) -> tuple[str, str]:
    """The two recorded winds that lie next to one that is left out."""
    others = [name for name in WINDS if name != wind]
    others.sort(key=lambda name: abs(WINDS[name] - WINDS[wind]))
    lower, upper = sorted(others[:2], key=WINDS.__getitem__)
    return lower, upper


def place_between(p: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """How far along the way from one p to another `[D_p]` a third one lies."""
    way = upper - lower
    return float((p - lower) @ way / (way @ way))


def beside(p: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """How far off the line through two p `[D_p]` a third lies, over their distance."""
    way = upper - lower
    foot = lower + place_between(p, lower, upper) * way
    return float(np.linalg.norm(p - foot) / np.linalg.norm(way))


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


def order_along_first_axis(points: np.ndarray) -> tuple[int, ...]:
    """The order of points `[K, D]` along their first principal axis, either way."""
    axis = np.linalg.svd(points - points.mean(axis=0))[2][0]
    order = tuple(int(k) for k in np.argsort(points @ axis))
    return min(order, order[::-1])


def _unseen(controller: str, wind: str, seed: int) -> dict[str, Any]:
    """Where the p of a wind lies that was left out, as was the controller.

    Args:
        controller: of the flight.
        wind: of the flight.
        seed: of the training.
    """
    recordings = without(controller, wind)
    learned = models.train(P, recordings, seed)
    run = load_flight(controller, wind).run
    p = _estimated(learned, run, WINDOW)[-1]
    lower, upper = neighbours(wind)

    # By p, by the mean tilt of the same seconds, and as the speeds say
    biases = learned.biases
    tilts = _mean_tilts(recordings)
    tilt = _tilts(run, WINDOW)[-1]
    speeds = {name: np.array([speed]) for name, speed in WINDS.items()}
    return {
        "biases": _ordered(biases),
        "p": p,
        "place": place_between(p, biases[lower], biases[upper]),
        "place_by_tilt": place_between(tilt, tilts[lower], tilts[upper]),
        "place_by_speed": place_between(speeds[wind], speeds[lower], speeds[upper]),
    }


# A wind that changes


def wind_read_from(path: np.ndarray, biases: Mapping[str, np.ndarray]) -> np.ndarray:
    """The wind that each p says `[T]` [m/s]: the place on the line through trained p.

    It is the nearest point on the line that joins the p of neighbouring winds, which
    goes on straight at its ends.
    """
    points = _ordered(biases)
    speeds = _speeds(biases)
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


def wind_by_kernel(path: np.ndarray, biases: Mapping[str, np.ndarray]) -> np.ndarray:
    """The wind that each p says `[T]` [m/s]: a mean of the winds with a near p.

    Weights are normal distributions around the trained p, as wide as these are apart
    from their nearest neighbour on average. It has no corner at which to stay, and
    never says more than the strongest wind.
    """
    points = _ordered(biases)
    speeds = _speeds(biases)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    np.fill_diagonal(apart, np.inf)
    width = apart.min(axis=1).mean()
    squared = ((path[:, None] - points) ** 2).sum(axis=2) / (2 * width**2)
    weights = np.exp(squared.min(axis=1, keepdims=True) - squared)
    return weights @ speeds / weights.sum(axis=1)


def at_any_phase(read: np.ndarray, sine: np.ndarray, cosine: np.ndarray) -> float:
    """Correlation of what is read `[T]` with a sine of the best phase."""
    design = np.stack([sine, cosine, np.ones(len(read))], axis=1)
    fitted = design @ np.linalg.lstsq(design, read, rcond=None)[0]
    return float(fitted.std() / read.std())


def followed(
    read: np.ndarray, stated: np.ndarray, most: int = 62
) -> tuple[float, float, float]:
    """How what is read `[T]` follows what is stated `[T]`.

    Returned are the correlation at once, the delay with the greatest one [s], and that
    correlation. Delays go up to `most` steps, by default nearly a period of the sine.
    """
    r = []
    for lag in range(most + 1):
        later = read[lag:]
        r.append(np.corrcoef(later, stated[: len(later)])[0, 1])
    best = int(np.argmax(r))
    return float(r[0]), STEP * best, float(r[best])


def _changing(
    controller: str, condition: str, window: int, seed: int
) -> dict[str, Any]:
    """Read the wind from p of a short window, beside the sine of the changing wind.

    Args:
        controller: whose flights no training saw.
        condition: the changing wind, or a constant one as the control: what is read
            from it can't follow the sine.
        window: steps from which p is estimated.
        seed: of the training.
    """
    recordings = without(controller)
    learned = models.train(P, recordings, seed)
    flight = load_flight(controller, condition)
    sine = stated_wind(CHANGING, flight.time)

    # From where the longest window is full, by p and by the mean tilt
    path = _estimated(learned, flight.run, window)[WINDOW:]
    tilts = _tilts(flight.run, window)[WINDOW:]
    read = wind_read_from(path, learned.biases)
    by_kernel = wind_by_kernel(path, learned.biases)
    by_tilt = wind_read_from(tilts, _mean_tilts(recordings))
    sine = sine[WINDOW:]

    # How each follows the sine
    row: dict[str, Any] = {"wind": read[::2].round(2), "stated": sine[::2].round(3)}
    row["wind_by_kernel"] = by_kernel[::2].round(2)
    readings = {"": read, "_by_kernel": by_kernel, "_by_tilt": by_tilt}
    for ending, found in readings.items():
        at_once, delay, r = followed(found, sine)
        row |= {f"r_at_once{ending}": at_once, f"delay{ending}": delay}
        row |= {f"r{ending}": r}
    return row


# Predictions


@cache
def _hover_model(recordings: Recordings) -> HoverModel:
    return HoverModel.of(recordings.runs())


class _Held(NamedTuple):
    """What is known of a flight from its first half."""

    model: PredictiveModel
    p: Tensor  # [D_p]
    memory: AnyMemory | None  # where one is kept


def _hold(method: str, learned: TrainedKind, first: Run, ridge: float) -> _Held:
    """What a network makes of the first half of a flight."""
    model = learned.model
    if method == LAST_LAYER:
        model = models.with_last_layer(model, first, ridge)
    kept = memory_of(model, first) if method in (KEPT, REHEARSED) else None
    p = _held_bias(method, learned, first, first.material)
    return _Held(model, torch.as_tensor(p, dtype=torch.float32), kept)


def _held_bias(method: str, learned: TrainedKind, first: Run, wind: str) -> np.ndarray:
    """What a method holds in the place of p `[D_p]` from the first half of a flight."""
    if method in (ESTIMATED, LONG_P):
        return models.estimate_at_once(learned.model, first)
    if method == CONTEXT:
        return learned.read(first)
    if method in (RIGHT, TOLD):
        return learned.biases[wind]
    if method == FARTHEST:
        right = learned.biases[wind]
        gaps = {name: np.linalg.norm(p - right) for name, p in learned.biases.items()}
        return learned.biases[max(gaps, key=gaps.__getitem__)]
    return np.zeros(0)


def _errors(predicted: Tensor, given: Forecasts) -> np.ndarray:
    """Root mean square error of velocity at each horizon `[6]` [m/s]."""
    squared = (predicted - given.flown)[..., :3].square().sum(-1).mean(0)
    return squared.sqrt().numpy()[[k - 1 for k in HORIZONS]]


def _losses(predicted: Tensor, given: Forecasts, std: Tensor) -> np.ndarray:
    """Mean squared error of all states at each horizon `[6]` [s.d.²]."""
    squared = ((predicted - given.flown) / std).square().mean(-1).mean(0)
    return squared.numpy()[[k - 1 for k in HORIZONS]]


def _predict(method: str, controller: str, wind: str, seed: int) -> dict[str, Any]:
    """Predict the second half of a flight with what its first half taught.

    Args:
        method: what is predicted with.
        controller: of the flight; no training saw its flights.
        wind: of the flight.
        seed: of the training.
    """
    recordings = without(controller)
    run = load_flight(controller, wind).run
    if method == STAYS:
        return _as_it_is(run)
    if method in (HOVER, DRAG):
        return _by_physics(_hover_model(recordings), run, drag=method == DRAG)
    learned = models.train(_KINDS[method], recordings, seed)
    return _by_network(method, learned, run, _RIDGE)


def _after_pause(method: str, controller: str, wind: str, seed: int) -> dict[str, Any]:
    """Predict 1 s with no memory but a kept one, after pauses of many lengths.

    Args:
        method: what is predicted with, a network.
        controller: of the flight; no training saw its flights.
        wind: of the flight.
        seed: of the training.
    """
    run = load_flight(controller, wind).run
    learned = models.train(_KINDS[method], without(controller), seed)
    held = _hold(method, learned, run[:_HALF], _RIDGE)
    given = models.forecasts(run, PAUSED, 0, _SECOND)
    off = (models.predicted(*held, given) - given.flown)[:, -1, :3]
    return {"error": off.norm(dim=1).numpy().round(3)}


def _predict_harder(
    case: str, method: str, controller: str, wind: str, seed: int
) -> dict[str, Any]:
    """The same where less is recorded.

    Args:
        case: one of `HARDER`.
        method: what is predicted with, a network.
        controller: of the flight; no training saw its flights.
        wind: of the flight.
        seed: of the training.
    """
    recordings = {
        "one controller": models.few(controller, 1),
        "two controllers": models.few(controller, 2),
        "no tilt": without(controller, tilt=False),
    }[case]
    run = recordings.seen(load_flight(controller, wind).run)
    learned = models.train(_KINDS[method], recordings, seed)
    return _by_network(method, learned, run, _RIDGE)


def _develop(
    method: str, wind: str, updates: int, ridge: float | None = None
) -> dict[str, Any]:
    """The same of a flight of the development, by which settings were chosen.

    Args:
        method: what is predicted with.
        wind: of the flight.
        updates: of the training.
        ridge: price of a change of the last layer, for what fits one.
    """
    run = load_flight(DEVELOPMENT, wind).run
    learned = models.train(_KINDS[method], without(DEVELOPMENT), 0, updates)
    return _by_network(method, learned, run, ridge or _RIDGE)


def _as_it_is(run: Run) -> dict[str, Any]:
    """A row of predictions that nothing changes; it has no memory to fill."""
    given = models.forecasts(run, _STARTS, 0, HORIZONS[-1])
    stays = given.before[:, -1:].expand_as(given.flown)
    return _without_memory(_errors(stays, given))


def _by_physics(hover: HoverModel, run: Run, drag: bool) -> dict[str, Any]:
    """A row of predictions by a hover model; it has no memory to fill."""
    hover = hover.with_force(run[:_HALF], drag)
    given = models.forecasts(run, _STARTS, 0, HORIZONS[-1])
    return _without_memory(_errors(hover.predict(given), given))


def _without_memory(errors: np.ndarray) -> dict[str, Any]:
    """A row of errors `[6]` that are the same after every history."""
    losses = np.full((len(HISTORY), len(HORIZONS)), np.nan)
    return {"velocity": np.tile(errors, (len(HISTORY), 1)).round(5), "loss": losses}


def _by_network(
    method: str, learned: TrainedKind, run: Run, ridge: float
) -> dict[str, Any]:
    """A row of predictions by a network, which holds what the first half taught."""
    held = _hold(method, learned, run[:_HALF], ridge)

    # Each horizon, after each history
    errors = []
    losses = []
    for history in HISTORY:
        given = models.forecasts(run, _STARTS, history, HORIZONS[-1])
        states = models.predicted(*held, given)
        errors.append(_errors(states, given))
        losses.append(_losses(states, given, held.model.s_std))
    return {"velocity": np.stack(errors).round(5), "loss": np.stack(losses).round(5)}


def _development_cases(**sizes: Any) -> list[Case]:
    """Amounts of training for the main rivals, and prices of a last layer."""
    networks = (ESTIMATED, NO_P, LONG_MEMORY, CONTEXT, TOLD, LONG_P, REHEARSED)
    amounts: dict[str, Any] = {"method": networks, "wind": WINDS}
    amounts |= {"updates": AMOUNTS, "ridge": None}
    prices: dict[str, Any] = {"method": LAST_LAYER, "wind": WINDS}
    prices |= {"updates": models.UPDATES[NO_P], "ridge": RIDGES}
    return grid(**(amounts | sizes)) + grid(**(prices | sizes))


def development_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Error of velocity 1 s ahead [m/s] of each method, updates and ridge.

    It is the mean over winds, after 2 s of memory and after none alike.
    """
    errors = np.stack(table["velocity"].to_list())
    after = [HISTORY.index(20), HISTORY.index(0)]
    both = errors[:, after, HORIZONS.index(10)].mean(axis=1)
    settings = ["method", "updates", "ridge"]
    found = table.assign(error=both).groupby(settings, sort=False, dropna=False)
    return found["error"].mean().reset_index()


def lost_by_choice(table: pd.DataFrame) -> pd.Series:
    """Error of what is in use minus the least of the development, by method [m/s]."""
    lost = {}
    for method, rows in development_errors(table).groupby("method", sort=False):
        used = rows["updates"] == models.UPDATES[_KINDS[str(method)]]
        used &= rows["ridge"].isna() | (rows["ridge"] == _RIDGE)
        lost[method] = rows.loc[used, "error"].item() - rows["error"].min()
    return pd.Series(lost)


def _estimate_cases(**sizes: Any) -> list[Case]:
    """All trainings with right names, one of each with wrong ones."""
    axes: dict[str, Any] = {"controller": TESTED, "seed": SEEDS, "wind": WINDS}
    axes |= {"shuffled": False}
    right = grid(**(axes | sizes))
    if "shuffled" in sizes:
        return right
    wrong = {"controller": MISNAMED, "seed": 0, "shuffled": True}
    return right + grid(**(axes | sizes | wrong))


def _changing_cases(**sizes: Any) -> list[Case]:
    """Each window in changing and in constant wind."""
    axes: dict[str, Any] = {"controller": TESTED, "condition": (CHANGING, "70wind")}
    return grid(**(axes | {"window": WINDOWS, "seed": SEEDS} | sizes))


EXPERIMENTS = (
    Experiment(
        "drone_development", _develop, _development_cases, seconds=12, slow=True
    ),
    Experiment("drone_estimates", _estimate, _estimate_cases, seconds=15, slow=True),
    Experiment(
        "drone_unseen_wind",
        _unseen,
        over(controller=TESTED, wind=("35wind", "70wind"), seed=SEEDS),
        seconds=50,
        slow=True,
    ),
    Experiment("drone_changing_wind", _changing, _changing_cases, seconds=3, slow=True),
    Experiment(
        "drone_prediction",
        _predict,
        over(method=METHODS, controller=TESTED, wind=WINDS, seed=SEEDS),
        seconds=8,
        slow=True,
    ),
    Experiment(
        "drone_pause",
        _after_pause,
        over(method=_PAUSING, controller=TESTED, wind=WINDS, seed=SEEDS),
        seconds=4,
        slow=True,
    ),
    Experiment(
        "drone_harder",
        _predict_harder,
        over(case=HARDER[-1], method=_ASKED, controller=TESTED, wind=WINDS, seed=0),
        seconds=15,
        slow=True,
    ),
)
