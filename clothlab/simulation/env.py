"""The scene (arm, cloth, camera) as a Gymnasium environment.

A step of it is one control period of 0.2 s.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH, check_number, choose
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import Cloth, get_cloth
from clothlab.simulation.cloth_elements import point_names
from clothlab.simulation.rendering import draw, make_renderer
from clothlab.simulation.scene import CONTROL_PERIOD, Scene, build_spec
from clothlab.simulation.trial import Recording, Trial
from clothlab.simulation.vision import Observation, cloth_mask

_DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


class SimulationError(RuntimeError):
    """The physics diverged: a coordinate became infinite, NaN or absurdly large."""


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
        scene: Time step, start and size of pictures.
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
        scene: Scene = Scene(),
        render_mode: str | None = None,
    ):
        if render_mode is not None:
            choose("render mode", render_mode, dict.fromkeys(["rgb_array"]))
        if not isinstance(scene, Scene):
            kind = type(scene).__name__
            raise ValueError(f"scene is a Scene(time_step=...), got {kind} {scene}")
        self.render_mode = render_mode
        self.arm = get_arm(arm)
        self.cloth = get_cloth(cloth)
        self.scene = scene
        # MuJoCo's renderers, by height and width of their pictures [pixel]
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._recording: Recording | None = None
        self._sensed: Observation = {}
        self.hold(cloth)

        # Commands and observations, as Gymnasium describes them
        low = self.arm.command_lower
        high = self.arm.command_upper
        self.action_space = spaces.Box(low, high, dtype=np.float64)
        sensors = (len(self.arm.state_names),)
        self.observation_space = spaces.Dict(
            {
                "image": spaces.MultiBinary((HEIGHT, WIDTH)),
                "robot": spaces.Box(-np.inf, np.inf, sensors, np.float64),
            }
        )

    def hold(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand, hanging still at the arm's home.

        `reset` comes next; after a `SimulationError`, another cloth.
        """
        before = self.cloth
        self.cloth = get_cloth(cloth)
        self.model = self._spec().compile()
        self.data = mujoco.MjData(self.model)

        # The renderers know the surface of the last one. Only another shape needs new
        # ones: making them takes longer than a step.
        if _shape(before) != _shape(self.cloth):
            self.close()
        self.start()

    def start(self, *, seed: int | None = None, random_start: bool = False) -> None:
        """Begin an episode without looking at it: `reset` without the observation."""
        # Gymnasium knows no whole numbers but Python's own
        if seed is not None:
            seed = check_number("seed", seed, int, at_least=0)
        super().reset(seed=seed)
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
        options = {} if options is None else options
        for name in options:
            choose("option of reset", name, dict.fromkeys(["random_start"]))
        self.start(seed=seed, **options)
        return self._sense(), {}

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict]:
        """Hold the command `[D_u]` for one control period, and look."""
        recording = self._recording
        if recording is None:
            self.advance(action)
        else:
            u = self.arm.check_command(action)
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
        self.arm.command(self.data, self.arm.check_command(u))
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
            "image": cloth_mask(self.camera_picture()).astype(np.int8),
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
        height: int = HEIGHT,
        width: int = WIDTH,
        *,
        depth: bool = False,
        view: str | mujoco.MjvCamera = "camera",
    ) -> np.ndarray:
        """What the camera sees, `[height, width, 3]` uint8.

        With `depth`, how far away that is, `[height, width]` float32 [m]. A `view` is
        another camera of the scene by its name, or one placed for this picture.
        """
        size = (height, width)
        if size not in self._renderers:
            self._renderers[size] = make_renderer(self.model, height, width)
        return draw(self._renderers[size], self.data, view, depth)

    def cloth_points(self) -> np.ndarray:
        """Positions of the point masses in the world, `[rows, columns, 3]` [m].

        Row 0 is in the hand.
        """
        names = point_names(self.cloth)
        return np.array([[self.data.body(name).xpos for name in row] for row in names])

    def close(self) -> None:
        """Release the OpenGL contexts."""
        while self._renderers:
            _, renderer = self._renderers.popitem()
            renderer.close()

    def _simulate(self, steps: int) -> None:
        mujoco.mj_step(self.model, self.data, steps)
        if any(self.data.warning[kind].number for kind in _DIVERGED):
            raise SimulationError(
                f"the simulation of cloth {self.cloth.label} diverged; use a smaller "
                f"time_step than {self.scene.time_step} s, a heavier cloth or a softer "
                "one"
            )


def _shape(cloth: Cloth) -> tuple:
    return cloth.rows, cloth.columns, cloth.length, cloth.width
