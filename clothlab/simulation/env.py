"""The scene (arm, cloth, camera) as a Gymnasium environment.

A step of it is one control period of 0.2 s.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import (
    Checked,
    check_flag,
    check_kind,
    check_number,
    check_seed,
    choose,
    setting,
)
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
from clothlab.simulation.rendering import Renderers, draw
from clothlab.simulation.trial import CONTROL_PERIOD, Recording, Trial

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
                "Scene.time_step must divide the control period of "
                f"{CONTROL_PERIOD} s: 0.002, for one"
            )

    @property
    def substeps(self) -> int:
        """Time steps in a control period."""
        return round(CONTROL_PERIOD / self.time_step)


def build_spec(arm: Arm, cloth: Cloth, scene: Scene | None = None) -> mujoco.MjSpec:
    """Assemble the MuJoCo specification of arm, cloth, camera, light and floor.

    Its `.to_xml()` shows it as MJCF.
    """
    scene = Scene() if scene is None else scene

    # The world, with room for the largest picture
    spec = mujoco.MjSpec.from_file(str(_WORLD))
    spec.option.timestep = scene.time_step
    height, width = scene.picture_size
    spec.visual.global_.offheight = max(height, vision.HEIGHT)
    spec.visual.global_.offwidth = max(width, vision.WIDTH)

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
    if camera.roll:
        # MuJoCo keeps a camera upright that follows a body: this one does not.
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, camera.axes.T.ravel())
        direction = {"quat": quaternion}
    else:
        follow = mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY
        direction = {"mode": follow, "targetbody": target.name}
    parent.add_camera(name="camera", pos=camera.position, fovy=camera.fovy, **direction)


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


# The options of `reset`, and what each of them does.
_RESET_OPTIONS = {"random_start": "begin in a posture drawn from the command range"}


class ClothEnv(gymnasium.Env):
    """A robot arm that holds a cloth in front of a camera.

    * action: the command `u`, `[D_u]`, in the arm's units; `env.arm.command_names`
      names them.
    * observation: `{"image": cloth mask [H, W] of 0 and 1, "robot": robot state
      [D_r]}`.
    * reward: always 0; the paper's method has none. An episode never ends by itself.

    Args:
        arm: An arm, or the name of one of `ARMS`.
        cloth: A cloth, or the name of one of `CLOTHS` or `FOAMS`.
        scene: Time step, start and size of pictures; `Scene()` by default.
        render_mode: `"rgb_array"` makes `render` draw a picture for people, which is
            what Gymnasium's `RecordVideo` asks for.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, declared so by Gymnasium
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    cloth: Cloth
    model: mujoco.MjModel  # MuJoCo's model of the scene
    data: mujoco.MjData  # and its state

    def __init__(
        self,
        arm: Arm | str = "torque",
        cloth: Cloth | str = "damp0.05-mass0.10",
        *,
        scene: Scene | None = None,
        render_mode: str | None = None,
    ):
        if render_mode is not None:
            modes = self.metadata["render_modes"]
            choose("render mode", render_mode, {mode: mode for mode in modes})
        self.render_mode = render_mode
        self.arm = get_arm(arm)
        self.scene = Scene() if scene is None else scene
        self._renderers = Renderers()
        self._recording: Recording | None = None
        self._sensed: Observation = {}
        self.hold(cloth)

        self.action_space = _action_space(self.arm)
        self.observation_space = _observation_space(self.arm)

    def hold(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still at the arm's home.

        `reset` comes next. The cloth before stays in the hand if this one is unknown,
        or diverges with this time step (`SimulationError`).
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

        # The renderers know the surface of the last one. Only another shape needs new
        # ones: making them takes longer than a step.
        if before["cloth"] is not None and _shape(cloth) != _shape(before["cloth"]):
            self.close()

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode without looking at it: `reset` without the observation."""
        check_flag("random_start", random_start)
        super().reset(seed=None if seed is None else check_seed(seed))
        u = self.arm.home_command
        if random_start:
            u = self.np_random.uniform(self.arm.command_lower, self.arm.command_upper)

        # The cloth is put below the hand, and swings out.
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
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict]:
        """Start an episode with the cloth hanging still; the observation, no info.

        The option `{"random_start": True}` draws the posture from the command range; a
        seed repeats it, bit for bit.
        """
        options = {} if options is None else check_kind("options", options, dict)
        for name in options:
            choose("option of reset", name, _RESET_OPTIONS)
        self.start(seed=seed, **options)
        return self._sense(), {}

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict]:
        """Hold the command `[D_u]` for one control period, and look."""
        recording = self._recording
        if recording is None:
            self.advance(action)
        else:
            u = check_command(self.arm, action)
            recording.keep(self._sensed, u)
            self.advance(u, recording.watch, recording.samples)
        return self._sense(), 0.0, False, False, {}

    def advance(
        self, u: ArrayLike, watch: Callable[[], None] | None = None, samples: int = 1
    ) -> None:
        """Hold the command `[D_u]` for one control period, without looking.

        `watch` is called `samples` times in the period, evenly, the last time at its
        end. It must not change the scene; then a run that is watched is the same, bit
        for bit. `step`, `rollout` and all else use this.
        """
        substeps = self.scene.substeps
        check_number("samples", samples, int, at_least=1, at_most=substeps)
        self.arm.command(self.data, check_command(self.arm, u))
        parts = samples if watch else 1
        for k in range(parts):
            # As even as whole time steps can be
            self._simulate((substeps + parts - 1 - k) // parts)
            if watch:
                # All that a picture needs: camera and light stand still.
                mujoco.mj_kinematics(self.model, self.data)
                watch()
        mujoco.mj_forward(self.model, self.data)

    def observe(self) -> Observation:
        """What camera and robot sense now.

        `{"image": cloth mask [H, W] of 0 and 1, "robot": robot state [D_r]}`
        """
        return {
            "image": vision.cloth_mask(self.camera_picture()).astype(np.int8),
            "robot": self.arm.state(self.data),
        }

    def _sense(self) -> Observation:
        """Observe, and remember it, whatever a policy does with its arrays."""
        observation = self.observe()
        self._sensed = {
            "image": observation["image"].astype(bool),
            "robot": observation["robot"].copy(),
        }
        return observation

    @contextmanager
    def recording(
        self, watch: Callable[[], None] | None = None, samples: int = 1
    ) -> Iterator[Callable[[str, int], Trial]]:
        """While inside, keep what each `step` saw and sent, and `watch` it.

        It yields a function that makes a `Trial` of the steps so far, given the name of
        the policy and the seed. `rollout` calls this. Since the environment itself
        keeps the record, it is in the arm's units, whatever wrappers do on the way.
        """
        substeps = self.scene.substeps
        check_number("samples", samples, int, at_least=1, at_most=substeps)
        kept = Recording(watch, samples)
        self._sense()
        before = self._recording
        self._recording = kept
        try:
            yield lambda policy, seed: kept.trial(self.cloth, self.arm, policy, seed)
        finally:
            self._recording = before

    def render(self) -> np.ndarray | None:
        """Gymnasium's word for `picture`; nothing without a `render_mode`."""
        return None if self.render_mode is None else self.picture()

    def picture(self, view: str | mujoco.MjvCamera = "camera") -> np.ndarray:
        """The scene for people, `[h, w, 3]` uint8, of the size `scene.picture_size`.

        The `view` is as in `camera_picture`.
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
        """What the camera sees, `[height, width, 3]` uint8.

        With `depth`, how far away that is, `[height, width]` float32 [m]. A `view` is
        another camera of the scene by its name, or one placed for this picture. A
        ValueError if the picture is larger than `scene.picture_size`.
        """
        return draw(self.renderer(height, width), self.data, view, depth)

    def renderer(self, height: int, width: int) -> mujoco.Renderer:
        """MuJoCo's renderer of that size [pixel], made when it is first asked for."""
        return self._renderers.get(self.model, height, width)

    def cloth_points(self) -> np.ndarray:
        """Positions of the point masses in the world, `[rows, columns, 3]` [m].

        Row 0 is in the hand.
        """
        names = point_names(self.cloth)
        return np.array([[self.data.body(name).xpos for name in row] for row in names])

    def close(self) -> None:
        """Release the OpenGL contexts."""
        self._renderers.close()

    def _simulate(self, steps: int) -> None:
        mujoco.mj_step(self.model, self.data, steps)
        if any(self.data.warning[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation of cloth {self.cloth.label} diverged; use a smaller "
                f"time_step than {self.scene.time_step} s, a heavier cloth or a softer "
                "one"
            )


def _action_space(arm: Arm) -> gymnasium.spaces.Box:
    """The commands of an arm, as Gymnasium wants them described."""
    lower = arm.command_lower
    upper = arm.command_upper
    return gymnasium.spaces.Box(lower, upper, dtype=np.float64)


def _observation_space(arm: Arm) -> gymnasium.spaces.Dict:
    """What is observed, likewise."""
    size = len(arm.state_names)
    image = gymnasium.spaces.MultiBinary((vision.HEIGHT, vision.WIDTH))
    robot = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
    return gymnasium.spaces.Dict({"image": image, "robot": robot})


def _shape(cloth: Cloth) -> tuple:
    return cloth.rows, cloth.columns, cloth.length, cloth.width
