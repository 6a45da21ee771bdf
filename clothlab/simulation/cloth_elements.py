"""A cloth in MuJoCo: bodies, joints, tendons for springs, and a skin on each side."""

from collections.abc import Iterator
from itertools import product

import mujoco
import numpy as np

from clothlab.simulation.cloth import Cloth, hanging_points

_FRONT_RGBA = (0.85, 0.07, 0.10, 1.0)
_BACK_RGBA = (0.10, 0.25, 0.65, 1.0)


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


def add_cloth(
    spec: mujoco.MjSpec,
    cloth: Cloth,
    hand: mujoco.MjsBody | None,
    hand_position: np.ndarray,
    *,
    front_forward: bool = True,
    back_rgba: tuple[float, ...] = _BACK_RGBA,
) -> None:
    """Hang the cloth in a scene from the body `hand`, or from nothing: then it falls.

    Free points are bodies of the world with three slide joints, so that their
    coordinates are the world's and the damping of those joints is a drag against still
    air: C_damp.

    Args:
        spec: The scene.
        cloth: The cloth.
        hand: The body that holds the first row, if any does.
        hand_position: Where the middle of the first row is when every joint is at zero,
            `[3]` [m].
        front_forward: Whether the red front is turned away from the robot.
        back_rgba: The colour of the other side.
    """
    # The points
    hanging = hanging_points(cloth)
    for i, row in enumerate(point_names(cloth)):
        for name, offset in zip(row, hanging[i], strict=True):
            if i == 0 and hand is not None:
                body = hand.add_body(name=name, pos=offset)
            else:
                body = _add_free_body(spec, cloth, name, hand_position + offset)
            _add_mass(body, name, cloth.point_mass)

    # What joins them
    for a, b, stiffness in springs(cloth, held=hand is not None):
        _add_spring(spec, cloth, a, b, stiffness)

    # What is seen of them
    rest = hand_position + hanging
    if front_forward:
        _add_surface(spec, cloth, rest, away=_FRONT_RGBA, towards=back_rgba)
    else:
        _add_surface(spec, cloth, rest, away=back_rgba, towards=_FRONT_RGBA)


def _add_free_body(
    spec: mujoco.MjSpec, cloth: Cloth, name: str, position: np.ndarray
) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(name=name, pos=position)
    for axis_name, axis in zip("xyz", np.eye(3), strict=True):
        body.add_joint(
            name=f"{name}_{axis_name}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            damping=[cloth.damping, 0, 0],
        )
    return body


def _add_mass(body: mujoco.MjsBody, name: str, mass: float) -> None:
    """Give a point its mass [kg], by a sphere that neither collides nor shows.

    The surface of the cloth is drawn by a skin.
    """
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[0.005, 0, 0],
        mass=mass,
        contype=0,
        conaffinity=0,
        group=4,
    )
    body.add_site(name=name, size=[0.001, 0, 0], group=4)


def _add_spring(
    spec: mujoco.MjSpec, cloth: Cloth, a: str, b: str, stiffness: float
) -> None:
    tendon = spec.add_tendon(
        name=f"{a}-{b}",
        stiffness=[stiffness, 0, 0],
        damping=[cloth.spring_damping, 0, 0],
        group=4,
    )
    tendon.wrap_site(a)
    tendon.wrap_site(b)


def _add_surface(
    spec: mujoco.MjSpec,
    cloth: Cloth,
    rest: np.ndarray,
    away: tuple[float, ...],
    towards: tuple[float, ...],
) -> None:
    """Draw the cloth, in one colour away from the robot and in another towards it."""
    # Two triangles in each square of points, from its corner
    corners = []
    for i, j in product(range(cloth.rows - 1), range(cloth.columns - 1)):
        corners.append(i * cloth.columns + j)
    corner = np.array(corners)
    right = corner + 1
    below = corner + cloth.columns
    triangles = np.stack([corner, below, right, right, below, below + 1], axis=1)
    faces = triangles.reshape(-1, 3)

    # A skin shows one side only: two of them, of opposite winding.
    _add_skin(spec, "cloth_away", cloth, rest, faces, away)
    _add_skin(spec, "cloth_towards", cloth, rest, faces[:, ::-1], towards)


def _add_skin(
    spec: mujoco.MjSpec,
    name: str,
    cloth: Cloth,
    rest: np.ndarray,
    faces: np.ndarray,
    rgba: tuple[float, ...],
) -> None:
    """Add a skin whose vertices are the points, each moved by its own body."""
    names = [each for row in point_names(cloth) for each in row]
    spec.add_skin(
        name=name,
        rgba=rgba,
        vert=rest.ravel(),
        face=faces.ravel(),
        bodyname=names,
        bindpos=rest.ravel(),
        bindquat=np.tile([1.0, 0, 0, 0], len(names)),
        vertid=[[k] for k in range(len(names))],
        vertweight=[[1.0]] * len(names),
    )
