"""The table scene: `table.xml` with an arm, a cloth, and furniture in drawn places."""

from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import Cloth, hanging_points
from clothlab.simulation.cloth_elements import add_cloth, point_names
from clothlab.simulation.scene import Scene, add_camera

# Red for a mask too: a cloth swung forward lies with its back up
_UNDERSIDE_RGBA = (0.65, 0.05, 0.20, 1.0)
# Which geoms collide, see table.xml
_POINT_BIT = 1
_BAR_BIT = 2


class Basket:
    """Measures of the basket in table.xml [m]."""

    size = (0.20, 0.16, 0.09)  # along, across, up
    handle_height = 0.20  # from the bottom to the rod
    handle_width = 0.12  # length of the rod, across
    handle_radius = 0.006


@dataclass(frozen=True)
class Furniture:
    """Where the table stands, and the ranges of what is random.

    What is no setting describes table.xml and the robot. The arm, 0.6 m long with its
    shoulder 1 m above the floor, lays an edge on the table 0.43 to 0.45 m ahead, and
    from there a cloth of 0.5 m covers the table's middle. A cloth that is held up
    touches the table with its far edge 0.59 m ahead at most; beyond that it must be
    pushed or thrown. So `near` decides whether a cloth can be laid.
    """

    # The table's edge ahead of the shoulder, with the base at 0
    near: float = 0.35  # [m]
    # Half ranges from here on. The hand tolerates corners of the edge 3 cm off the bar;
    # these ranges move them by 17 mm.
    # Ahead, aside, up
    rack_shift: tuple[float, float, float] = (0.05, 0.015, 0.03)  # [m]
    # About up; slant from level
    rack_turn: tuple[float, float] = (4.0, 3.0)  # [degree]
    # Ahead, aside
    basket_shift: tuple[float, float] = (0.04, 0.015)  # [m]
    basket_turn: float = 15.0  # [degree]
    # Of a cloth that begins in the hand, as one from the rack
    off_middle: float = 0.006  # [m]
    # Before a cloth in the hand begins to move
    wait: tuple[float, float] = (1.0, 5.0)  # [s]

    depth: ClassVar[float] = 0.70  # [m] of the table, from its near edge to its far one
    width: ClassVar[float] = 1.00  # [m] of the table
    height: ClassVar[float] = 0.60  # [m] of the table's top
    # [m] middle of the side table's top
    side_place: ClassVar[tuple[float, float, float]] = (-0.65, 0.0, 0.50)
    # [m] farther ahead, legs are in the way
    base_range: ClassVar[tuple[float, float]] = (-2.20, 0.15)
    base_speed: ClassVar[float] = 0.40  # [m/s] at most
    reach: ClassVar[float] = 0.03  # [m] the hand grasps what is no farther from the bar
    # [rad] the cloth in the hand is clear of the table
    start_posture: ClassVar[tuple[float, float]] = (-0.45, -0.35)
    # [rad] the hand is out of the picture
    look_posture: ClassVar[tuple[float, float]] = (1.0, 0.0)
    look_ahead: ClassVar[float] = 0.85  # [m] from the shoulder to what is looked at
    point_radius: ClassVar[float] = 0.003  # [m] of the cloth's points where they touch

    @property
    def far(self) -> float:
        """The table's far edge ahead of the shoulder [m]."""
        return self.near + self.depth


def build_spec(
    arm: Arm, cloth: Cloth, scene: Scene, furniture: Furniture
) -> mujoco.MjSpec:
    """Load table.xml, move the table, add arm and cloth.

    `.to_xml()` shows the result as MJCF.
    """
    spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name("table.xml")))
    spec.option.timestep = scene.time_step

    # The table between its edges
    spec.frame("table_legs").pos[0] = furniture.near
    top = spec.geom("table")
    top.pos[0] = (furniture.near + furniture.far) / 2
    top.size[0] = (furniture.far - furniture.near) / 2

    # Camera and arm ride on the base
    base = spec.body("base")
    add_camera(spec, arm.camera, base)
    hand, position = arm.add_to(spec, base)
    for geom in hand.geoms:
        geom.contype = _BAR_BIT

    # A cloth that is tied to nothing yet, its front towards the camera
    add_cloth(
        spec,
        cloth,
        None,
        position,
        front_forward=arm.camera.position[0] > position[0],
        back_rgba=_UNDERSIDE_RGBA,
    )
    names = point_names(cloth)
    for name in chain(*names):
        _let_touch(spec.body(name), top, furniture.point_radius)

    # What the hand can hold, and what the rack holds at the start
    for name in (*names[0], *names[-1], "basket"):
        _add_tie(spec, hand, f"grip_{name}", name, [0.0, 0.1, 0.0])
    rack = spec.body("rack")
    for name, place in zip(names[0], hanging_points(cloth)[0], strict=True):
        _add_tie(spec, rack, f"clip_{name}", name, place).active = True
    return spec


def _let_touch(body: mujoco.MjsBody, top: mujoco.MjsGeom, radius: float) -> None:
    """Let a point of the cloth collide, and rub on the table as its top has it."""
    (point,) = body.geoms
    point.contype = _POINT_BIT
    point.size = [radius, 0, 0]
    point.friction = top.friction
    point.solref = top.solref


def _add_tie(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, site: str, place: ArrayLike
) -> mujoco.MjsEquality:
    """Add a constraint that can hold a site at a place of a body.

    Grasping moves that place; it must not be the body's origin.
    """
    body.add_site(name=name, pos=place, size=[0.001, 0, 0], group=4)
    tie = spec.add_equality(
        name=name, type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE
    )
    tie.name1 = name
    tie.name2 = site
    tie.active = False
    tie.solref = [0.01, 1.0]  # drawn to the bar in 10 ms
    return tie


def place_furniture(
    data: mujoco.MjData, furniture: Furniture, rng: np.random.Generator
) -> None:
    """Draw where rack and basket stand, and how they are turned.

    The rack's place, turn and slant are around those of table.xml.
    """
    data.mocap_pos[0] += rng.uniform(-1, 1, 3) * furniture.rack_shift
    turns = np.deg2rad(rng.uniform(-1, 1, 2) * furniture.rack_turn)
    data.mocap_quat[0] = Rotation.from_euler("ZX", turns).as_quat(scalar_first=True)

    shift = rng.uniform(-1, 1, 2) * furniture.basket_shift
    turn = np.deg2rad(rng.uniform(-1, 1) * furniture.basket_turn)
    place = np.add(furniture.side_place, [*shift, 0.0])
    upright = Rotation.from_euler("z", turn).as_quat(scalar_first=True)
    data.joint("basket").qpos[:] = [*place, *upright]
