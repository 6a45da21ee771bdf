"""The points of a cloth and the springs between them, by their names."""

from collections.abc import Iterator
from itertools import product

from clothlab.simulation.cloth import Cloth


def point_names(cloth: Cloth) -> list[list[str]]:
    """Names of the point-mass bodies, `[rows][columns]`; row 0 is in the hand."""
    return [[f"cloth_{i}_{j}" for j in range(cloth.columns)] for i in range(cloth.rows)]


def springs(cloth: Cloth, *, held: bool = True) -> Iterator[tuple[str, str, float]]:
    """Yield `(point, point, stiffness [N/m])` of structural, shear and bending springs.

    Without those within the first row if it is `held` in a rigid bar, where they would
    do nothing.
    """
    structural_and_shear = [(1, 0), (0, 1), (1, 1), (1, -1)]
    bending = [(2, 0), (0, 2)]
    steps = [(cloth.stiffness, step) for step in structural_and_shear]
    steps += [(cloth.bending, step) for step in bending]

    names = point_names(cloth)
    for stiffness, (down, across) in steps:
        for i, j in product(range(cloth.rows), range(cloth.columns)):
            end_i = i + down
            end_j = j + across
            inside = end_i < cloth.rows and 0 <= end_j < cloth.columns
            if inside and (end_i > 0 or not held):
                yield names[i][j], names[end_i][end_j], stiffness
