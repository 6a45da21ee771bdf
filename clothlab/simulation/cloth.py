"""Cloths as point masses and springs.

They are those of the paper's section "Experimental Setup".
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from clothlab._validation import check_number, choose

DAMPINGS = (0.03, 0.05, 0.07)  # C_damp [N s/m], the paper's three values
MASSES = (0.05, 0.10, 0.15)  # C_mass [kg], the paper's three values


@dataclass(frozen=True)
class Cloth:
    """A rectangular cloth: a grid of point masses joined by springs.

    Its first row is held by the hand. The paper varies `damping` and `mass`. It does
    not give the other values, which are this project's choice.
    """

    name: str
    damping: float = 0.05  # [N s/m] C_damp, drag on each point
    mass: float = 0.10  # [kg] C_mass, the whole
    length: float = 0.50  # [m] from the hand to the free edge
    width: float = 0.40  # [m] along the hand bar
    rows: int = 6  # point masses along the length
    columns: int = 3  # point masses across the width
    stiffness: float = 100.0  # [N/m] structural and shear springs
    bending: float = 0.5  # [N/m] springs that skip one point
    # Dashpot beside every spring
    spring_damping: float = 0.2  # [N s/m]
    foam: str = ""  # kind of the foam it is made of, if any
    sheets: int = 1  # of that foam

    def __post_init__(self) -> None:
        check_number("Cloth.damping", self.damping, at_least=0)
        check_number("Cloth.mass", self.mass, at_least=1e-3, at_most=10)
        check_number("Cloth.rows", self.rows, int, at_least=2, at_most=100)
        check_number("Cloth.columns", self.columns, int, at_least=2, at_most=100)

    def __repr__(self) -> str:
        materials = f"damping={self.damping:.3g}, mass={self.mass:.3g}"
        return f"Cloth({self.name!r}, {materials}, ...)"

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
        """What figures call it: the foam, or (C_damp [N s/m], C_mass [kg])."""
        if self.foam:
            kind = f"{self.foam}-{self.sheets}"
            # Of another thickness: "hard-2-1.5mm"
            return self.name if self.name.startswith(kind) else kind
        damping = _two_digits_or_three(self.damping)
        mass = _two_digits_or_three(self.mass)
        return f"({damping}, {mass})"


def _two_digits_or_three(value: float) -> str:
    return f"{value:.2f}" if abs(value - round(value, 2)) < 1e-9 else f"{value:.3f}"


def cloth_name(damping: float, mass: float) -> str:
    """Name of a simulated cloth of C_damp [N s/m], C_mass [kg]: `damp0.03-mass0.10`."""
    check_number("C_damp", damping, at_least=0)
    check_number("C_mass", mass, above=0)
    return f"damp{damping:.2f}-mass{mass:.2f}"


def _paper_cloths() -> Iterator[Cloth]:
    for damping, mass in product(DAMPINGS, MASSES):
        yield Cloth(cloth_name(damping, mass), damping=damping, mass=mass)


CLOTHS = {cloth.name: cloth for cloth in _paper_cloths()}  # nine, of its simulation


@dataclass(frozen=True)
class FoamSheet:
    """A sheet of polyethylene foam.

    The thickness is the paper's; density and modulus are such as these foams are sold
    with.
    """

    thickness: float  # [m]
    density: float  # [kg/m³]
    modulus: float  # [Pa] Young's


SHEETS = {
    "soft": FoamSheet(thickness=0.005, density=30.0, modulus=0.3e6),
    "hard": FoamSheet(thickness=0.002, density=120.0, modulus=3.0e6),
}
_AIR_DENSITY = 1.2  # [kg/m³]
_DRAG_COEFFICIENT = 1.2  # of a plate across the wind

# Drag grows with the square of the speed. At this one it is made linear [m/s].
_SWING_SPEED = 2.0

# A bending spring stores what bent sheets do at this angle between two rows [rad].
_BEND = 1.0


def foam(kind: str, sheets: int, sheet: FoamSheet | None = None) -> Cloth:
    """A cloth of loose sheets, `soft` or `hard`.

    Mass and stiffness grow with their number, the drag does not. Another `sheet` than
    that of the kind may be given.
    """
    if sheet is None:
        sheet = choose("foam", kind, SHEETS)
    check_number("sheets", sheets, int, at_least=1)
    base = Cloth(f"{kind}-{sheets}", foam=kind, sheets=sheets)
    area = base.length * base.width
    spacing = base.length / (base.rows - 1)
    drag = _AIR_DENSITY * _DRAG_COEFFICIENT * area * _SWING_SPEED / 2

    # A column of sheet bent by an angle φ between two rows stores E t³/12 · φ²/2 ·
    # column width / spacing, and the spring across them, which the bend shortens by
    # spacing · φ²/4, stores k/2 · (that)². Equal at φ = _BEND.
    rigidity = sheet.modulus * sheet.thickness**3 / 12 * base.width / base.columns
    bending = sheets * 16 * rigidity / (spacing**3 * _BEND**2)

    # Real foam stretches less than 60 N/m says, but so light a cloth would then need a
    # smaller time step.
    return replace(
        base,
        mass=sheets * sheet.density * sheet.thickness * area,
        damping=drag / (base.rows * base.columns),
        bending=bending,
        stiffness=sheets * 60.0,
        spring_damping=sheets * 0.05,
    )


_FOAMS = [foam("soft", n) for n in (1, 2)] + [foam("hard", n) for n in (1, 2, 3)]
FOAMS = {cloth.name: cloth for cloth in _FOAMS}  # those of the paper's robot


def get_cloth(cloth: Cloth | str) -> Cloth:
    """Return the cloth of that name; a cloth is returned as it is."""
    return cloth if isinstance(cloth, Cloth) else choose("cloth", cloth, CLOTHS | FOAMS)


def hanging_points(cloth: Cloth) -> np.ndarray:
    """Where the points of a hanging, unstretched cloth are below the hand.

    `[rows, columns, 3]` [m]
    """
    y = np.linspace(-0.5, 0.5, cloth.columns) * cloth.width
    z = np.linspace(0.0, -cloth.length, cloth.rows)
    return np.stack(np.broadcast_arrays(0.0, y, z[:, None]), axis=-1)
