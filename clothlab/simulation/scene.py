"""A scene: its time step, how it starts, and what MuJoCo is given of it."""

from dataclasses import dataclass
from pathlib import Path

import mujoco

from clothlab._validation import check_number
from clothlab.simulation.arm import Arm, Camera
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.cloth_elements import add_cloth

CONTROL_PERIOD = 0.2  # [s], the paper's 5 Hz
_WORLD = Path(__file__).with_name("world.xml")


@dataclass(frozen=True)
class Scene:
    """Time step and start of a scene, and how large its pictures for people are."""

    time_step: float = 0.002  # [s]
    # The cloth hangs still before a trial starts
    settle_time: float = 2.0  # [s]
    # Height and width, for people
    picture_size: tuple[int, int] = (480, 640)  # [pixel]

    def __post_init__(self) -> None:
        check_number("Scene.time_step", self.time_step, above=0)
        if abs(self.substeps * self.time_step - CONTROL_PERIOD) > 1e-9:
            raise ValueError(
                "Scene.time_step must divide the control period of "
                f"{CONTROL_PERIOD} s: 0.002, for one"
            )

    @property
    def substeps(self) -> int:
        """Time steps in a control period."""
        return round(CONTROL_PERIOD / self.time_step)


def build_spec(arm: Arm, cloth: Cloth, scene: Scene = Scene()) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of arm, cloth, camera, light and floor.

    Its `.to_xml()` shows it as MJCF.
    """
    spec = mujoco.MjSpec.from_file(str(_WORLD))
    spec.option.timestep = scene.time_step
    add_camera(spec, arm.camera)
    hand, position = arm.add_to(spec)

    # The cloth's red front is to where the camera is.
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
