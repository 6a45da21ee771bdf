"""The scene (arm, cloth, camera) as a Gymnasium environment whose step is one control period of 0.2 s."""

import os
from dataclasses import dataclass, field

import gymnasium
import mujoco
import numpy as np

from clothlab import vision
from clothlab.arm import Arm, check_command, get_arm
from clothlab.cloth import Cloth, add_cloth, get_cloth, point_names

__all__ = ["CONTROL_PERIOD", "ClothEnv", "Scene", "SimulationError", "build_spec"]

CONTROL_PERIOD = 0.2  # [s], the paper's 5 Hz
BACKGROUND = (0.93, 0.95, 0.97)  # light, because pictures are projected


class SimulationError(RuntimeError):
    """The physics diverged: a coordinate became infinite, NaN or absurdly large."""


@dataclass(frozen=True)
class Scene:
    """Time step and start of a scene, and how large its pictures for people are."""

    time_step: float = field(default=0.002, metadata={"unit": "s"})  # notebook 01 measures what halving it changes
    settle_time: float = field(default=2.0, metadata={"unit": "s"})  # the cloth hangs still before a trial starts
    picture_size: tuple[int, int] = field(default=(480, 640), metadata={"unit": "pixel"})  # of `render()`, for people


def build_spec(arm: Arm, cloth: Cloth, scene: Scene | None = None) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of arm, cloth, camera, light and floor; `.to_xml()` shows it as MJCF."""
    scene = scene or Scene()
    spec = mujoco.MjSpec()
    spec.option.timestep = scene.time_step
    # Not implicitfast: it treats the springs' damping as if each neighbour stood still, which adds up to 14 % to the
    # inertia of a light cloth. Notebook 01 measures both.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    world = spec.worldbody
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=BACKGROUND,
        rgb2=BACKGROUND,
        width=16,
        height=16,
    )
    spec.visual.map.shadowclip = 6  # smaller ones leave speckles on the floor
    spec.visual.headlight.ambient = [0.45] * 3
    spec.visual.headlight.diffuse = [0.3] * 3
    world.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[0, 0, 3], dir=[-0.3, 0.4, -1.0], diffuse=[0.35] * 3
    )
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],  # without end
        rgba=(0.95, 0.95, 0.93, 1),
        contype=0,
        conaffinity=0,
    )
    world.add_geom(  # a post, so that the shoulder does not float
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[0, 0, 0, 0, 0, 1.0],
        size=[0.03, 0, 0],
        rgba=(0.55, 0.56, 0.58, 1),
        contype=0,
        conaffinity=0,
    )
    target = world.add_body(name="camera_target", pos=arm.camera.target)
    target.add_site(size=[0.001, 0, 0], group=4)
    world.add_camera(
        name="camera",
        pos=arm.camera.position,
        fovy=arm.camera.fovy,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY,
        targetbody="camera_target",
    )
    hand, position = arm.add_to(spec)
    add_cloth(spec, cloth, hand, position, front_forward=arm.camera.position[0] > position[0])
    return spec


class ClothEnv(gymnasium.Env):
    """A robot arm that holds a cloth in front of a camera.

    * action: the command `u`, `[D_u]`, in the arm's units; `env.arm.command_names` names them.
    * observation: `{"image": cloth mask [H, W], "robot": robot state [D_r]}`.
    * reward: minus the chamfer distance [pixel] to `target`, and 0 without a target. The paper's method never reads it.

    An episode has no natural end: `terminated` and `truncated` stay false. Reset draws nothing at random unless
    `options={"random_start": True}` asks for a random posture; the cloth then hangs still before the episode starts.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012 (Gymnasium's own name and type)

    def __init__(
        self,
        arm: Arm | str = "torque",
        cloth: Cloth | str = "damp0.05-mass0.10",
        *,
        target: np.ndarray | None = None,
        scene: Scene | None = None,
        render_mode: str | None = "rgb_array",
        pictures_per_step: int = 0,
    ):
        """Build the scene.

        Args:
            arm: an arm or its name.
            cloth: a cloth or its name.
            target: mask `[H, W]` that the reward compares with.
            scene: time step, camera and start.
            render_mode: `"rgb_array"`, or None when no pictures for people are wanted.
            pictures_per_step: how many to add to `env.pictures` in each control step; 5 make a video of 25 a second.

        Raises:
            KeyError: unknown arm or cloth.
            ValueError: a target of another shape or with no cloth in it, or an unknown render mode.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"unknown render_mode {render_mode!r}; choose from None, rgb_array")
        self.arm = get_arm(arm) if isinstance(arm, str) else arm
        self.scene = scene or Scene()
        self.target = None if target is None else vision.check_mask(target)
        self.render_mode = render_mode
        self.pictures: list[np.ndarray] = []
        self._pictures_per_step = pictures_per_step
        self._substeps = round(CONTROL_PERIOD / self.scene.time_step)
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self.cloth: Cloth | None = None
        self.hold(cloth)

        spaces = gymnasium.spaces
        self.action_space = spaces.Box(self.arm.command_lower, self.arm.command_upper, dtype=np.float64)
        self.observation_space = spaces.Dict(
            {
                "image": spaces.MultiBinary((vision.HEIGHT, vision.WIDTH)),
                "robot": spaces.Box(-np.inf, np.inf, (len(self.arm.state_names),), np.float64),
            }
        )

    def hold(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand; `reset` comes next.

        Args:
            cloth: a cloth or its name.

        Raises:
            KeyError: unknown cloth.
        """
        cloth, before = get_cloth(cloth) if isinstance(cloth, str) else cloth, self.cloth
        if before is not None and _shape(cloth) != _shape(before):
            self.close()  # the renderers know the surface of the last one; making new ones takes longer than a step
        self.cloth = cloth
        self.model = build_spec(self.arm, cloth, self.scene).compile()
        self.data = mujoco.MjData(self.model)
        self._points = [name for row in point_names(cloth) for name in row]
        mujoco.mj_kinematics(self.model, self.data)
        self._hand_at_zero = self.data.body("hand").xpos.copy()

    def reset(self, *, seed: int | None = None, options: dict | None = None):
        """Start an episode with the cloth hanging still.

        Args:
            seed: for `random_start`; the same seed gives the same episode, bit for bit.
            options: `{"random_start": True}` draws the posture from the command range instead of the arm's home.

        Returns:
            Observation and an empty info, as Gymnasium has it.
        """
        super().reset(seed=seed)
        u = self.arm.home_command
        if (options or {}).get("random_start", False):
            u = self.np_random.uniform(self.arm.command_lower, self.arm.command_upper)
        mujoco.mj_resetData(self.model, self.data)
        self.arm.reset(self.data, u)
        self._hang_cloth()
        self._advance(round(self.scene.settle_time / self.scene.time_step))
        self.data.time = 0.0
        return self._observation(), {}

    def step(self, action: np.ndarray):
        """Hold the command `[D_u]` for one control period.

        Raises:
            ValueError: a command of another shape, not finite or out of range.
            SimulationError: the physics diverged.
        """
        self.arm.command(self.data, check_command(self.arm, action))
        parts = np.array_split(np.arange(self._substeps), max(1, self._pictures_per_step))
        for part in parts:
            self._advance(len(part))
            if self._pictures_per_step:
                mujoco.mj_forward(self.model, self.data)
                self.pictures.append(self.render())
        observation = self._observation()
        reward = 0.0
        if self.target is not None and observation["image"].any():
            reward = -vision.chamfer_distance(observation["image"], self.target)
        return observation, reward, False, False, {}

    def render(self) -> np.ndarray | None:
        """Picture of the scene for people, `[h, w, 3]` uint8, of the size `scene.picture_size`."""
        return None if self.render_mode is None else self.camera_picture(*self.scene.picture_size)

    def camera_picture(self, height: int = vision.HEIGHT, width: int = vision.WIDTH) -> np.ndarray:
        """What the camera sees, `[height, width, 3]` uint8.

        Raises:
            RuntimeError: no OpenGL on this machine; the message says what to install.
        """
        renderer = self.renderer(height, width)
        renderer.update_scene(self.data, "camera")
        picture = renderer.render()
        _release_opengl()
        return picture

    def renderer(self, height: int, width: int) -> mujoco.Renderer:
        """MuJoCo's renderer of that size [pixel], made when it is first asked for.

        Raises:
            RuntimeError: no OpenGL on this machine; the message says what to install.
        """
        size = (height, width)
        if size not in self._renderers:
            self._renderers[size] = _make_renderer(self.model, height, width)
        return self._renderers[size]

    def cloth_points(self) -> np.ndarray:
        """Positions of the point masses in the world, `[rows, columns, 3]` [m]; row 0 is in the hand."""
        points = np.array([self.data.body(name).xpos for name in self._points])
        return points.reshape(self.cloth.rows, self.cloth.columns, 3)

    def close(self) -> None:
        """Release the OpenGL contexts."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _hang_cloth(self) -> None:
        """Move the free points straight below the hand.

        Their coordinates count from where they hang when all joints are at zero.
        """
        mujoco.mj_kinematics(self.model, self.data)
        displacement = self.data.body("hand").xpos - self._hand_at_zero
        for name in self._points[self.cloth.columns :]:
            for axis_name, value in zip("xyz", displacement, strict=True):
                self.data.joint(f"{name}_{axis_name}").qpos[0] = value

    def _advance(self, steps: int) -> None:
        mujoco.mj_step(self.model, self.data, steps)
        warnings = self.data.warning
        if any(warnings[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation of cloth {self.cloth.name!r} diverged at {self.data.time:.2f} s; "
                f"use a smaller time_step than {self.scene.time_step} s or a softer cloth"
            )

    def _observation(self) -> dict[str, np.ndarray]:
        mujoco.mj_forward(self.model, self.data)
        mask = vision.cloth_mask(self.camera_picture())
        return {"image": mask.astype(np.int8), "robot": self.arm.state(self.data)}


_DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


def _shape(cloth: Cloth) -> tuple:
    return cloth.rows, cloth.columns, cloth.length, cloth.width


def _release_opengl() -> None:
    """Let go of this thread's OpenGL context, since EGL refuses it to others as long as one thread holds it.

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
            "no OpenGL for drawing: install one with `apt-get install libegl1 libgl1-mesa-dri` and restart Python; "
            "`python -m clothlab doctor` tests it"
        ) from error
    # Shadows and reflections cost a third of the time and only disturb the colour extraction.
    if height <= vision.HEIGHT:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return renderer
