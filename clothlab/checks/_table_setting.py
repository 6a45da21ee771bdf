"""Checks of notebook 13."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect


def _pinhole(
    pixel: tuple[int, int],
    depth: float,
    size: tuple[int, int],
    focal: float,
    shift: float,
) -> np.ndarray:
    """Where a pixel's surface is, for a focal length [pixel] and where in a pixel its
    middle is.
    """
    right, down = pixel[1] + shift - size[1] / 2, pixel[0] + shift - size[0] / 2
    return depth * np.array([right / focal, -down / focal, -1.0])


@check(array("a point: right, up, backward", 3))
def point_of_pixel(answer: Callable, rng: np.random.Generator) -> None:
    """Pixels near three corners of wide pictures."""

    def draw() -> tuple[tuple[int, int], float, tuple[int, int], float]:
        size = 2 * int(rng.integers(3, 6)), 2 * int(rng.integers(6, 9))
        pixel = int(rng.integers(size[0])), int(rng.integers(size[1]))
        return (
            pixel,
            round(rng.uniform(0.5, 1.8), 2),
            size,
            round(rng.uniform(40.0, 80.0), 1),
        )

    for _ in range(3):
        pixel, depth, size, fovy = drawn(
            draw, lambda case: apart(*_points(*case), rtol=0.01)
        )
        truth, slips = _points(pixel, depth, size, fovy)
        found = answer(*pixel, depth, size, fovy)
        where = f"row {pixel[0]}, column {pixel[1]} of {size[0]}×{size[1]} pixels, {depth} m deep, fovy {fovy:g}°"
        expect(
            found,
            truth,
            f"{where}: that is {truth.round(3)}, not {found.round(3)}",
            slips,
        )


def _points(
    pixel: tuple[int, int], depth: float, size: tuple[int, int], fovy: float
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The point [3] that a pixel shows, and what usual slips give: what the reader is
    told, and the value.
    """
    half = np.deg2rad(fovy) / 2
    focal, ratio = size[0] / 2 / np.tan(half), size[1] / size[0]
    truth = _pinhole(pixel, depth, size, focal, 0.5)
    corner = _pinhole(pixel, depth, size, focal, 0.0)
    whole, degrees = (
        _pinhole(pixel, depth, size, size[0] / 2 / np.tan(x), 0.5)
        for x in (2 * half, fovy / 2)
    )
    return truth, {
        "rows and columns count from the corner of a pixel, and its middle is half a pixel away": corner,
        "rows count downwards: what is higher has a smaller row": truth * [1, -1, 1],
        "the camera looks along its minus z axis: what is ahead has a negative third number": truth
        * [1, 1, -1],
        "depth is measured along the camera's axis, not along the ray": truth
        * depth
        / np.linalg.norm(truth),
        "fovy spans the picture's height, not its width": truth / [ratio, ratio, 1],
        "half of the picture's height is seen under half of fovy": whole,
        "np.tan takes radians": degrees,
    }


@check(array("a, b and c of the plane z = a x + b y + c", 3))
def plane_of_most(answer: Callable, rng: np.random.Generator) -> None:
    """A table without and with things on its far end, level and slanted, seen with a
    noise of 2 mm.
    """
    level = 0.0, 0.0, rng.uniform(0.4, 0.7)
    slanted = rng.uniform((0.08, -0.12, 0.3), (0.12, -0.06, 0.5))
    for plane, share in ((level, 0.0), (level, 0.35), (slanted, 0.35)):
        x, y = rng.uniform(0.3, 1.0, 900), rng.uniform(-0.5, 0.5, 900)
        columns = np.column_stack([x, y, np.ones(900)])
        z = columns @ plane + rng.normal(0, 0.002, 900)
        things = x >= np.quantile(x, 1 - share)
        z[things] += rng.uniform(0.05, 0.3, things.sum()) if share else 0.0
        fitted = np.linalg.lstsq(columns, z, rcond=None)[0]
        slips = {
            "least squares over all points are pulled up by what stands on the table": fitted,
            "a table may be slanted: a median height is no plane": np.array(
                [0.0, 0.0, np.median(z)]
            ),
            "first the slopes, then the height": np.roll(plane, 1),
        }
        found = answer(np.column_stack([x, y, z]))
        message = f"most points lie on the plane {np.round(plane, 2)}, not {found.round(2)}; {share:.0%} are others"
        expect(found, plane, message, slips, atol=0.006)
