"""Checks of notebook 04."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check
from clothlab.vision import HEIGHT, WIDTH

__all__ = ["handmade", "linear_reconstruction", "touching"]


@check
def handmade(answer: Callable) -> None:
    """An empty mask, and a rectangle of 10 × 4 pixels."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    assert np.array_equal(answer(mask), np.zeros(3)), "an empty mask gives three zeros"
    mask[10:20, 40:44] = True
    area, column, row = answer(mask)
    assert area == 40, f"10 rows of 4 pixels are 40 pixels, got {area}"
    assert (column, row) == (41.5, 14.5), f"the centre is at column 41.5, row 14.5; got {column}, {row}"


@check
def linear_reconstruction(answer: Callable) -> None:
    """A square at random places: what must be true of every PCA."""
    corners = np.random.default_rng(0).integers(20, 40, (120, 2, 1))
    rows, columns = (np.abs(np.arange(size) - corners[:, k] - 10) < 12 for k, size in enumerate((HEIGHT, WIDTH)))
    images = rows[:, :, None] & columns[:, None, :]
    fit, test = images[:80], images[80:]
    linear = answer(fit, test, 3)
    assert linear is not None, "the function returns nothing"
    assert linear.shape == test.shape, f"the shape is {test.shape}, got {linear.shape}"
    error = [((answer(fit, test, n) - test) ** 2).mean() for n in (1, 3, 30)]
    assert error[0] > error[1] > error[2], "more components must leave less squared error"
    assert error[1] < ((fit.mean(axis=0) - test) ** 2).mean(), "three components must beat the mean image"
    alone = answer(fit, test[:5], 3)
    assert np.allclose(alone, linear[:5], atol=0.05), "other images change the axes: fit the PCA to `train` alone"


@check
def touching(answer: Callable) -> None:
    """Four masks: a pixel, a column, a block and nothing."""
    masks = np.zeros((4, HEIGHT, WIDTH), bool)
    masks[0, 5, 5] = masks[1, :, 5] = masks[2, 50:, :] = True
    assert answer(masks, masks[0]) == 0.5, "two of these four masks contain the pixel (5, 5): the share is 0.5"
    assert answer(masks, masks[3]) == 0, "nothing overlaps an empty target"
    assert answer(masks[:3], masks[1]) == 1, "all three overlap the column 5"
