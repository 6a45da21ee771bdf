"""Checks of notebook 03."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor
from torch.nn import functional as F

from clothlab._validation import HEIGHT, WIDTH
from clothlab.checks._check import (
    CheckFailed,
    apart,
    array,
    check,
    drawn,
    expect,
    number,
)
from clothlab.simulation.vision import chamfer_distance

_PIXELS = HEIGHT * WIDTH


@check(number("a distance in pixels"))
def chamfer_by_hand(answer: Callable, rng: np.random.Generator) -> None:
    """The chamfer distance of two masks `[H, W]`, bool [pixel].

    Given are a large and a small rectangle that overlap, for which every usual slip has
    another value; then an L and one of its legs; then a mask and itself.
    """

    def distances_differ(masks: tuple[np.ndarray, np.ndarray]) -> bool:
        return apart(chamfer_distance(*masks), _chamfer_slips(*masks))

    # Two rectangles, and the L that they make together
    a, b = drawn(lambda: _two_rectangles(rng), distances_differ)
    bent = a | b
    found = answer(a, b)
    bent_found = answer(bent, b)
    truth = chamfer_distance(a, b)
    bent_truth = chamfer_distance(bent, b)

    # The same wrong factor in both is another unit
    otherwise = f"two rectangles are {truth:.4f} pixels apart, not {found:.4f}"
    if found:
        factor = found / truth
        bent_factor = bent_found / bent_truth
        if np.isclose(factor, bent_factor, rtol=1e-4):
            otherwise = (
                f"{factor:.4g} times the distance: the unit is the side of one pixel"
            )
    expect(found, truth, otherwise, _chamfer_slips(a, b), rtol=1e-4)

    otherwise = "right for two rectangles, wrong for an L and one of its legs"
    expect(bent_found, bent_truth, otherwise, rtol=1e-4)
    expect(answer(a, a), 0, "a mask is at distance 0 from itself")


def _two_rectangles(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A tall one, and a flat one across its foot, `[H, W]` each."""
    row, column, tall, wide = rng.integers((8, 20, 10, 6), (20, 60, 15, 10))
    standing, lying = np.zeros((2, HEIGHT, WIDTH), bool)
    foot = row + tall
    standing[row:foot, column : column + 4] = True
    lying[foot - 2 : foot + 1, column + 2 : column + 2 + wide] = True
    return standing, lying


def _chamfer_slips(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """What is easily taken for the chamfer distance, by what is said of it."""
    # From each pixel to the nearest of the other mask, both ways
    pixels_a = np.argwhere(a)
    pixels_b = np.argwhere(b)
    distances = cdist(pixels_a, pixels_b)
    there = distances.min(axis=1)
    back = distances.min(axis=0)
    steps = cdist(pixels_a, pixels_b, "cityblock")
    steps_there = steps.min(axis=1)
    steps_back = steps.min(axis=0)

    # Each slip, from these
    one_way = there.mean()
    both_ways = there.mean() + back.mean()
    farthest = max(there.max(), back.max())
    summed = (there.sum() + back.sum()) / 2
    along_the_grid = (steps_there.mean() + steps_back.mean()) / 2
    return {
        "that is one direction only, from a to b": one_way,
        "both directions, but added: halve it": both_ways,
        "that is the largest distance (Hausdorff's): take the mean over the "
        "pixels": farthest,
        "a sum over the pixels: take the mean, or large masks would be farther "
        "away": summed,
        "the mean over all pairs: each pixel counts its nearest partner "
        "alone": distances.mean(),
        "steps along rows and columns: distances are Euclidean": along_the_grid,
    }


@check(number("the mean over all pixels, which is finite for a logit of 200, too"))
def bce_loss(answer: Callable, rng: np.random.Generator) -> None:
    """The binary cross entropy of logits and images, `[B, 1, H, W]` each.

    Given are random logits, then logits of about 200 that are all wrong, where a
    formula by way of probabilities gives inf, or is cut off.
    """

    def draw() -> tuple[Tensor, Tensor]:
        shape = (4, 1, 6, 8)
        logits = rng.normal(0, 3, shape).clip(-8, 8)
        images = rng.random(shape) < 0.3
        return _float32(logits), _float32(images)

    def losses_differ(pair: tuple[Tensor, Tensor]) -> bool:
        return apart(F.binary_cross_entropy_with_logits(*pair), _bce_slips(*pair))

    # Random logits
    logits, images = drawn(draw, losses_differ)
    truth = F.binary_cross_entropy_with_logits(logits, images)
    found = answer(logits, images)
    otherwise = f"for random logits L is {truth:.4f}, not {found:.4f}"
    expect(found, truth, otherwise, _bce_slips(logits, images))

    # Large ones, of which each pixel costs its logit
    large = float(rng.integers(180, 220))
    found = answer(large * (1 - 2 * images), images)
    otherwise = (
        f"where logits of {large:g} are all wrong, L is {large:g}, "
        f"not {found:.4g}: nothing may be cut off"
    )
    expect(found, large, otherwise)


def _bce_slips(logits: Tensor, images: Tensor) -> dict[str, float]:
    """What is easily taken for the cross entropy, by what is said of it."""
    none = F.softplus(logits)  # -log P(no cloth)
    cloth = F.softplus(-logits)  # -log P(cloth)
    truth = F.binary_cross_entropy_with_logits(logits, images)
    swapped = images * none + (1 - images) * cloth
    slips = {
        "a sum: take the mean over all pixels": truth * images.numel(),
        "the two cases have changed places: a large logit makes cloth likely": swapped,
        "the sign is wrong: a loss is never negative": -truth,
        "pixels without cloth count, too": images * cloth,
        "each pixel has one of the two terms: choose it by `images`": none + cloth,
    }
    return {message: float(value.mean()) for message, value in slips.items()}


@check(array("the smaller size, and the output_padding", 2))
def mirror_padding(answer: Callable, rng: np.random.Generator) -> None:
    """What a convolution makes of a size, and how its mirror image comes back, `[2]`.

    Given is a height or width; the convolution has kernel 3, stride 2 and padding 1, as
    the transposed one has. Some sizes are odd, some even.
    """
    even = 2 * int(rng.integers(5, 80))
    for size in (even, even + 1, even + 2):
        layer = torch.nn.Conv2d(1, 1, 3, stride=2, padding=1)
        small = layer(torch.zeros(1, 1, size, size)).shape[-1]
        found = answer(size)
        otherwise = f"a convolution makes {small} of {size}, not {found[0]:g}"
        expect(found[0], small, otherwise)

        # A transposed convolution comes back to 2 n - 1, and this much is missing
        missing = size - (2 * small - 1)
        otherwise = f"from {small} back to {size} takes an output_padding of {missing}"
        expect(found[1], missing, otherwise)


@check(number("a share"))
def rarity(answer: Callable, rng: np.random.Generator) -> None:
    """The share of a cloud at least as far from their nearest as a z from its own.

    Given are z `[3]` and a cloud `[60, 3]`; none of a cloud is its own neighbour.
    """

    def draw() -> tuple[np.ndarray, np.ndarray]:
        return rng.normal(size=3), rng.normal(size=(60, 3))

    case = drawn(draw, lambda case: apart(*_rarity(*case), atol=0.01))
    truth, slips = _rarity(*case)
    otherwise = (
        f"{truth:.3f} of them are as far from their nearest other one, not what you say"
    )
    expect(answer(*case), truth, otherwise, slips, atol=1e-4)


def _rarity(z: np.ndarray, seen: np.ndarray) -> tuple[float, dict[str, float]]:
    """The share, and what usual slips give, by what is said of each."""
    own = cdist(z[None], seen).min()
    between = cdist(seen, seen)
    np.fill_diagonal(between, np.inf)
    nearest = between.min(axis=1)
    truth = float((nearest >= own).mean())
    return truth, {
        "each is nearest to itself: that distance, 0, must not count": 0.0,
        "that is the share that is *nearer* to its nearest": 1 - truth,
        "that is the distance of z itself: compare it with those of the others": own,
    }


@check(array("one distance for each pair that is left", None))
def apart_later(answer: Callable, rng: np.random.Generator) -> None:
    """How far apart pairs of moments end that are alike in all that is demanded.

    Given are two quantities of 30 moments with a bound for each, and where these end,
    `[30, 3]`; then no demand at all.
    """

    def draw() -> tuple[list[np.ndarray], list[float], np.ndarray]:
        now = [rng.normal(size=(30, 3)), rng.normal(size=(30, 2))]
        return now, [1.8, 1.5], rng.normal(size=(30, 3))

    def clear(case: tuple[list[np.ndarray], list[float], np.ndarray]) -> bool:
        truth, slips = _pairs_later(*case)
        sums = {words: float(np.sum(each)) for words, each in slips.items()}
        return len(truth) > 20 and apart(float(truth.sum()), sums)

    # Two demands; in which order pairs come is left open
    case = drawn(draw, clear)
    now, near, after = case
    truth, slips = _pairs_later(*case)
    found = np.sort(answer(now, near, after))
    for words, slip in slips.items():
        if len(found) == len(slip) and np.allclose(found, np.sort(slip)):
            raise CheckFailed(words)
    assert len(found) == len(truth), (
        f"{len(truth)} pairs are alike in both quantities, not {len(found)}"
    )
    otherwise = "the right pairs, but not their distances in `after`"
    expect(found, np.sort(truth), otherwise)

    # None
    found = answer([], [], after)
    assert len(found) == 435, (
        f"where nothing is demanded, all 435 pairs are left, not {len(found)}"
    )


def _pairs_later(
    now: list[np.ndarray], near: list[float], after: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The distances, and what usual slips give, by what is said of each."""
    # Each pair once, and which of them are alike
    a, b = np.triu_indices(len(after), 1)
    gaps = [np.linalg.norm(x[a] - x[b], axis=1) for x in now]
    close = [gap < limit for gap, limit in zip(gaps, near, strict=True)]
    both = close[0] & close[1]
    ends = np.linalg.norm(after[a] - after[b], axis=1)

    # The truth, then the slips
    return ends[both], {
        "alike in one *or* the other: each quantity must be near": ends[
            close[0] | close[1]
        ],
        "the last quantity alone decides: keep what the others have ruled out": ends[
            close[1]
        ],
        "these are the pairs that are *not* alike": ends[~both],
        "alike is what is nearer than the bound, not what is farther": ends[
            ~close[0] & ~close[1]
        ],
        "these are the distances now: take those in `after`": gaps[0][both],
        "add the squares of the differences, then take the root": np.abs(
            after[a] - after[b]
        ).sum(axis=1)[both],
    }


class _Components(NamedTuple):
    """Masks `[80, H, W]` to fit to and others to draw, and what it takes to do so."""

    fit: np.ndarray
    test: np.ndarray
    wanted: float  # mean IoU
    truth: int  # the fewest components that reach it
    margin: float  # by how much they do
    cheated: int  # the fewest of those that are fitted to what is drawn


@check(number("a number of components"))
def components_needed(answer: Callable, rng: np.random.Generator) -> None:
    """The fewest principal components that draw as well as is wanted.

    Given are 80 masks to fit the components to, 80 others to draw, and the mean IoU
    that is wanted; all show a square at a random place.
    """

    def draw() -> _Components:
        fit = _squares(rng, 80)
        test = _squares(rng, 80)
        scores = _overlaps(fit, test)
        n = int(rng.integers(4, 20))
        wanted = (max(scores[:n]) + scores[n]) / 2
        cheated = _first(_overlaps(test, test), wanted)
        return _Components(fit, test, wanted, n + 1, scores[n] - wanted, cheated)

    # A step up at the right number, and a slip that ends elsewhere
    def clear(case: _Components) -> bool:
        return case.margin > 0.002 and case.cheated < case.truth - 1

    # What the reader finds
    case = drawn(draw, clear)
    found = answer(case.fit, case.test, case.wanted)
    otherwise = (
        f"{case.truth} components reach a mean IoU of {case.wanted:.3f}, not "
        f"{found:g}: is the mean added again, and each pixel above 0.5 cloth?"
    )
    slips = {
        "with n components, take the columns before n: count from one": case.truth - 1,
        "the components are fitted to `train`, not to what is drawn": case.cheated,
    }
    expect(found, case.truth, otherwise, slips, atol=0.1)


def _first(scores: list[float], wanted: float) -> int:
    """How many components it takes to reach a score."""
    return next((n for n, each in enumerate(scores, 1) if each >= wanted), 99)


def _overlaps(fit: np.ndarray, test: np.ndarray) -> list[float]:
    """Mean IoU of masks drawn from the first 1, 2, … 30 components of others."""
    known = fit.reshape(len(fit), -1).astype(float)
    images = test.reshape(len(test), -1)
    mean = known.mean(axis=0)
    centred = known - mean

    # The axes by way of the N × N matrix, as N images are far fewer than D pixels
    _, vectors = np.linalg.eigh(centred @ centred.T)
    axes = vectors[:, :-31:-1].T @ centred
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    z = (images - mean) @ axes.T

    scores = []
    for n in range(1, len(axes) + 1):
        drawn_as = z[:, :n] @ axes[:n] + mean > 0.5
        both = (drawn_as & images).sum(axis=1)
        either = (drawn_as | images).sum(axis=1)
        scores.append(float((both / either).mean()))
    return scores


def _squares(rng: np.random.Generator, count: int) -> np.ndarray:
    """Masks `[N, H, W]` with a square of 23 pixels at random places."""
    corners = rng.integers(20, 40, (count, 2, 1))
    rows = np.abs(np.arange(HEIGHT) - corners[:, 0] - 10) < 12
    columns = np.abs(np.arange(WIDTH) - corners[:, 1] - 10) < 12
    return rows[:, :, None] & columns[:, None, :]


def _float32(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)
