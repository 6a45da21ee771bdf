"""The scene of the page: what its physics, camera and picture need."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import mujoco
import numpy as np

from clothlab.simulation.arm import JOINTS, Arm, MuscleArm
from clothlab.simulation.cloth import CLOTHS, FOAMS, Cloth
from clothlab.simulation.cloth_elements import point_names, springs
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.muscle import MUSCLES
from clothlab.simulation.rendering import onlooker
from clothlab.simulation.scene import Scene, build_spec
from web.images import HEIGHT, SAMPLES, WIDTH

# Of a cloth, what the page puts into the MJCF
_NUMBERS = ("damping", "mass", "stiffness", "bending", "spring_damping")

# Parts of an edge of the cloth's triangles, which are shaded each
_FINE = 3

# Parts of a rod's surface, along it and around it
_PARTS = 6
_AROUND = 12

# Only actuators of these kinds take several inputs. MuJoCo 3.14 allows no others to say
# which, and 4.0 writes it of all.
_MANY_INPUTS = ("pid", "dcmotor")

# Behind all that is drawn: the sky, and the floor at the horizon and in front
_BACKDROP = ((0.93, 0.95, 0.97), (0.931, 0.931, 0.9114), (0.817, 0.817, 0.7998))


def cloths(arm: Arm) -> list[dict[str, Any]]:
    """Those that an arm may hold, with what is said of them and what they are."""
    keys = ("name", "label", *_NUMBERS)
    known = known_cloths(arm).values()
    return [{key: getattr(cloth, key) for key in keys} for cloth in known]


def known_cloths(arm: Arm) -> Mapping[str, Cloth]:
    """Those that were made for an arm, by name."""
    return FOAMS if arm.has_stiffness else CLOTHS


def scene(arm: str, cloth: Cloth | str) -> dict[str, Any]:
    """An arm with a cloth that hangs still in its hand, as plain data.

    Its MJCF, where it starts and the time steps of a control period; what its arm
    senses and is sent; what there is to see, and from where.
    """
    env = ClothEnv(arm, cloth)
    spec = build_spec(env.arm, env.cloth, env.scene)
    return {
        "mjcf": portable_mjcf(spec),
        "start": _start(env),
        "substeps": env.scene.substeps,
        "arm": _arm(env.arm, env.model),
        "shapes": _shapes(env.model),
        "camera": _eye(env, "camera") | {"size": (HEIGHT, WIDTH), "places": SAMPLES},
        "onlooker": _onlooker(env),
    }


def _start(env: ClothEnv) -> dict[str, list[float]]:
    names = ("qpos", "qvel", "act", "ctrl", "qacc_warmstart")
    return {name: getattr(env.data, name).tolist() for name in names}


def any_cloth_scene(arm: str, cloth: Cloth | str) -> dict[str, Any]:
    """The same for any of an arm's cloths, whose numbers are open in the MJCF.

    The cloth is put below the hand, and hangs still after `settle` time steps. How a
    known one does then is there as `still`, by its name.
    """
    placed = ClothEnv(arm, cloth, scene=Scene(settle_time=0))
    world = scene(arm, cloth)

    # Names in braces where numbers of the cloth stand
    root = ElementTree.fromstring(world["mjcf"])
    names = {name for row in point_names(placed.cloth) for name in row}
    points = [body for body in root.iter("body") if body.get("name") in names]
    for body in points:
        for joint in body.findall("joint"):
            joint.set("damping", "{damping}")
        for ball in body.findall("geom"):
            ball.set("mass", "{mass}")
    bent = {
        f"{a}-{b}"
        for a, b, stiffness in springs(placed.cloth)
        if stiffness == placed.cloth.bending
    }
    for spring in root.iter("spatial"):
        kind = "{bending}" if spring.get("name") in bent else "{stiffness}"
        spring.set("stiffness", kind)
        spring.set("damping", "{spring_damping}")

    # And how it begins
    return world | {
        "mjcf": ElementTree.tostring(root, encoding="unicode"),
        "start": _start(placed),
        "settle": round(Scene.settle_time / Scene.time_step),
        "still": {
            name: {"start": _start(ClothEnv(arm, name)), "settle": 0}
            for name in known_cloths(placed.arm)
        },
        "timeStep": Scene.time_step,
        "points": len(points),
    }


def portable_mjcf(spec: mujoco.MjSpec) -> str:
    """A specification as MJCF that MuJoCo reads from 3.14 on, in a browser, too.

    Numbers are rounded to six digits, so that what is to move alike is made of it.
    """
    model = spec.compile()
    root = ElementTree.fromstring(spec.to_xml())

    # 4.0 leaves out what inertia a body was given that has no geometry
    for body in root.iter("body"):
        if spec.body(body.get("name")).explicitinertial:
            compiled = model.body(body.get("name"))
            numbers = {
                "pos": compiled.ipos,
                "quat": compiled.iquat,
                "mass": compiled.mass,
                "diaginertia": compiled.inertia,
            }
            written = {
                name: " ".join(map(repr, each.tolist()))
                for name, each in numbers.items()
            }
            body.insert(0, ElementTree.Element("inertial", written))

    # What 3.14 refuses
    for actuator in root.iter("general"):
        if actuator.get("dyntype") not in _MANY_INPUTS:
            actuator.attrib.pop("input", None)
    return ElementTree.tostring(root, encoding="unicode")


def _arm(arm: Arm, model: mujoco.MjModel) -> dict[str, Any]:
    """What an arm senses, by its places in MuJoCo's data, and how it is moved."""
    muscles = None
    if isinstance(arm, MuscleArm):
        muscles = {
            "rotors": _addresses(model, MUSCLES),
            "tendons": [model.tendon(name).id for name in MUSCLES],
            "moment_arms": arm.moment_arms.tolist(),
            "spring_linear": arm.spring_linear,
            "spring_cubic": arm.spring_cubic,
            "motor_stiffness": arm.motor_stiffness,
            "tension_bias": arm.tension_bias,
        }
    return {"angles": _addresses(model, JOINTS), "muscles": muscles}


def _addresses(model: mujoco.MjModel, joints: Sequence[str]) -> list[int]:
    """Places of joints among the coordinates."""
    return [int(model.joint(name).qposadr[0]) for name in joints]


def _shapes(model: mujoco.MjModel) -> dict[str, Any]:
    """What there is to see: bodies, which are the cloth and rods, and their surfaces.

    A surface is triangles between the points `of` a body, of which the cloth is first.
    """
    cloth = model.skin_bonebodyid[: model.skin(0).bonenum[0]].tolist()
    surfaces = []
    for k in range(model.nskin):
        faces = model.skin(k).faceadr[0] + np.arange(model.skin(k).facenum[0])
        about = {"of": 0, "triangles": model.skin_face[faces].tolist()}
        surfaces.append(about | {"colour": _colour(model.skin(k)), "facets": _FINE})
    rods = []
    for k in range(model.ngeom):
        rod = model.geom(k)
        round_ = rod.type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE
        if round_ or rod.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            radius, half, _ = rod.size.tolist()
            points, triangles = _turned(_profile(radius, half, round_))
            rods.append({"geom": k, "surface": points})
            about = {"of": len(rods), "triangles": triangles}
            surfaces.append(about | {"colour": _colour(rod), "facets": 1})
    for surface in surfaces:
        surface["facets"] = _facets(surface["facets"])
    return {"cloth": cloth, "rods": rods, "surfaces": surfaces}


def _profile(radius: float, half: float, round_: bool) -> np.ndarray:
    """Of a rod along z, distance from its axis and height, from below `[N, 2]`."""
    # A quarter of a circle at each end, or a flat one
    angles = np.linspace(0, np.pi / 2, _PARTS // 2 + 1 if round_ else 2)
    end = radius * np.column_stack([np.cos(angles), round_ * np.sin(angles)])
    top = end + np.array([0, half])
    bottom = end * (1, -1) - np.array([0, half])

    # The side between them has their last points already
    heights = np.linspace(-half, half, _PARTS)
    side = np.column_stack([np.full(_PARTS, radius), heights])
    return np.concatenate([bottom[:0:-1], side, top[1:]])


def _turned(profile: np.ndarray) -> tuple[list[list[float]], list[list[int]]]:
    """Points, and triangles between them, of what a profile sweeps around z."""
    around = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(around), np.sin(around)])
    points = [(*(r * place), z) for r, z in profile for place in circle]
    triangles = []
    for ring, k in product(range(len(profile) - 1), range(_AROUND)):
        a = ring * _AROUND + k
        b = ring * _AROUND + (k + 1) % _AROUND
        triangles += [[a, b, a + _AROUND], [b, b + _AROUND, a + _AROUND]]
    return np.round(points, 6).tolist(), triangles


def _facets(count: int) -> list[list[tuple[float, ...]]]:
    """What a triangle is cut into: corners as shares of its own corners."""

    def corner(i: int, j: int) -> tuple[float, ...]:
        return (count - i - j) / count, i / count, j / count

    facets = []
    for i, j in product(range(count), range(count)):
        if i + j < count:
            facets.append([corner(i, j), corner(i + 1, j), corner(i, j + 1)])
        if i + j < count - 1:
            beyond = corner(i + 1, j + 1)
            facets.append([corner(i + 1, j), beyond, corner(i, j + 1)])
    return facets


def _colour(thing: Any) -> list[float]:
    return thing.rgba[:3].round(4).tolist()


def _onlooker(env: ClothEnv) -> dict[str, Any]:
    """Where the visitor looks from, and what is behind all.

    Colours, at shares of the height, from the sky over the horizon to the floor in
    front.
    """
    eye = _eye(env, onlooker(env.arm))
    _, up, backward = np.array(eye["axes"])
    level = -backward * (1, 1, 0)
    slope = (level @ up) / (level @ backward)
    horizon = float(0.5 * (1 + slope / np.tan(np.deg2rad(eye["fovy"]) / 2)))
    horizon = min(max(horizon, 0.0), 1.0)
    sky, far, near = _BACKDROP
    backdrop = [(0, sky), (horizon, sky), (horizon, far), (1, near)]
    return eye | {"backdrop": backdrop}


def _eye(env: ClothEnv, view: str | mujoco.MjvCamera) -> dict[str, Any]:
    """Where a view is from, what is right, up and backward there, and its lights."""
    model = env.model
    if isinstance(view, str):
        camera = env.arm.camera
        eye = np.array(camera.position)
        axes = camera.axes
        fovy = camera.fovy
    else:
        azimuth, elevation = np.deg2rad([view.azimuth, view.elevation])
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        upward = np.array([0, 0, 1])
        forward = np.cos(elevation) * level + np.sin(elevation) * upward
        up = np.cos(elevation) * upward - np.sin(elevation) * level
        axes = np.array([np.cross(forward, up), up, -forward])
        eye = view.lookat - view.distance * forward
        fovy = model.vis.global_.fovy

    # One light goes with the camera
    head = model.vis.headlight
    beams = [(axes[2].tolist(), float(head.diffuse[0]))]
    for direction, diffuse in zip(model.light_dir, model.light_diffuse, strict=True):
        beams.append(((-direction).tolist(), float(diffuse[0])))
    return {
        "eye": eye.tolist(),
        "axes": axes.tolist(),
        "fovy": float(fovy),
        "lights": {"ambient": float(head.ambient[0]), "beams": beams},
    }
