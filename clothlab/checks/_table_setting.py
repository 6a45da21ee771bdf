"""Checks of notebook 13."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect


class _View(NamedTuple):
    """A pixel of a depth image."""

    row: int
    column: int
    depth: float  # [m], along the camera's axis
    size: tuple[int, int]  # height and width of the image [pixel]
    fovy: float  # vertical field of view [°]


@check(array("a point: right, up, backward", 3))
def point_of_pixel(answer: Callable, rng: np.random.Generator) -> None:
    """Where a pixel of a depth image lies, seen from the camera `[3]` [m].

    Given are its row and column, its depth [m], height and width of the image [pixel],
    and its vertical field of view [°]; expected are metres to the right, up, and
    backward. The pixels are any of three small, wide images.
    """
    for _ in range(3):
        view = drawn(lambda: _view(rng), lambda view: apart(*_points(view), rtol=0.01))
        truth, slips = _points(view)
        found = answer(*view)
        height, width = view.size
        otherwise = (
            f"row {view.row}, column {view.column} of {height}×{width} pixels, "
            f"{view.depth} m deep, fovy {view.fovy:g}°: that is {truth.round(3)}, "
            f"not {found.round(3)}"
        )
        expect(found, truth, otherwise, slips)


def _view(rng: np.random.Generator) -> _View:
    height = 2 * int(rng.integers(3, 6))
    width = 2 * int(rng.integers(6, 9))
    row = int(rng.integers(height))
    column = int(rng.integers(width))
    depth = round(rng.uniform(0.5, 1.8), 2)
    fovy = round(rng.uniform(40.0, 80.0), 1)
    return _View(row, column, depth, (height, width), fovy)


def _points(view: _View) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The point [3] that a pixel shows, and what usual slips give, by what is said."""
    # The truth, by the pinhole model
    height, width = view.size
    half = np.deg2rad(view.fovy) / 2
    focal = height / 2 / np.tan(half)
    truth = _pinhole(view, focal)

    # Other focal lengths, places in a pixel, and meanings of depth
    of_a_corner = _pinhole(view, focal, middle=0.0)
    of_whole_fovy = _pinhole(view, height / 2 / np.tan(2 * half))
    of_degrees = _pinhole(view, height / 2 / np.tan(view.fovy / 2))
    along_the_ray = truth * view.depth / np.linalg.norm(truth)
    ratio = width / height

    # What is said of each
    return truth, {
        "rows and columns count from the corner of a pixel, and its middle is half a "
        "pixel away": of_a_corner,
        "rows count downwards: what is higher has a smaller row": truth * [1, -1, 1],
        "the camera looks along its minus z axis: what is ahead has a negative third "
        "number": truth * [1, 1, -1],
        "depth is measured along the camera's axis, not along the ray": along_the_ray,
        "fovy spans the picture's height, not its width": truth / [ratio, ratio, 1],
        "half of the picture's height is seen under half of fovy": of_whole_fovy,
        "np.tan takes radians": of_degrees,
    }


def _pinhole(view: _View, focal: float, middle: float = 0.5) -> np.ndarray:
    """Where a pixel's surface is, for a focal length [pixel].

    `middle` is where the middle of a pixel lies in it, from its upper left corner.
    """
    height, width = view.size
    right = view.column + middle - width / 2
    down = view.row + middle - height / 2
    return view.depth * np.array([right / focal, -down / focal, -1.0])


@check(array("a, b and c of the plane z = a x + b y + c", 3))
def plane_of_most(answer: Callable, rng: np.random.Generator) -> None:
    """The plane on which most points lie, `[a, b, c]` of z = a x + b y + c.

    Given are 900 points `[N, 3]` [m] of a table that were seen with a noise of 2 mm:
    bare and level, with things on its far end, then slanted, too.
    """
    level = (0.0, 0.0, rng.uniform(0.4, 0.7))
    slanted = rng.uniform((0.08, -0.12, 0.3), (0.12, -0.06, 0.5))
    for plane, share in ((level, 0.0), (level, 0.35), (slanted, 0.35)):
        # The table, and what stands on a share of it
        x = rng.uniform(0.3, 1.0, 900)
        y = rng.uniform(-0.5, 0.5, 900)
        columns = np.column_stack([x, y, np.ones(900)])
        z = columns @ plane + rng.normal(0, 0.002, 900)
        things = x >= np.quantile(x, 1 - share)
        if share:
            z[things] += rng.uniform(0.05, 0.3, things.sum())

        # Planes that are easily taken for it
        fitted_to_all, *_ = np.linalg.lstsq(columns, z, rcond=None)
        median_height = np.array([0.0, 0.0, np.median(z)])
        slips = {
            "least squares over all points are pulled up by what stands on the "
            "table": fitted_to_all,
            "a table may be slanted: a median height is no plane": median_height,
            "first the slopes, then the height": np.roll(plane, 1),
        }
        found = answer(np.column_stack([x, y, z]))
        otherwise = (
            f"most points lie on the plane {np.round(plane, 2)}, "
            f"not {found.round(2)}; {share:.0%} are others"
        )
        expect(found, plane, otherwise, slips, atol=0.006)
