"""Checks of notebook 01."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect
from clothlab.simulation.cloth import Cloth, get_cloth, hanging_points, springs

MIDDLE = get_cloth("damp0.05-mass0.10")


@check(array("three numbers, structural, shear and bending", 3))
def count_springs(answer: Callable, rng: np.random.Generator) -> None:
    """Compare with the springs that clothlab puts into cloths of four sizes."""
    for _ in range(4):
        rows, columns = int(rng.integers(4, 10)), int(rng.integers(3, 8))
        found = answer(rows, columns)
        total = len(list(springs(Cloth("any", rows=rows, columns=columns))))
        structural, shear = (
            (rows - 1) * (2 * columns - 1),
            2 * (rows - 1) * (columns - 1),
        )
        truth = {
            "structural": structural,
            "shear": shear,
            "bending": total - structural - shear,
        }
        slips = {  # what the held row adds where it is counted
            "structural": (
                "the first row is held: no spring lies within it",
                structural + columns - 1,
            ),
            "shear": ("each square of four points has two diagonals", shear / 2),
            "bending": (
                "the first row is held: no spring lies within it",
                truth["bending"] + columns - 2,
            ),
        }
        ordered = np.array_equal(
            sorted(found), sorted(truth.values())
        ) and not np.array_equal(found, [*truth.values()])
        assert not ordered, (
            "these are the right numbers in another order: structural, shear, bending"
        )
        for kind, count in zip(truth, found, strict=True):
            message = f"{rows} × {columns} points have {truth[kind]} {kind} springs, not {count:g}"
            expect(
                count,
                truth[kind],
                message,
                {f"{message}; {slips[kind][0]}": slips[kind][1]},
            )


@check(array("the new positions and the new velocities", 2, 6, 3, 3))
def euler_step(answer: Callable, rng: np.random.Generator) -> None:
    """One step from a cloth that is pushed together and moves at random, its first row
    at rest.
    """
    dt = rng.uniform(0.0015, 0.0025)  # [s], not a time step of the notebook
    x = hanging_points(MIDDLE) * [1.0, 1.0, rng.uniform(0.75, 0.85)] + [0.0, 0.0, 0.01]
    v = 0.1 * rng.normal(size=x.shape)
    v[0] = 0.0
    new_x, new_v = answer(MIDDLE, x, v, dt)
    a = acceleration(MIDDLE, x, v)
    free_v = (v + dt * a)[1:]
    assert not np.allclose(new_v[1:], x[1:] + dt * free_v), (
        "first the positions, then the velocities"
    )
    slips = {"the accelerations are not yet multiplied by the time step": (v + a)[1:]}
    expect(
        new_v[1:],
        free_v,
        "new velocities are v + dt · acceleration(cloth, x, v)",
        slips,
    )
    slips = {"move the points with the new velocities, not the old": (x + dt * v)[1:]}
    expect(
        new_x[1:], x[1:] + dt * free_v, "new positions are x + dt · new velocity", slips
    )
    assert not new_v[0].any(), "the hand holds the first row: its velocity stays zero"


def acceleration(cloth: Cloth, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Newton's law, as the notebook has it: `[rows, columns, 3]` [m] and [m/s] ->
    accelerations [m/s²].
    """
    start = hanging_points(cloth)
    force = np.array([0.0, 0.0, -9.81]) * cloth.point_mass - cloth.damping * v
    for *ends, stiffness in springs(cloth):
        a, b = (tuple(map(int, name.split("_")[1:])) for name in ends)
        length, rest = np.linalg.norm(x[b] - x[a]), np.linalg.norm(start[b] - start[a])
        n = (x[b] - x[a]) / length
        tension = stiffness * (length - rest) + cloth.spring_damping * (v[b] - v[a]) @ n
        force[a] += tension * n
        force[b] -= tension * n
    return force / cloth.point_mass
