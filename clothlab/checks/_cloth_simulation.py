"""Checks of notebook 01."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, check, expect
from clothlab.simulation._lattice import springs
from clothlab.simulation.cloth import Cloth, get_cloth, hanging_points

_CLOTH = get_cloth("damp0.05-mass0.10")  # in the middle of the trained ones
_GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s²]


@check(array("three numbers, structural, shear and bending", 3))
def count_springs(answer: Callable, rng: np.random.Generator) -> None:
    """How many springs of each kind a cloth has.

    Given are the rows and columns of four cloths; expected is what clothlab itself puts
    into them.
    """
    for _ in range(4):
        rows = int(rng.integers(4, 10))
        columns = int(rng.integers(3, 8))
        found = answer(rows, columns)

        # The truth, and each kind's usual slip
        truth = _springs_of_each_kind(rows, columns)
        held = "the first row is held: no spring lies within it"
        slips = {
            "structural": (held, truth["structural"] + columns - 1),
            "shear": (
                "each square of four points has two diagonals",
                truth["shear"] / 2,
            ),
            "bending": (held, truth["bending"] + columns - 2),
        }

        # The right numbers in the wrong places, then kind by kind
        right = list(truth.values())
        ordered = np.array_equal(sorted(found), sorted(right))
        assert not ordered or np.array_equal(found, right), (
            "these are the right numbers in another order: structural, shear, bending"
        )
        for (kind, wanted), count in zip(truth.items(), found, strict=True):
            otherwise = (
                f"{rows} × {columns} points have {wanted} {kind} springs, not {count:g}"
            )
            advice, slip = slips[kind]
            expect(count, wanted, otherwise, {f"{otherwise}; {advice}": slip})


def _springs_of_each_kind(rows: int, columns: int) -> dict[str, int]:
    """Springs of a cloth whose first row is held, so that none lies within that row."""
    cloth = Cloth("any", rows=rows, columns=columns)
    total = len(list(springs(cloth)))
    structural = (rows - 1) * (2 * columns - 1)
    shear = 2 * (rows - 1) * (columns - 1)
    return {
        "structural": structural,
        "shear": shear,
        "bending": total - structural - shear,
    }


@check(array("the new positions and the new velocities", 2, 6, 3, 3))
def euler_step(answer: Callable, rng: np.random.Generator) -> None:
    """One step of semi-implicit Euler: new positions [m] and velocities [m/s].

    Given is a cloth of 6 × 3 points that is pushed together and moves at random, its
    first row at rest, and a time step [s] that is none of the notebook's.
    """
    dt = rng.uniform(0.0015, 0.0025)
    pushed_together = [1.0, 1.0, rng.uniform(0.75, 0.85)]
    x = hanging_points(_CLOTH) * pushed_together + [0.0, 0.0, 0.01]
    v = 0.1 * rng.normal(size=x.shape)
    v[0] = 0.0
    new_x, new_v = answer(_CLOTH, x, v, dt)

    # The truth for all points that the hand does not hold
    a = acceleration(_CLOTH, x, v)
    free_v = (v + dt * a)[1:]
    free_x = x[1:] + dt * free_v
    assert not np.allclose(new_v[1:], free_x), (
        "first the positions, then the velocities"
    )

    # Velocities first: wrong ones make wrong positions
    slips = {"the accelerations are not yet multiplied by the time step": (v + a)[1:]}
    otherwise = "new velocities are v + dt · acceleration(cloth, x, v)"
    expect(new_v[1:], free_v, otherwise, slips)
    slips = {"move the points with the new velocities, not the old": (x + dt * v)[1:]}
    otherwise = "new positions are x + dt · new velocity"
    expect(new_x[1:], free_x, otherwise, slips)
    assert not new_v[0].any(), "the hand holds the first row: its velocity stays zero"


def acceleration(cloth: Cloth, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Accelerations `[rows, columns, 3]` [m/s²] by Newton's law, as in the notebook.

    Positions `x` [m] and velocities `v` [m/s] are `[rows, columns, 3]`, too.
    """
    start = hanging_points(cloth)
    force = _GRAVITY * cloth.point_mass - cloth.damping * v
    for *ends, stiffness in springs(cloth):
        a, b = (tuple(map(int, name.split("_")[1:])) for name in ends)
        rest = np.linalg.norm(start[b] - start[a])
        length = np.linalg.norm(x[b] - x[a])
        n = (x[b] - x[a]) / length  # from a to b
        damping = cloth.spring_damping * (v[b] - v[a]) @ n
        tension = stiffness * (length - rest) + damping
        force[a] += tension * n
        force[b] -= tension * n
    return force / cloth.point_mass
