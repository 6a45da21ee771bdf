"""One plan for nine cloths: a model solution, and its reference values.

Of the half page, measured on the eight development targets of the torque arm with
`torque-0`, from rest, one seed of the search. Distances in standard deviations of z,
medians over targets (and quartiles):

                      predicted           achieved
                      mean     largest    mean                   largest
    one for all       0.45     0.56       0.64 (0.49 to 1.00)    1.12 (0.91 to 1.61)
    middle cloth      0.45     0.94       0.77 (0.59 to 1.22)    1.43 (1.18 to 1.75)
    each its own      0.02     0.04       0.92 (0.67 to 0.95)    1.56 (1.36 to 1.91)

The plan for all promises least, and in the throw its mean is nearer than that of the
cloths' own plans on six targets of eight, its largest on seven. What was searched with
one p alone falls far short of what was predicted; nine p at once leave less room for
that. So not knowing the cloth costs much in the prediction and nothing that shows here
in the throw. Yet the largest distance is about twice what was predicted for it, too.
Eight targets, one training: an answer with other numbers may be right.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np


def plan_for_all(
    losses: Sequence[Callable[[np.ndarray], np.ndarray]],
    mean: np.ndarray,
    spread: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    calls: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """A plan `[8, 2]` whose largest loss is low.

    Args:
        losses: of plans `[B, 8, 2]`, `[B]`, for each cloth.
        mean: of the first draw `[8, 2]`.
        spread: standard deviations of the first draw `[8, 2]`.
        lower: limits `[2]`.
        upper: limits `[2]`.
        calls: plans that may be judged, counted for each cloth.
        rng: of the draws.
    """
    # Some rounds share the calls
    plans_in_all = calls // len(losses)
    rounds = max(3, round(plans_in_all**0.5 / 4))
    size = plans_in_all // rounds
    floor = 0.05 * spread
    best = np.clip(mean, lower, upper)
    lowest = np.inf

    # Each draws anew around the best of the one before
    for _ in range(rounds):
        draws = mean + spread * rng.normal(size=(size, *mean.shape))
        plans = np.clip(draws, lower, upper)
        largest = np.max([loss(plans) for loss in losses], axis=0)
        elite = plans[np.argsort(largest)[: max(2, size // 8)]]
        if largest.min() < lowest:
            lowest = largest.min()
            best = plans[largest.argmin()]
        mean = 0.5 * (elite.mean(axis=0) + best)
        spread = np.maximum(elite.std(axis=0), floor)
    return best


def parts(
    answer: Callable, seed: int = 0
) -> Iterator[tuple[int, str, Callable[[], bool]]]:
    """Points, words and condition of each part."""
    rules = "no more calls than allowed, never out of range"
    yield 1, rules, lambda: _keeps_rules(answer, seed)
    far = "the largest loss: far below that of random draws"
    yield 2, far, lambda: _goes_down(answer, seed)
    yield 1, "the cloth unlike the others", lambda: _gives_up_none(answer, seed)


_LOWER = np.array([-1.0, -1.2])
_UPPER = np.array([0.9, 1.1])
_SPREAD = 0.4  # of the first draw


def _found(
    answer: Callable, losses: Sequence[Callable], calls: int, key: list[int]
) -> tuple[np.ndarray, int]:
    """An answer's plan, and how many calls it made."""
    asked = 0

    def counted(judge: Callable) -> Callable:
        def ask(plans: np.ndarray) -> np.ndarray:
            nonlocal asked
            asked += len(plans)
            return judge(plans)

        return ask

    rng = np.random.default_rng(key)
    start = np.zeros((8, 2))
    spread = np.full((8, 2), _SPREAD)
    asking = [counted(judge) for judge in losses]
    plan = answer(asking, start, spread, _LOWER, _UPPER, calls, rng)
    return np.asarray(plan), asked


def _keeps_rules(answer: Callable, seed: int) -> bool:
    for number, calls in enumerate((60, 300, 900)):
        key = [seed, number]
        rng = np.random.default_rng(key)
        edges = [_valley(rng.uniform(-3, 3, 16)) for _ in range(3)]
        plan, asked = _found(answer, edges, calls, key)
        inside = ((plan >= _LOWER) & (plan <= _UPPER)).all()
        if asked > calls or plan.shape != (8, 2) or not inside:
            return False
    return True


def _goes_down(answer: Callable, seed: int) -> bool:
    ratios = []
    for number in range(20):
        key = [seed, number]
        rng = np.random.default_rng(key)
        middle = rng.uniform(-0.6, 0.6, 16)
        losses = [_valley(middle + rng.normal(0, 0.1, 16)) for _ in range(5)]
        plan, _ = _found(answer, losses, 2000, key)
        draws = np.clip(rng.normal(0, _SPREAD, (400, 8, 2)), _LOWER, _UPPER)
        ratios.append(_largest(losses, plan[None])[0] / _largest(losses, draws).min())
    return float(np.median(ratios)) < 0.7


def _gives_up_none(answer: Callable, seed: int) -> bool:
    shares = []
    for number in range(20):
        key = [seed, number]
        rng = np.random.default_rng(key)
        way = rng.normal(size=16)
        way *= 0.8 / np.linalg.norm(way)
        losses = [*4 * [_valley(-way)], _valley(way)]
        plan, _ = _found(answer, losses, 5000, key)
        # Halfway between the two places it is 0.8, at one of them 1.6
        shares.append(_largest(losses, plan[None])[0] / 0.8)
    return float(np.median(shares)) < 1.4


def _largest(losses: Sequence[Callable], plans: np.ndarray) -> np.ndarray:
    return np.max([loss(plans) for loss in losses], axis=0)


def _valley(goal: np.ndarray) -> Callable:
    """A loss around one hidden plan."""
    return lambda plans: np.linalg.norm(plans.reshape(len(plans), 16) - goal, axis=1)
