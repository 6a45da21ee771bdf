"""Checks of notebook 03."""

from collections.abc import Callable

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor
from torch.nn import functional as F

from clothlab._validation import HEIGHT, WIDTH
from clothlab.checks._check import apart, array, check, drawn, expect, number
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


@check(array("the reconstructed images", None, _PIXELS))
def linear_reconstruction(answer: Callable, rng: np.random.Generator) -> None:
    """Images `[M, H W]` rebuilt from their first principal axes.

    Given are 80 images to fit the axes to, others to rebuild, and how many axes; all
    show a square at a random place. Expected is a squared error as small as so many
    axes can leave, and none smaller.
    """
    images = _squares(rng, 120)
    fit = images[:80]
    test = images[80:]
    alone = answer(fit, test[:5], 3)
    for n in (1, 3):
        linear = answer(fit, test, n)
        assert len(linear) == len(test), (
            f"{len(test)} images must give as many, not {len(linear)}"
        )
        rounded = np.isin(linear, (0, 1)).all()
        assert not rounded, "return real numbers: rounding comes later"

        # Neither better nor worse than the best of n axes
        found = ((linear - test) ** 2).mean()
        least = _least_error(fit, test, n)
        message = (
            f"{n} axes through the mean of `train` leave a squared error of "
            f"{least:.4f}, yours {found:.4f}"
        )
        assert found > 0.95 * least, (
            f"{message}: have you taken more axes, or fitted them to other images?"
        )
        assert found < 1.05 * least, (
            f"{message}: are there so many axes, and is the mean added again?"
        )

    # What is rebuilt beside an image must not change it
    assert np.allclose(alone, linear[:5], atol=0.05), (
        "other images change the axes: fit the PCA to `train` alone"
    )


def _squares(rng: np.random.Generator, count: int) -> np.ndarray:
    """Images `[N, H W]` of 0 and 1 with a square of 23 pixels at random places."""
    corners = rng.integers(20, 40, (count, 2, 1))
    rows = np.abs(np.arange(HEIGHT) - corners[:, 0] - 10) < 12
    columns = np.abs(np.arange(WIDTH) - corners[:, 1] - 10) < 12
    images = rows[:, :, None] & columns[:, None, :]
    return images.reshape(count, _PIXELS).astype(np.float32)


def _least_error(fit: np.ndarray, test: np.ndarray, n: int) -> float:
    """Squared error of `test` `[M, D]` on n principal axes of `fit` `[N, D]`."""
    mean = fit.mean(axis=0)
    centred = fit - mean

    # The axes by way of the N × N matrix, as N images are far fewer than D pixels
    _, vectors = np.linalg.eigh(centred @ centred.T)
    axes = vectors[:, -n:].T @ centred
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    gaps = test - mean
    left = gaps - gaps @ axes.T @ axes
    return np.square(left).mean()


def _float32(values: np.ndarray) -> Tensor:
    return torch.as_tensor(values, dtype=torch.float32)
