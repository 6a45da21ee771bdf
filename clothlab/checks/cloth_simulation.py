"""Checks of notebook 01."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, number
from clothlab.cloth import Cloth, get_cloth, point_names, springs

__all__ = ["count_springs", "euler_step", "time_to_reach"]


@check(array("three numbers, structural, shear and bending", 3))
def count_springs(answer: Callable) -> None:
    """Compare with the springs that clothlab puts into cloths of three sizes."""
    for rows, columns in ((6, 3), (4, 4), (9, 2)):
        found = answer(rows, columns)
        total = len(list(springs(Cloth("any", rows=rows, columns=columns))))
        structural, shear = (rows - 1) * (2 * columns - 1), 2 * (rows - 1) * (columns - 1)
        assert found[0] == structural, f"{rows} × {columns}: {structural} structural springs, not {found[0]}"
        assert sum(found) == total, f"{rows} × {columns} has {total} springs in all, yours add up to {sum(found)}"
        assert found[1] == shear, f"{rows} × {columns}: {shear} shear springs, two in each square, not {found[1]}"


@check(number("a time in seconds"))
def time_to_reach(answer: Callable) -> None:
    """Put the time into the speed of a fall, v(t) = v_end (1 - exp(-c t / m))."""
    for name, share in (("damp0.03-mass0.15", 0.5), ("damp0.07-mass0.05", 0.9)):
        cloth, t = get_cloth(name), answer(get_cloth(name), share)
        reached = 1 - np.exp(-cloth.damping * t / cloth.point_mass)
        message = f"{name} has {reached:.0%} of its terminal speed after your {t:.3f} s, not {share:.0%}"
        assert abs(reached - share) < 0.02, message + "; did you use the mass of one point?"


@check(array("the new positions and the new velocities", 2, 18, 3))
def euler_step(answer: Callable) -> None:
    """One step from a cloth that is pushed together and moves at random."""
    cloth, dt = get_cloth("damp0.05-mass0.10"), 0.001  # [s]
    start = _flat(cloth)
    x = start @ np.diag([1.0, 1.0, 0.8]) + [0.0, 0.0, 0.01]
    v = np.random.default_rng(0).normal(size=x.shape) * 0.1 * (start[:, 2:] < 0)
    found = answer(cloth, x, v, dt)
    free_v = (v + dt * acceleration(cloth, x, v))[3:]
    assert not found[1][:3].any(), "the first row, three points, is held: its velocity stays zero"
    assert np.array_equal(found[0][:3], x[:3]), "the first row, three points, is held: it does not move"
    assert np.allclose(found[1][3:], free_v), "new velocities are v + dt · acceleration(cloth, x, v)"
    assert not np.allclose(found[0][3:], (x + dt * v)[3:]), "move the points with the new velocities, not the old"
    assert np.allclose(found[0][3:], x[3:] + dt * free_v), "new positions are x + dt · new velocity"


def acceleration(cloth: Cloth, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Newton's law for every point, as the notebook has it: `[N, 3]` [m] and [m/s] -> `[N, 3]` [m/s²]."""
    index = {name: k for k, name in enumerate(np.ravel(point_names(cloth)))}
    start = _flat(cloth)
    force = np.array([0.0, 0.0, -9.81]) * cloth.point_mass - cloth.damping * v
    for a, b, stiffness in springs(cloth):
        a, b = index[a], index[b]
        length, rest = np.linalg.norm(x[b] - x[a]), np.linalg.norm(start[b] - start[a])
        n = (x[b] - x[a]) / length
        tension = stiffness * (length - rest) + cloth.spring_damping * (v[b] - v[a]) @ n
        force[a] += tension * n
        force[b] -= tension * n
    return force / cloth.point_mass


def _flat(cloth: Cloth) -> np.ndarray:
    """The points of a cloth that hangs flat, every spring at rest, `[N, 3]` [m]."""
    along, across = cloth.length / (cloth.rows - 1), cloth.width / (cloth.columns - 1)
    i, j = np.divmod(np.arange(cloth.rows * cloth.columns), cloth.columns)
    return np.stack([0.0 * i, (j - (cloth.columns - 1) / 2) * across, -i * along], axis=1)
