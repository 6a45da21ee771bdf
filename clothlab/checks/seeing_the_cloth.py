"""Checks of notebook 04."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import cdist

from clothlab.checks._check import array, check, expect, number
from clothlab.simulation.vision import HEIGHT, WIDTH, chamfer_distance


@check(array("area, mean column and mean row, or zeros for an empty mask", 3))
def handmade(answer: Callable) -> None:
    """An L, whose centre is neither that of its bounding box nor its median, and an empty mask."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[10:20, 40:44] = mask[20:24, 40:60] = True
    rows, columns = np.nonzero(mask)
    area, column, row = answer(mask)
    assert not np.isclose(area, mask.mean()), "that is the area's share of the image: count pixels"
    assert np.isclose(area, 120), f"40 and 80 pixels are 120 pixels, got {area:g}"
    truth = columns.mean(), rows.mean()
    slips = {
        "that is the median; take the mean over the pixels": (np.median(columns), np.median(rows)),
        "row and column have changed places": truth[::-1],
        "column and row are counted in pixels, not in shares of the image": np.divide(truth, (WIDTH, HEIGHT)),
    }
    message = f"the pixels of an L have the mean column {truth[0]:.4g}, the mean row {truth[1]:.4g}"
    expect([column, row], truth, f"{message}; yours are {column:.4g} and {row:.4g}", slips)
    expect(answer(np.zeros_like(mask)), np.zeros(3), "an empty mask gives three zeros")


@check(array("the reconstructed images", None, HEIGHT, WIDTH))
def linear_reconstruction(answer: Callable) -> None:
    """A square at random places, beside the best that so many components can do."""
    corners = np.random.default_rng(0).integers(20, 40, (120, 2, 1))
    rows, columns = (np.abs(np.arange(size) - corners[:, k] - 10) < 12 for k, size in enumerate((HEIGHT, WIDTH)))
    images = rows[:, :, None] & columns[:, None, :]
    fit, test = images[:80], images[80:]
    linear = answer(fit, test, 3)
    assert len(linear) == len(test), f"{len(test)} images must give as many, not {len(linear)}"
    assert not np.isin(linear, (0, 1)).all(), "return real numbers: the check does the rounding"
    error = [((answer(fit, test, n) - test) ** 2).mean() for n in (1, 3, 30)]
    assert error[0] > error[1] > error[2], "more components must leave less squared error"
    alone = answer(fit, test[:5], 3)
    assert np.allclose(alone, linear[:5], atol=0.05), "other images change the axes: fit the PCA to `train` alone"
    for n, found in zip((1, 3), error, strict=False):
        least = _least_error(fit.reshape(80, -1), test.reshape(40, -1), n)
        message = f"{n} axes through the mean of `train` leave a squared error of {least:.4f}, yours {found:.4f}"
        assert found > 0.95 * least, message + ": have you taken more axes, or fitted them to other images?"
        assert found < 1.05 * least, message + ": is the mean subtracted before, and added again after?"


def _least_error(fit: np.ndarray, test: np.ndarray, n: int) -> float:
    """Squared error of `test` `[M, D]` after projection onto n principal axes of `fit` `[N, D]`."""
    mean = fit.mean(axis=0)
    vectors = np.linalg.eigh((fit - mean) @ (fit - mean).T)[1][:, -n:]  # N numbers are far fewer than D
    axes = vectors.T @ (fit - mean)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.square(test - mean - (test - mean) @ axes.T @ axes).mean()


@check(number("a distance in pixels"))
def chamfer_by_hand(answer: Callable) -> None:
    """A large and a small rectangle that overlap, for which every usual slip has another value; then an L."""
    a, b = np.zeros((2, HEIGHT, WIDTH), bool)
    a[10:22, 40:44] = b[20:23, 42:49] = True
    bent = a | b
    found, other = answer(a, b), answer(bent, b)
    truth, other_truth = chamfer_distance(a, b), chamfer_distance(bent, b)
    otherwise = f"two rectangles are {truth:.4f} pixels apart, not {found:.4f}"
    if found and np.isclose(found / truth, other / other_truth, rtol=1e-4):
        otherwise = f"{found / truth:.4g} times the distance: the unit is the side of one pixel"
    expect(found, truth, otherwise, _chamfer_slips(a, b), rtol=1e-4)
    expect(other, other_truth, "right for two rectangles, wrong for an L and one of its legs", rtol=1e-4)
    expect(answer(a, a), 0, "a mask is at distance 0 from itself")


def _chamfer_slips(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """What is easily written in place of the chamfer distance: what the reader is told, and the value."""
    pixels = np.argwhere(a), np.argwhere(b)
    d = cdist(*pixels)
    city = cdist(*pixels, "cityblock")
    there, back = d.min(axis=1), d.min(axis=0)
    return {
        "that is one direction only, from a to b": there.mean(),
        "both directions, but added: halve it": there.mean() + back.mean(),
        "that is the largest distance (Hausdorff's): take the mean over the pixels": max(there.max(), back.max()),
        "a sum over the pixels: take the mean, or large masks would be farther away": (there.sum() + back.sum()) / 2,
        "the mean over all pairs: each pixel counts its nearest partner alone": d.mean(),
        "steps along rows and columns: distances are Euclidean": (city.min(axis=1).mean() + city.min(axis=0).mean())
        / 2,
    }
