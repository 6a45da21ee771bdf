"""Checks of notebook 01."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect
from clothlab.simulation.cloth import Cloth, get_cloth, point_names, springs


@check(array("three numbers, structural, shear and bending", 3))
def count_springs(answer: Callable) -> None:
    """Compare with the springs that clothlab puts into cloths of three sizes."""
    for rows, columns in ((6, 3), (4, 5), (9, 2)):
        found = answer(rows, columns)
        total = len(list(springs(Cloth("any", rows=rows, columns=columns))))
        structural, shear = (rows - 1) * (2 * columns - 1), 2 * (rows - 1) * (columns - 1)
        truth = {"structural": structural, "shear": shear, "bending": total - structural - shear}
        slips = {  # what the held row adds where it is counted
            "structural": ("the first row is held: no spring lies within it", structural + columns - 1),
            "shear": ("each square of four points has two diagonals", shear / 2),
            "bending": ("the first row is held: no spring lies within it", truth["bending"] + columns - 2),
        }
        ordered = np.array_equal(sorted(found), sorted(truth.values())) and not np.array_equal(found, [*truth.values()])
        assert not ordered, "these are the right numbers in another order: structural, shear, bending"
        for kind, count in zip(truth, found, strict=True):
            message = f"{rows} × {columns} points have {truth[kind]} {kind} springs, not {count:g}"
            expect(count, truth[kind], message, {f"{message}; {slips[kind][0]}": slips[kind][1]})


@check(array("the new positions and the new velocities", 2, 18, 3))
def euler_step(answer: Callable) -> None:
    """One step from a cloth that is pushed together and moves at random."""
    cloth, dt = get_cloth("damp0.05-mass0.10"), 0.002  # [s], not the time step of the stub
    start = _flat(cloth)
    x = start @ np.diag([1.0, 1.0, 0.8]) + [0.0, 0.0, 0.01]
    v = np.random.default_rng(0).normal(size=x.shape) * 0.1 * (start[:, 2:] < 0)
    new_x, new_v = answer(cloth, x, v, dt)
    a = acceleration(cloth, x, v)
    free_v = (v + dt * a)[3:]
    assert not np.allclose(new_v[3:], x[3:] + dt * free_v), "first the positions, then the velocities"
    slips = {"the accelerations are not yet multiplied by the time step": (v + a)[3:]}
    expect(new_v[3:], free_v, "new velocities are v + dt · acceleration(cloth, x, v)", slips)
    slips = {"move the points with the new velocities, not the old": (x + dt * v)[3:]}
    expect(new_x[3:], x[3:] + dt * free_v, "new positions are x + dt · new velocity", slips)
    assert not new_v[:3].any(), "the first row, three points, is held: its velocity stays zero"
    assert np.allclose(new_x[:3], x[:3]), "the first row, three points, is held: it does not move"


def acceleration(cloth: Cloth, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Newton's law for every point, as the notebook has it: `[N, 3]` [m] and [m/s] -> `[N, 3]` [m/s²]."""
    index = {name: k for k, name in enumerate(name for row in point_names(cloth) for name in row)}
    start = _flat(cloth)
    force = np.array([0.0, 0.0, -9.81]) * cloth.point_mass - cloth.damping * v
    for *ends, stiffness in springs(cloth):
        a, b = (index[name] for name in ends)
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
