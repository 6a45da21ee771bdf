"""The scene (arm, cloth, camera) as a Gymnasium environment whose step is one control
period of 0.2 s.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import Checked, check_number, check_seed, setting
from clothlab.masks import Observation
from clothlab.simulation import vision
from clothlab.simulation.arm import (
    JOINTS,
    SHOULDER_POSITION,
    Arm,
    Camera,
    check_command,
    get_arm,
)
from clothlab.simulation.cloth import Cloth, add_cloth, get_cloth, point_names

CONTROL_PERIOD = 0.2  # [s], the paper's 5 Hz
_WORLD = Path(__file__).with_name("world.xml")
_DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


class SimulationError(RuntimeError):
    """The physics diverged: a coordinate became infinite, NaN or absurdly large."""


@dataclass(frozen=True)
class Scene(Checked):
    """Time step and start of a scene, and how large its pictures for people are."""

    # Notebook 01 measures what halving it changes
    time_step: float = setting(0.002, "s", at_least=1e-5)
    # The cloth hangs still before a trial starts
    settle_time: float = setting(2.0, "s", at_least=0, at_most=60)
    # Height and width, for people
    picture_size: tuple[int, int] = setting((480, 640), "pixel", above=0, at_most=4096)

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.substeps * self.time_step - CONTROL_PERIOD) > 1e-9:
            raise ValueError(
                f"Scene.time_step must divide the control period of {CONTROL_PERIOD} s: 0.002, for one"
            )

    @property
    def substeps(self) -> int:
        """Time steps in a control period."""
        return round(CONTROL_PERIOD / self.time_step)


def build_spec(arm: Arm, cloth: Cloth, scene: Scene | None = None) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of arm, cloth, camera, light and floor;
    `.to_xml()` shows it as MJCF.
    """
    scene = Scene() if scene is None else scene
    spec = mujoco.MjSpec.from_file(str(_WORLD))
    spec.option.timestep = scene.time_step
    spec.visual.global_.offheight = max(scene.picture_size[0], vision.HEIGHT)
    spec.visual.global_.offwidth = max(scene.picture_size[1], vision.WIDTH)
    add_camera(spec, arm.camera)
    hand, position = arm.add_to(spec)
    add_cloth(
        spec, cloth, hand, position, front_forward=arm.camera.position[0] > position[0]
    )
    return spec


def add_camera(
    spec: mujoco.MjSpec, camera: Camera, parent: mujoco.MjsBody | None = None
) -> None:
    """Put the camera into a scene, fixed to the world or to a body `parent` at the
    world's origin.
    """
    parent = spec.worldbody if parent is None else parent
    target = parent.add_body(name="camera_target", pos=camera.target)
    target.add_site(size=[0.001, 0, 0], group=4)
    direction = {
        "mode": mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY,
        "targetbody": target.name,
    }
    if camera.roll:  # MuJoCo keeps a camera upright that follows a body
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, camera.axes.T.ravel())
        direction = {"quat": quaternion}
    parent.add_camera(name="camera", pos=camera.position, fovy=camera.fovy, **direction)


def onlooker(arm: Arm) -> str | mujoco.MjvCamera:
    """A view for people that shows robot and cloth: the arm's own camera, unless it
    stands too near to see both.

    A camera at the robot's head sees what the robot needs, and half of the robot. Then
    this view is from beside and behind it, where the front of the cloth shows, too.
    """
    reach = len(JOINTS) * arm.link_length + Cloth("").length
    if np.linalg.norm(np.subtract(arm.camera.position, SHOULDER_POSITION)) > reach:
        return "camera"
    view = mujoco.MjvCamera()
    view.lookat[:] = np.add(SHOULDER_POSITION, [arm.link_length, 0.0, -0.1])
    view.distance = 2 * reach
    view.azimuth = -50.0  # [degree] from the x axis
    view.elevation = -18.0  # [degree]
    return view


class ClothEnv(gymnasium.Env):
    """A robot arm that holds a cloth in front of a camera.

    * action: the command `u`, `[D_u]`, in the arm's units; `env.arm.command_names`
      names them.
    * observation: `{"image": cloth mask [H, W] of 0 and 1, "robot": robot state
      [D_r]}`.
    * reward: always 0; the paper's method has none. An episode never ends by itself.
    """

    cloth: Cloth
    model: mujoco.MjModel  # MuJoCo's model of the scene
    data: mujoco.MjData  # and its state

    def __init__(
        self,
        arm: Arm | str = "torque",
        cloth: Cloth | str = "damp0.05-mass0.10",
        *,
        scene: Scene | None = None,
    ):
        self.arm = get_arm(arm)
        self.scene = Scene() if scene is None else scene
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self.hold(cloth)

        spaces = gymnasium.spaces
        self.action_space = spaces.Box(
            self.arm.command_lower, self.arm.command_upper, dtype=np.float64
        )
        self.observation_space = spaces.Dict(
            {
                "image": spaces.MultiBinary((vision.HEIGHT, vision.WIDTH)),
                "robot": spaces.Box(
                    -np.inf, np.inf, (len(self.arm.state_names),), np.float64
                ),
            }
        )

    def hold(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still at the arm's home; `reset`
        comes next.

        The one before stays in the hand if this one is unknown, or diverges with this
        time step (`SimulationError`).
        """
        before = {name: vars(self).get(name) for name in ("cloth", "model", "data")}
        cloth = get_cloth(cloth)
        try:
            self.cloth = cloth
            self.model = self._spec().compile()
            self.data = mujoco.MjData(self.model)
            self.start()
        except Exception:
            vars(self).update(before)
            raise
        if before["cloth"] is not None and _shape(cloth) != _shape(before["cloth"]):
            # The renderers know the surface of the last one; making new ones takes
            # longer than a step
            self.close()

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode without looking at it: `reset` without the observation."""
        super().reset(seed=None if seed is None else check_seed(seed))
        u = self.arm.home_command
        if random_start:
            u = self.np_random.uniform(self.arm.command_lower, self.arm.command_upper)
        mujoco.mj_resetData(self.model, self.data)
        self._place(u)
        self._simulate(round(self.scene.settle_time / self.scene.time_step))
        self.data.time = 0.0
        mujoco.mj_forward(self.model, self.data)

    def _spec(self) -> mujoco.MjSpec:
        return build_spec(self.arm, self.cloth, self.scene)

    def _place(self, u: np.ndarray) -> None:
        """Put the arm where `u` wants it, and the cloth below its hand."""
        mujoco.mj_kinematics(self.model, self.data)
        hand_at_zero = self.data.body("hand").xpos.copy()
        self.arm.reset(self.data, u)
        mujoco.mj_kinematics(self.model, self.data)
        # The coordinates of the free points count from where they hang when all joints
        # are at zero.
        displacement = self.data.body("hand").xpos - hand_at_zero
        for row in point_names(self.cloth)[1:]:
            for name in row:
                for axis, value in zip("xyz", displacement, strict=True):
                    self.data.joint(f"{name}_{axis}").qpos[0] = value

    def reset(
        self, *, seed: int | None = None, options: dict | None = None
    ) -> tuple[Observation, dict]:
        """Start an episode with the cloth hanging still; return the observation and an
        empty info.

        The option `{"random_start": True}` draws the posture from the command range; a
        seed repeats it, bit for bit.
        """
        self.start(seed=seed, **({} if options is None else options))
        return self.observe(), {}

    def advance(
        self, u: ArrayLike, watch: Callable[[], None] | None = None, samples: int = 1
    ) -> None:
        """Hold the command `[D_u]` for one control period, without looking; `step`,
        `rollout` and all else use this.

        `watch` is called `samples` times in the period, evenly, the last time at its
        end. It must not change the scene; then a run that is watched is the same, bit
        for bit.
        """
        check_number("samples", samples, int, at_least=1, at_most=self.scene.substeps)
        self.arm.command(self.data, check_command(self.arm, u))
        parts = samples if watch else 1
        for k in range(parts):
            self._simulate((self.scene.substeps + parts - 1 - k) // parts)
            if watch:
                # All that a picture needs: camera and light stand still
                mujoco.mj_kinematics(self.model, self.data)
                watch()
        mujoco.mj_forward(self.model, self.data)

    def observe(self) -> Observation:
        """What camera and robot sense now: `{"image": cloth mask [H, W] of 0 and 1,
        "robot": robot state [D_r]}`.
        """
        return {
            "image": vision.cloth_mask(self.camera_picture()).astype(np.int8),
            "robot": self.arm.state(self.data),
        }

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict]:
        """Hold the command `[D_u]` for one control period, and look."""
        self.advance(action)
        return self.observe(), 0.0, False, False, {}

    def picture(self, view: str | mujoco.MjvCamera = "camera") -> np.ndarray:
        """The scene for people, `[h, w, 3]` uint8, of the size `scene.picture_size`,
        from a `view` as below.
        """
        return self.camera_picture(*self.scene.picture_size, view=view)

    def camera_picture(
        self,
        height: int = vision.HEIGHT,
        width: int = vision.WIDTH,
        *,
        depth: bool = False,
        view: str | mujoco.MjvCamera = "camera",
    ) -> np.ndarray:
        """What the camera sees, `[height, width, 3]` uint8; or how far away that is,
        `[height, width]` float32 [m].

        A `view` is another camera of the scene by its name, or one placed for this
        picture. A ValueError if the picture is larger than `scene.picture_size`.
        """
        renderer = self.renderer(height, width)
        renderer.update_scene(self.data, view)
        if depth:
            renderer.enable_depth_rendering()
        try:
            picture = renderer.render()
        finally:
            renderer.disable_depth_rendering()
            _release_opengl()
        return picture

    def renderer(self, height: int, width: int) -> mujoco.Renderer:
        """MuJoCo's renderer of that size [pixel], made when it is first asked for."""
        size = height, width = (
            check_number("height", height, int),
            check_number("width", width, int),
        )
        room = self.model.vis.global_
        if not (1 <= height <= room.offheight and 1 <= width <= room.offwidth):
            has = f"{room.offwidth}×{room.offheight} pixels"
            raise ValueError(
                f"Scene(picture_size=...) made room for {has}, got {width}×{height}"
            )
        if size not in self._renderers:
            self._renderers[size] = _make_renderer(self.model, height, width)
        return self._renderers[size]

    def cloth_points(self) -> np.ndarray:
        """Positions of the point masses in the world, `[rows, columns, 3]` [m]; row 0
        is in the hand.
        """
        return np.array(
            [
                [self.data.body(name).xpos for name in row]
                for row in point_names(self.cloth)
            ]
        )

    def close(self) -> None:
        """Release the OpenGL contexts."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _simulate(self, steps: int) -> None:
        mujoco.mj_step(self.model, self.data, steps)
        if any(self.data.warning[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation of cloth {self.cloth.label} diverged; use a smaller time_step than "
                f"{self.scene.time_step} s, a heavier cloth or a softer one"
            )


def _shape(cloth: Cloth) -> tuple:
    return cloth.rows, cloth.columns, cloth.length, cloth.width


def _release_opengl() -> None:
    """Let go of this thread's OpenGL context, since EGL refuses it to others as long as
    one thread holds it.

    JupyterLab runs cells in one thread and calls widgets in another.
    """
    if os.environ.get("MUJOCO_GL") == "egl":
        from mujoco.egl import EGL

        EGL.eglReleaseThread()


def _make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # each back end raises its own kind
        raise RuntimeError(
            "no OpenGL for drawing: install one with `apt-get install libegl1 libopengl0 libgl1-mesa-dri` "
            "and restart Python; `python -m clothlab doctor` tests it"
        ) from error
    # Shadows and reflections cost a third of the time and only disturb the colour
    # extraction.
    if height <= vision.HEIGHT:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return renderer
