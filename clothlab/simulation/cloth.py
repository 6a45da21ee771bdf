"""Cloths as point masses and springs, and their MuJoCo elements (paper, section
"Experimental Setup").
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import mujoco
import numpy as np

from clothlab._validation import Checked, check_kind, check_number, choose, setting

DAMPINGS = (0.03, 0.05, 0.07)  # C_damp [N s/m], the paper's three values
MASSES = (0.05, 0.10, 0.15)  # C_mass [kg], the paper's three values

_FRONT_RGBA = (0.85, 0.07, 0.10, 1.0)
_BACK_RGBA = (0.10, 0.25, 0.65, 1.0)


@dataclass(frozen=True)
class Cloth(Checked):
    """A rectangular cloth: a grid of point masses joined by springs, its first row held
    by the hand.

    The paper varies `damping` and `mass`. It does not give the other values, which are
    this project's choice.
    """

    name: str
    # C_damp: drag on each point mass
    damping: float = setting(0.05, "N s/m", at_least=0)
    # C_mass: the whole cloth
    mass: float = setting(0.10, "kg", at_least=1e-3, at_most=10)
    length: float = setting(0.50, "m", above=0)  # from the hand to the free edge
    width: float = setting(0.40, "m", above=0)  # along the hand bar
    rows: int = setting(6, at_least=2, at_most=100)  # point masses along the length
    columns: int = setting(3, at_least=2, at_most=100)  # point masses across the width
    stiffness: float = setting(100.0, "N/m", above=0)  # structural and shear springs
    bending: float = setting(0.5, "N/m", at_least=0)  # springs that skip one point
    # Dashpot beside every spring
    spring_damping: float = setting(0.2, "N s/m", at_least=0)
    foam: str = setting("")  # kind of the foam it is made of, if any
    sheets: int = setting(1, at_least=1)  # of that foam

    @property
    def point_mass(self) -> float:
        """Mass of one point [kg]."""
        return self.mass / (self.rows * self.columns)

    @property
    def terminal_speed(self) -> float:
        """Speed at which drag and weight are equal [m/s]; infinite without drag."""
        return 9.81 * self.point_mass / self.damping if self.damping else float("inf")

    @property
    def label(self) -> str:
        """What figures and menus call it: the foam's name, or (C_damp [N s/m], C_mass
        [kg]).
        """
        if self.foam:
            kind = f"{self.foam}-{self.sheets}"
            # Of another thickness: "hard-2-1.5mm"
            return self.name if self.name.startswith(kind) else kind
        return (
            f"({_two_digits_or_three(self.damping)}, {_two_digits_or_three(self.mass)})"
        )


def _two_digits_or_three(value: float) -> str:
    return f"{value:.2f}" if abs(value - round(value, 2)) < 1e-9 else f"{value:.3f}"


def cloth_name(damping: float, mass: float) -> str:
    """Name of a simulated cloth, such as `damp0.03-mass0.10`, from C_damp [N s/m] and
    C_mass [kg].
    """
    check_number("C_damp", damping, at_least=0)
    check_number("C_mass", mass, above=0)
    return f"damp{damping:.2f}-mass{mass:.2f}"


CLOTHS = {  # the nine of the paper's simulation
    cloth_name(damping, mass): Cloth(
        cloth_name(damping, mass), damping=damping, mass=mass
    )
    for damping, mass in product(DAMPINGS, MASSES)
}


@dataclass(frozen=True)
class FoamSheet(Checked):
    """A sheet of polyethylene foam: thickness from the paper, density and modulus such
    as these foams are sold with.
    """

    thickness: float = setting(unit="m", above=0)
    density: float = setting(unit="kg/m³", above=0)
    modulus: float = setting(unit="Pa", above=0)  # Young's


SHEETS = {
    "soft": FoamSheet(thickness=0.005, density=30.0, modulus=0.3e6),
    "hard": FoamSheet(thickness=0.002, density=120.0, modulus=3.0e6),
}
_AIR_DENSITY = 1.2  # [kg/m³]
_DRAG_COEFFICIENT = 1.2  # of a plate across the wind
# [m/s], at which the air's drag, which grows with the square of the speed, is made
# linear
_SWING_SPEED = 2.0
# [rad] between neighbouring rows, at which a bending spring stores what the bent sheets
# do
_BEND = 1.0


def foam(kind: str, sheets: int, sheet: FoamSheet | None = None) -> Cloth:
    """A cloth of loose sheets, `soft` or `hard`: mass and stiffness grow with their
    number, the drag does not.
    """
    sheet = (
        choose("foam", kind, SHEETS)
        if sheet is None
        else check_kind("sheet", sheet, FoamSheet)
    )
    check_number("sheets", sheets, int, at_least=1)
    base = Cloth(f"{kind}-{sheets}", foam=kind, sheets=sheets)
    area, spacing = base.length * base.width, base.length / (base.rows - 1)
    drag = _AIR_DENSITY * _DRAG_COEFFICIENT * area * _SWING_SPEED / 2
    # A column of sheet bent by an angle φ between two rows stores E t³/12 · φ²/2 ·
    # column width / spacing, and the spring across them, which the bend shortens by
    # spacing · φ²/4, stores k/2 · (that)². Equal at φ = _BEND.
    rigidity = sheet.modulus * sheet.thickness**3 / 12 * base.width / base.columns
    return replace(
        base,
        mass=sheets * sheet.density * sheet.thickness * area,
        damping=drag / (base.rows * base.columns),
        bending=sheets * 16 * rigidity / (spacing**3 * _BEND**2),
        stiffness=sheets
        # Real foam stretches less, but so light a cloth would need a smaller time step
        * 60.0,
        spring_damping=sheets * 0.05,
    )


FOAMS = {
    cloth.name: cloth
    for cloth in (
        *(foam("soft", n) for n in (1, 2)),
        *(foam("hard", n) for n in (1, 2, 3)),
    )
}


def get_cloth(cloth: Cloth | str) -> Cloth:
    """Return the cloth of that name; a cloth is returned as it is."""
    return cloth if isinstance(cloth, Cloth) else choose("cloth", cloth, CLOTHS | FOAMS)


def point_names(cloth: Cloth) -> list[list[str]]:
    """Names of the point-mass bodies, `[rows][columns]`; row 0 is the one in the hand."""
    return [[f"cloth_{i}_{j}" for j in range(cloth.columns)] for i in range(cloth.rows)]


def add_cloth(
    spec: mujoco.MjSpec,
    cloth: Cloth,
    hand: mujoco.MjsBody | None,
    hand_position: np.ndarray,
    *,
    front_forward: bool = True,
    back_rgba: tuple[float, ...] = _BACK_RGBA,
) -> None:
    """Hang the cloth in a scene from the body `hand`, or from nothing, so that it
    falls.

    Free points are bodies of the world with three slide joints, so that their
    coordinates are the world's and the damping of those joints is a drag against still
    air: C_damp. (Notebook 01 compares this with the other reading, damping in the
    springs.) `hand_position` [m] is where the middle of the first row is when every
    joint is at zero; `front_forward` turns the red front away from the robot.
    """
    hanging = hanging_points(cloth)
    for i, row in enumerate(point_names(cloth)):
        for name, offset in zip(row, hanging[i], strict=True):
            if i == 0 and hand is not None:
                body = hand.add_body(name=name, pos=offset)
            else:
                body = _add_free_body(spec, cloth, name, hand_position + offset)
            # A sphere gives the point its mass; it neither collides nor shows: the
            # surface is drawn by a skin.
            sphere = {
                "type": mujoco.mjtGeom.mjGEOM_SPHERE,
                "size": [0.005, 0, 0],
                "contype": 0,
                "conaffinity": 0,
            }
            body.add_geom(mass=cloth.point_mass, group=4, **sphere)
            body.add_site(name=name, size=[0.001, 0, 0], group=4)
    for a, b, stiffness in springs(cloth, held=hand is not None):
        _add_spring(spec, cloth, a, b, stiffness)
    front_and_back = (_FRONT_RGBA, back_rgba)
    _add_surface(
        spec,
        cloth,
        hand_position + hanging,
        front_and_back if front_forward else front_and_back[::-1],
    )


def hanging_points(cloth: Cloth) -> np.ndarray:
    """Where the points are below the hand when the cloth hangs unstretched, `[rows,
    columns, 3]` [m].
    """
    y = np.linspace(-0.5, 0.5, cloth.columns) * cloth.width
    z = np.linspace(0.0, -cloth.length, cloth.rows)
    return np.stack(np.broadcast_arrays(0.0, y, z[:, None]), axis=-1)


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


def springs(cloth: Cloth, *, held: bool = True) -> Iterator[tuple[str, str, float]]:
    """Yield `(point, point, stiffness [N/m])` for structural, shear and bending
    springs.

    Without those within the first row if it is `held` in a rigid bar, where they would
    do nothing.
    """
    names = point_names(cloth)
    kinds = [
        (cloth.stiffness, [(1, 0), (0, 1), (1, 1), (1, -1)]),
        (cloth.bending, [(2, 0), (0, 2)]),
    ]
    for stiffness, steps in kinds:
        for (di, dj), i, j in product(steps, range(cloth.rows), range(cloth.columns)):
            end_i, end_j = i + di, j + dj
            inside = end_i < cloth.rows and 0 <= end_j < cloth.columns
            if inside and (end_i > 0 or not held):
                yield names[i][j], names[end_i][end_j], stiffness


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
    colours: tuple[tuple[float, ...], tuple[float, ...]],
) -> None:
    """Draw the cloth: a skin shows one side only, so two of opposite winding: away from
    the robot, to it.
    """
    names = [name for row in point_names(cloth) for name in row]
    corner = np.array(
        [
            i * cloth.columns + j
            for i in range(cloth.rows - 1)
            for j in range(cloth.columns - 1)
        ]
    )
    right, below = corner + 1, corner + cloth.columns
    front = np.stack([corner, below, right, right, below, below + 1], axis=1).reshape(
        -1, 3
    )
    for side, faces, rgba in zip(
        ("away", "towards"), (front, front[:, ::-1]), colours, strict=True
    ):
        spec.add_skin(
            name=f"cloth_{side}",
            rgba=rgba,
            vert=rest.ravel(),
            face=faces.ravel(),
            bodyname=names,
            bindpos=rest.ravel(),
            bindquat=np.tile([1.0, 0, 0, 0], len(names)),
            vertid=[[k] for k in range(len(names))],
            vertweight=[[1.0] for _ in names],
        )
