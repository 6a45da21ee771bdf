"""Checks of notebook 04."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import cdist

from clothlab.checks._check import array, check, number
from clothlab.vision import HEIGHT, WIDTH, chamfer_distance

__all__ = ["chamfer_by_hand", "handmade", "linear_reconstruction", "touching"]


@check(array("area, mean column and mean row", 3))
def handmade(answer: Callable) -> None:
    """An empty mask, and a rectangle of 10 × 4 pixels."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    assert np.array_equal(answer(mask), np.zeros(3)), "an empty mask gives three zeros"
    mask[10:20, 40:44] = True
    area, column, row = answer(mask)
    assert area == 40, f"10 rows of 4 pixels are 40 pixels, got {area}"
    assert (column, row) == (41.5, 14.5), f"the centre is at column 41.5, row 14.5; got {column}, {row}"


@check(array("the reconstructed images", None, HEIGHT, WIDTH))
def linear_reconstruction(answer: Callable) -> None:
    """A square at random places: what must be true of every PCA."""
    corners = np.random.default_rng(0).integers(20, 40, (120, 2, 1))
    rows, columns = (np.abs(np.arange(size) - corners[:, k] - 10) < 12 for k, size in enumerate((HEIGHT, WIDTH)))
    images = rows[:, :, None] & columns[:, None, :]
    fit, test = images[:80], images[80:]
    linear = answer(fit, test, 3)
    error = [((answer(fit, test, n) - test) ** 2).mean() for n in (1, 3, 30)]
    assert error[0] > error[1] > error[2], "more components must leave less squared error"
    assert error[1] < ((fit.mean(axis=0) - test) ** 2).mean(), "three components must beat the mean image"
    alone = answer(fit, test[:5], 3)
    assert np.allclose(alone, linear[:5], atol=0.05), "other images change the axes: fit the PCA to `train` alone"


@check(number("a share between 0 and 1"))
def touching(answer: Callable) -> None:
    """Four masks: a pixel, a column, a block and nothing."""
    masks = np.zeros((4, HEIGHT, WIDTH), bool)
    masks[0, 5, 5] = masks[1, :, 5] = masks[2, 50:, :] = True
    assert answer(masks, masks[0]) == 0.5, "two of these four masks contain the pixel (5, 5): the share is 0.5"
    assert answer(masks, masks[3]) == 0, "nothing overlaps an empty target"
    assert answer(masks[:3], masks[1]) == 1, "all three overlap the column 5"


@check(number("a distance in pixels"))
def chamfer_by_hand(answer: Callable) -> None:
    """A large and a small rectangle that overlap, for which every usual slip has another value; then an L."""
    a, b = np.zeros((2, HEIGHT, WIDTH), bool)
    a[10:22, 40:44] = b[20:23, 42:49] = True
    found = answer(a, b)
    for told, value in _chamfer_slips(a, b).items():
        assert not np.isclose(found, value), told
    truth, bent = chamfer_distance(a, b), a | b
    factor, other = found / truth, answer(bent, b) / chamfer_distance(bent, b)
    same = not np.isclose(factor, 1, rtol=1e-4) and np.isclose(factor, other, rtol=1e-4)
    assert not same, f"{factor:.4g} times the distance: the unit is the side of one pixel"
    assert np.isclose(factor, 1, rtol=1e-4), f"two rectangles are {truth:.4f} pixels apart, not {found:.4f}"
    assert np.isclose(other, 1, rtol=1e-4), "right for two rectangles, wrong for an L and one of its legs"
    assert np.isclose(answer(a, a), 0), "a mask is at distance 0 from itself"


def _chamfer_slips(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """What is easily written in place of the chamfer distance: what the reader is told, and the value."""
    pixels = np.argwhere(a), np.argwhere(b)
    d = cdist(*pixels)
    city = cdist(*pixels, "cityblock")
    there, back = d.min(axis=1), d.min(axis=0)
    return {
        "that is one direction only, from a to b": there.mean(),
        "that is one direction only, from b to a": back.mean(),
        "both directions, but added: halve it": there.mean() + back.mean(),
        "the distances are squared: take the root of each": ((there**2).mean() + (back**2).mean()) / 2,
        "that is the largest distance (Hausdorff's): take the mean over the pixels": max(there.max(), back.max()),
        "the largest in each direction: take the mean over the pixels": (there.max() + back.max()) / 2,
        "a sum over the pixels: take the mean, or large masks would be farther away": (there.sum() + back.sum()) / 2,
        "each direction counts one half, however many pixels it has": np.concatenate([there, back]).mean(),
        "the mean over all pairs: each pixel counts its nearest partner alone": d.mean(),
        "steps along rows and columns: distances are Euclidean": (city.min(axis=1).mean() + city.min(axis=0).mean())
        / 2,
    }
