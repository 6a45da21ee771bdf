"""What MuJoCo is told of a scene, and from where people look at it."""

from pathlib import Path

import mujoco
import numpy as np

from clothlab._validation import HEIGHT, WIDTH
from clothlab.simulation._dimensions import SHOULDER_POSITION
from clothlab.simulation.arm import JOINTS, Arm, Camera
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.cloth_elements import add_cloth
from clothlab.simulation.scene import Scene

_WORLD = Path(__file__).with_name("world.xml")


def build_spec(arm: Arm, cloth: Cloth, scene: Scene | None = None) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of arm, cloth, camera, light and floor.

    Its `.to_xml()` shows it as MJCF.
    """
    scene = Scene() if scene is None else scene

    # The world, with room for the largest picture
    spec = mujoco.MjSpec.from_file(str(_WORLD))
    spec.option.timestep = scene.time_step
    height, width = scene.picture_size
    spec.visual.global_.offheight = max(height, HEIGHT)
    spec.visual.global_.offwidth = max(width, WIDTH)

    # Camera, arm and cloth, its red front to where the camera is
    add_camera(spec, arm.camera)
    hand, position = arm.add_to(spec)
    front_forward = arm.camera.position[0] > position[0]
    add_cloth(spec, cloth, hand, position, front_forward=front_forward)
    return spec


def add_camera(
    spec: mujoco.MjSpec, camera: Camera, parent: mujoco.MjsBody | None = None
) -> None:
    """Put the camera into a scene.

    It is fixed to the world, or to a body `parent` at the world's origin.
    """
    if parent is None:
        parent = spec.worldbody
    target = parent.add_body(name="camera_target", pos=camera.target)
    target.add_site(size=[0.001, 0, 0], group=4)
    parent.add_camera(
        name="camera",
        pos=camera.position,
        fovy=camera.fovy,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY,
        targetbody=target.name,
    )


def onlooker(arm: Arm) -> str | mujoco.MjvCamera:
    """A view for people that shows robot and cloth.

    It is the arm's own camera, unless that stands too near to see both. A camera at the
    robot's head sees what the robot needs, and half of the robot. Then this view is
    from beside and behind it, where the front of the cloth shows, too.
    """
    reach = len(JOINTS) * arm.link_length + Cloth("").length
    from_shoulder = np.subtract(arm.camera.position, SHOULDER_POSITION)
    if np.linalg.norm(from_shoulder) > reach:
        return "camera"

    view = mujoco.MjvCamera()
    view.lookat[:] = np.add(SHOULDER_POSITION, [arm.link_length, 0.0, -0.1])
    view.distance = 2 * reach
    view.azimuth = -50.0  # [degree] from the x axis
    view.elevation = -18.0  # [degree]
    return view
