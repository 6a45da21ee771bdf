"""What stands in the scene of the table, and its MuJoCo elements.

Everything stands in a row along x, in the plane in which the arm moves: a rack with a cloth, a basket on a side table,
the table. The robot's body drives beside the row, at its right, and carries the arm over it. Only the table is so
wide that the body must stop before it, and there the arm has to bridge what is left: `Furniture.near`, from the
shoulder to the table's edge, decides whether a cloth can be laid or has to be thrown (paper, section "Integrated Table
Setting Experiment").
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import Checked, setting
from clothlab.simulation.arm import Arm
from clothlab.simulation.cloth import Cloth, add_cloth, point_names
from clothlab.simulation.env import WORLD, Scene, add_camera

WOOD_RGBA = (0.66, 0.60, 0.52, 1.0)  # too grey to pass for cloth or basket
RACK_RGBA = (0.62, 0.64, 0.60, 1.0)
BASKET_RGBA = (0.80, 0.74, 0.16, 1.0)
BODY_RGBA = (0.55, 0.56, 0.58, 1.0)
UNDERSIDE_RGBA = (0.65, 0.05, 0.20, 1.0)  # red for a mask too: a cloth swung forward lies with its back up
BODY_SIDE = -0.40  # [m] where the robot's body drives beside the row; the arm is its left one
# Who collides with whom: furniture with points, basket and bar; the basket with points too. Cloth with cloth does not.
POINT_BIT, THING_BIT = 1, 2
TOP = 0.04  # [m] thickness of a table's top
SOMEWHERE = (0.0, 0.1, 0.0)  # [m] on the bar; a site compiled at its body's origin could not be moved from there
HOLD_TIME = 0.01  # [s] in which what is grasped is drawn to the bar


@dataclass(frozen=True)
class Basket(Checked):
    """A box full of sweets, with a handle across its middle."""

    mass: float = setting(0.30, "kg", above=0)
    size: tuple[float, float, float] = setting((0.20, 0.16, 0.09), "m", above=0)  # along, across, up
    handle: float = setting(0.11, "m", above=0)  # from the rim up to the rod
    handle_width: float = setting(0.12, "m", above=0)  # length of the rod, across
    handle_radius: float = setting(0.006, "m", above=0)
    damping: float = setting(0.02, "N s/m, N m s/rad", at_least=0)  # so that it stops swinging in a second

    @property
    def handle_height(self) -> float:
        """From the bottom of the basket to the rod of its handle [m]."""
        return self.size[2] + self.handle


@dataclass(frozen=True)
class Furniture(Checked):
    """What stands where, in front of the shoulder of an arm whose base is at 0, and how far chance moves it.

    The arm, 0.6 m long with its shoulder 1 m above the floor, lays an edge on a table of this height 0.43 to 0.45 m
    ahead, and from there a cloth of 0.5 m covers the table's middle. Held up, the cloth touches the table with its far
    edge 0.59 m ahead at most, or 0.74 m with the base drawn up, 0.2 m before the table. The rest of the way it has to
    be pushed, which a cloth bears for some way, or thrown. Where the border lies depends on `near`.
    """

    near: float = setting(0.35, "m", above=0)  # the table's edge ahead of the shoulder
    depth: float = setting(0.70, "m", above=0)
    width: float = setting(1.00, "m", above=0)
    height: float = setting(0.60, "m", above=0)
    side_place: float = setting(-0.65, "m")  # the middle of the side table: out of the way of a cloth that swings back
    side_size: tuple[float, float] = setting((0.32, 0.36), "m", above=0)  # narrow: the body passes by
    side_height: float = setting(0.50, "m", above=0)
    rack_place: float = setting(-1.20, "m")
    rack_height: float = setting(1.20, "m", above=0)  # of the cloth's edge; the cloth then passes above the basket
    base_range: tuple[float, float] = setting(
        (-2.20, 0.15), "m"
    )  # beyond 0 only to place the basket; then legs are in the way
    base_speed: float = setting(0.40, "m/s", above=0)  # at most
    base_mass: float = setting(30.0, "kg", above=0)
    base_stiffness: float = setting(5e4, "N/m", above=0)  # a swing moves the base by a millimetre
    # Half ranges of chance. The bar tolerates what keeps the corners of the edge within the hand's reach of 3 cm:
    # 4° of turn move them by 14 mm, 3° of slant by 10 mm, together 17 mm.
    rack_shift: tuple[float, float, float] = setting((0.05, 0.015, 0.03), "m", at_least=0)  # ahead, aside, up
    rack_turn: tuple[float, float] = setting((4.0, 3.0), "degree", at_least=0)  # about up; slant from level
    basket_shift: tuple[float, float] = setting((0.04, 0.015), "m", at_least=0)  # ahead, aside
    basket_turn: float = setting(15.0, "degree", at_least=0)
    off_middle: float = setting(0.006, "m", at_least=0)  # of a cloth that begins in the hand; so is one from the rack
    wait: tuple[float, float] = setting((1.0, 5.0), "s", at_least=0)  # before it begins there, longer than otherwise
    reach: float = setting(0.03, "m", above=0)  # the hand takes what is no farther from the bar
    start_posture: tuple[float, float] = setting(
        (-0.45, -0.35), "rad"
    )  # with a cloth in hand that is clear of the table
    look_ahead: float = setting(0.85, "m", above=0)  # from the shoulder to what is looked at
    look_posture: tuple[float, float] = setting((1.0, 0.0), "rad")  # with the hand out of the picture
    point_radius: float = setting(0.003, "m", above=0)  # of the cloth's points where they touch
    friction: float = setting(0.5, at_least=0)  # of foam and wicker on wood
    contact_time: float = setting(0.005, "s", above=0)  # in which contacts push apart; MuJoCo wants two time steps
    basket: Basket = Basket()

    @property
    def far(self) -> float:
        """The table's far edge ahead of the shoulder [m]."""
        return self.near + self.depth


def build_spec(arm: Arm, cloth: Cloth, scene: Scene, furniture: Furniture) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of the table's scene; `.to_xml()` shows it as MJCF."""
    spec = mujoco.MjSpec.from_file(str(WORLD))
    spec.option.timestep = scene.time_step
    spec.visual.global_.offheight, spec.visual.global_.offwidth = scene.picture_size
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.conaffinity = POINT_BIT | THING_BIT
        else:  # the post on which an arm stands that has no body
            spec.delete(geom)
    base = _add_base(spec, furniture)
    add_camera(spec, arm.camera, base)
    hand, position = arm.add_to(spec, base)
    for geom in hand.geoms:
        geom.contype = THING_BIT
    _add_tables(spec, furniture)
    rack = _add_rack(spec, furniture, cloth.width)
    _add_basket(spec, furniture.basket)
    front_forward = arm.camera.position[0] > position[0]
    add_cloth(spec, cloth, None, position, front_forward=front_forward, back_rgba=UNDERSIDE_RGBA)
    _let_touch(spec, cloth, furniture)
    for name in (*point_names(cloth)[0], *point_names(cloth)[-1], "basket"):
        _add_tie(spec, hand, f"grip_{name}", name, SOMEWHERE)
    for name, place in zip(point_names(cloth)[0], hanging_points(cloth)[0], strict=True):
        _add_tie(spec, rack, f"clip_{name}", name, place, active=True)
    return spec


def hanging_points(cloth: Cloth) -> np.ndarray:
    """Points of a cloth that hangs unstretched, from the middle of its upper edge `[rows, columns, 3]` [m]."""
    y, z = np.linspace(-0.5, 0.5, cloth.columns) * cloth.width, np.linspace(0.0, -cloth.length, cloth.rows)
    return np.stack(np.broadcast_arrays(0.0, y, z[:, None]), axis=-1)


def _add_base(spec: mujoco.MjSpec, furniture: Furniture) -> mujoco.MjsBody:
    base = spec.worldbody.add_body(name="base")
    low, high = furniture.base_range
    base.add_joint(name="base", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    shapes = {"rgba": BODY_RGBA, "contype": 0, "conaffinity": 0}
    chassis, column = [-0.08, BODY_SIDE, 0.12], [-0.10, BODY_SIDE, 0.2, -0.10, BODY_SIDE, 1.30]
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=chassis, size=[0.20, 0.14, 0.10], mass=furniture.base_mass, **shapes
    )
    for ends, radius in ((column, 0.06), ([-0.10, BODY_SIDE, 1.0, 0.0, 0.0, 1.0], 0.03)):
        base.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=ends, size=[radius, 0, 0], mass=0.01, **shapes)
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=[-0.14, -0.33, 1.45], size=[0.08, 0, 0], mass=0.01, **shapes)
    servo = spec.add_actuator(
        name="base", target="base", trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrllimited=True, ctrlrange=[low, high]
    )
    servo.set_to_position(kp=furniture.base_stiffness, dampratio=1.0)
    return base


def _add_tables(spec: mujoco.MjSpec, furniture: Furniture) -> None:
    half_side = furniture.side_size[0] / 2
    tables = {
        "table": (furniture.near, furniture.far, furniture.width, furniture.height),
        "side_table": (
            furniture.side_place - half_side,
            furniture.side_place + half_side,
            furniture.side_size[1],
            furniture.side_height,
        ),
    }
    for name, (near, far, width, height) in tables.items():
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[(near + far) / 2, 0, height - TOP / 2],
            size=[(far - near) / 2, width / 2, TOP / 2],
            rgba=WOOD_RGBA,
            contype=0,
            conaffinity=POINT_BIT | THING_BIT,
            **_contact(furniture),
        )
        for x in (near + 0.03, far - 0.03):
            for y in (-width / 2 + 0.03, width / 2 - 0.03):
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                    fromto=[x, y, 0, x, y, height - TOP],
                    size=[0.02, 0, 0],
                    rgba=WOOD_RGBA,
                    contype=0,
                    conaffinity=0,
                )


def _add_rack(spec: mujoco.MjSpec, furniture: Furniture, width: float) -> mujoco.MjsBody:
    """A rod over the row, on a post at the side where the robot's body does not drive; clips hang from it."""
    rack = spec.worldbody.add_body(name="rack", mocap=True, pos=[furniture.rack_place, 0, furniture.rack_height])
    end = 0.55  # [m] aside
    rods = [([0, -width / 2, 0.04, 0, end, 0.04], 0.008), ([0, end, 0.04, 0, end, 0.04 - furniture.rack_height], 0.015)]
    rods += [([0, y, 0.04, 0, y, 0.005], 0.004) for y in (-width / 2 + 0.01, 0.0, width / 2 - 0.01)]
    for ends, radius in rods:
        rack.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=ends,
            size=[radius, 0, 0],
            rgba=RACK_RGBA,
            contype=0,
            conaffinity=0,
        )
    return rack


def _add_basket(spec: mujoco.MjSpec, basket: Basket) -> None:
    """The basket's frame is in the middle of its bottom."""
    body = spec.worldbody.add_body(name="basket")
    body.add_joint(name="basket", type=mujoco.mjtJoint.mjJNT_FREE, damping=[basket.damping, 0, 0])
    length, across, up = basket.size
    body.add_geom(
        name="basket",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[0, 0, up / 2],
        size=[length / 2, across / 2, up / 2],
        mass=0.9 * basket.mass,
        rgba=BASKET_RGBA,
        contype=THING_BIT,
        conaffinity=POINT_BIT,
    )
    half, top = basket.handle_width / 2, basket.handle_height
    legs = [[0, y, up, 0, y, top] for y in (-half, half)]
    for ends in (*legs, [0, -half, top, 0, half, top]):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=ends,
            size=[basket.handle_radius, 0, 0],
            mass=0.1 / 3 * basket.mass,
            rgba=BASKET_RGBA,
            contype=0,
            conaffinity=0,
        )
    body.add_site(name="basket", pos=[0, 0, top], size=[0.001, 0, 0], group=4)


def _contact(furniture: Furniture) -> dict:
    return {"friction": [furniture.friction, 0.005, 0.0001], "solref": [furniture.contact_time, 1.0], "condim": 3}


def _let_touch(spec: mujoco.MjSpec, cloth: Cloth, furniture: Furniture) -> None:
    for name in (name for row in point_names(cloth) for name in row):
        for geom in spec.body(name).geoms:
            geom.contype, geom.size = POINT_BIT, [furniture.point_radius, 0, 0]
            for key, value in _contact(furniture).items():
                setattr(geom, key, value)


def _add_tie(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, site: str, place: ArrayLike, active: bool = False
) -> None:
    """What can hold a site of something else at a place of a body, which is a site of its own and so can be moved."""
    body.add_site(name=name, pos=place, size=[0.001, 0, 0], group=4)
    tie = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE)
    tie.name1, tie.name2, tie.active, tie.solref = name, site, active, [HOLD_TIME, 1.0]


def place_rack(data: mujoco.MjData, furniture: Furniture, rng: np.random.Generator) -> None:
    """Draw place and slant of the rack, within the furniture's ranges."""
    shift = rng.uniform(-1, 1, 3) * furniture.rack_shift
    turn, slant = np.deg2rad(rng.uniform(-1, 1, 2) * furniture.rack_turn)
    data.mocap_pos[0] = np.add([furniture.rack_place, 0, furniture.rack_height], shift)
    data.mocap_quat[0] = _quaternion((0, 0, turn), (slant, 0, 0))


def place_basket(data: mujoco.MjData, furniture: Furniture, rng: np.random.Generator) -> None:
    """Draw where the basket stands on the side table, within the furniture's ranges."""
    shift = rng.uniform(-1, 1, 2) * furniture.basket_shift
    turn = np.deg2rad(rng.uniform(-1, 1) * furniture.basket_turn)
    place = np.add([furniture.side_place, 0, furniture.side_height], [*shift, 0.0])
    data.joint("basket").qpos[:] = [*place, *_quaternion((0, 0, turn))]


def _quaternion(*turns: tuple[float, float, float]) -> np.ndarray:
    """Of rotation vectors [rad], the first about the world's axes, each other one about what is turned already."""
    whole = np.array([1.0, 0, 0, 0])
    for turn in turns:
        part, angle = np.empty(4), np.linalg.norm(turn)
        mujoco.mju_axisAngle2Quat(part, np.array(turn) / max(angle, 1e-12), angle)
        mujoco.mju_mulQuat(whole, whole.copy(), part)
    return whole
