"""A live run that a person steers: robot, cloth, target, who moves it, and what is remembered. No widgets here."""

import re
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from clothlab import artifacts
from clothlab._choices import choose
from clothlab.analysis import nearest_material
from clothlab.arm import check_command, get_arm
from clothlab.autoencoder import decode, encode
from clothlab.cloth import Cloth, get_cloth
from clothlab.control import ControlPolicy, recorded_plans
from clothlab.dpmpb import observe
from clothlab.env import ClothEnv, Scene
from clothlab.estimation import BiasEstimator
from clothlab.trials import OperatorPolicy, RandomPolicy, Trial, load_trial, save_trial
from clothlab.vision import HEIGHT, WIDTH, chamfer_distance, check_mask

__all__ = ["DRIVERS", "SETUPS", "LiveSession", "Moment", "Recorder", "Setup", "mask_from_file"]

YARDSTICK_EVERY = 20  # of the recorded images, one in so many serves as a yardstick for drawn ones
RECORDED_TARGETS = 7  # how many recorded images the gallery has
DRIVERS = ("control", "hand", "random", "operator")


@dataclass(frozen=True)
class Setup:
    """What a session starts with on each arm: the sets of weights and trials, a cloth and a target."""

    weights: str = field(metadata={"unit": "-"})
    trials: str = field(metadata={"unit": "-"})
    cloth: str = field(metadata={"unit": "-"})
    target: str = field(metadata={"unit": "-"})


SETUPS = {
    "torque": Setup("torque-0", "train", "damp0.05-mass0.10", "target-2"),
    "muscle": Setup("muscle-0", "muscle-train", "soft-1", "muscle"),
}


@dataclass(frozen=True, eq=False)
class Moment:
    """What one control step of a session saw and did.

    Attributes:
        step: number of the step since the last reset.
        image: cloth mask `[H, W]`, bool.
        reconstruction: what the autoencoder makes of it `[H, W]`, 0 to 1.
        distance: ‖z_ref - z‖ [s.d. of z].
        command: `[D_u]`, in the arm's units.
        theta: joint angles `[2]` [rad].
        p: parametric bias in use `[D_p]`.
        seconds: what the step took to compute [s].
        solved: whether the controller solved for this command, or went on with its last plan.
    """

    step: int
    image: np.ndarray
    reconstruction: np.ndarray
    distance: float
    command: np.ndarray
    theta: np.ndarray
    p: np.ndarray
    seconds: float
    solved: bool


class Recorder:
    """Keeps a running recording on disk in pieces of a second, so that a kernel that dies loses no more than that."""

    PIECE = 5  # control steps

    def __init__(self, folder: Path):
        """Prepare.

        Args:
            folder: where finished recordings and, below it, the pieces of the running one go.
        """
        self.folder, self.pieces = folder, folder / "unfinished"
        self._rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def start(self) -> None:
        """Begin anew.

        Raises:
            FileExistsError: pieces of an earlier recording lie there: `finish` or `discard` them first.
        """
        if any(self.pieces.glob("*.npz")):
            raise FileExistsError("an unfinished recording was found: save it under a name, or discard it")
        self._rows = []

    def add(self, observation: dict[str, np.ndarray], u: np.ndarray, about: dict) -> None:
        """Take in a step; `about` is the trial's cloth, arm, policy and seed."""
        self._rows.append((observation["image"].astype(bool), observation["robot"], u))
        if len(self._rows) == self.PIECE:
            self.flush(about)

    def flush(self, about: dict) -> None:
        """Put what is not on disk yet there."""
        if not self._rows:
            return
        images, robot, commands = (np.array(column) for column in zip(*self._rows, strict=True))
        number = len(list(self.pieces.glob("*.npz")))
        save_trial(Trial(images, robot, commands, **about), self.pieces / f"{number:05d}.npz")
        self._rows = []

    def path(self, name: str) -> Path:
        """Where a recording of this name would go.

        Args:
            name: letters, digits, `-` and `_`.

        Raises:
            ValueError: a name that exists, is empty, or would leave the folder.
        """
        if not re.fullmatch(r"[\w-]+", name):
            raise ValueError(f"a recording's name has letters, digits, - and _ only, got {name!r}")
        path = self.folder / f"{name}.npz"
        if path.exists():
            raise ValueError(f"a recording named {name!r} exists: choose another name")
        return path

    def finish(self, name: str) -> Path:
        """Join the pieces into `NAME.npz`.

        Raises:
            ValueError: as `path`, or nothing was recorded.
        """
        path = self.path(name)
        parts = [load_trial(piece) for piece in sorted(self.pieces.glob("*.npz"))]
        if not parts:
            raise ValueError("nothing was recorded")
        joined = {
            key: np.concatenate([getattr(part, key) for part in parts]) for key in ("images", "robot", "commands")
        }
        save_trial(replace(parts[0], **joined), path)
        self.discard()
        return path

    def discard(self) -> None:
        """Forget the running or an unfinished recording."""
        self._rows = []
        for piece in self.pieces.glob("*.npz"):
            piece.unlink()


def mask_from_file(content: bytes) -> np.ndarray:
    """Read a target from a picture file: bright is cloth.

    Returns:
        Mask `[H, W]`, bool.

    Raises:
        ValueError: not a picture, another size, or no cloth in it.
    """
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE) if content else None
    if picture is None:
        raise ValueError("this file is not a picture: use PNG or JPEG")
    if picture.shape != (HEIGHT, WIDTH):
        raise ValueError(f"a target has {WIDTH}×{HEIGHT} pixels, this picture {picture.shape[1]}×{picture.shape[0]}")
    return check_mask(picture > 127)


def _misunderstanding(mask: np.ndarray, reconstruction: np.ndarray) -> float:
    """Chamfer distance [pixel] between a mask and its reconstruction; infinite where no cloth is left."""
    believed = reconstruction > 0.5
    return chamfer_distance(mask, believed) if believed.any() else np.inf


class LiveSession:
    """One robot with one cloth, step by step; everything can be changed between two steps.

    Attributes:
        driver: who chooses the commands, one of `DRIVERS`.
        estimating: whether p follows what is observed.
        hand: the command `[D_u]` that the driver "hand" sends.
        recorder: keeps recordings.
        recording: whether steps are being recorded.
        gallery: images to aim at, `{name: mask [H, W]}`: the stored targets, and recorded ones from large to small.
        usual_distance: how far the reconstruction of a recorded image is from it, 99th percentile [pixel].
    """

    def __init__(
        self, arm: str = "torque", *, recordings: Path | None = None, picture_size: tuple[int, int] = (288, 384)
    ):
        """Start with an arm's own cloth, target and p.

        Args:
            arm: name of an arm.
            recordings: folder for recorded trials; by default `data/trials/mine`, which `load_trials("mine")` reads.
            picture_size: of the scene's picture, height and width [pixel].

        Raises:
            KeyError: unknown arm, or weights that are missing; the message lists the choices.
        """
        self.recorder = Recorder(recordings or artifacts.DATA / artifacts.OWN_TRIALS)
        self._scene = Scene(picture_size=picture_size)
        self.driver, self.estimating, self.recording = "control", False, False
        self.env: ClothEnv | None = None
        self.set_arm(arm)

    def set_arm(self, name: str) -> None:
        """Change the arm, and with it weights, cloth, target and p."""
        self._refuse_while_recording("the arm")
        arm, setup = get_arm(name), choose("arm", name, SETUPS)
        model, biases, _ = artifacts.load_dpmpb(setup.weights)
        autoencoder, _ = artifacts.load_autoencoder(name)
        trials, targets = artifacts.load_trials(setup.trials), artifacts.load_targets()
        # All is there: only now does anything change.
        self.arm, self.model, self.biases = arm, model.requires_grad_(False), biases
        self.autoencoder, self._plans, self._target = autoencoder, recorded_plans(trials), targets[setup.target]
        images = np.concatenate([trial.images[::YARDSTICK_EVERY] for trial in trials])
        images = images[images.any(axis=(1, 2))]
        distances = map(_misunderstanding, images, decode(autoencoder, encode(autoencoder, images)))
        self.usual_distance = float(np.percentile(list(distances), 99))
        large_to_small = images[images.sum(axis=(1, 2)).argsort()[::-1]]
        recorded = large_to_small[:: -(-len(images) // RECORDED_TARGETS)]
        self.gallery = targets | {f"recorded {k + 1}": image for k, image in enumerate(recorded)}
        self.hand, self._tension = arm.home_command, None
        self._p = biases[setup.cloth].copy()
        self.set_cloth(setup.cloth)

    def set_cloth(self, cloth: Cloth | str) -> None:
        """Put another cloth into the hand; p stays, so that the estimation has something to find."""
        self._refuse_while_recording("the cloth")
        cloth = get_cloth(cloth) if isinstance(cloth, str) else cloth
        if self.env is not None and self.env.arm is self.arm:
            self.env.hold(cloth)
        else:
            if self.env is not None:
                self.env.close()
            self.env = ClothEnv(self.arm, cloth, scene=self._scene)
        self.reset()

    def set_material(self, damping: float, mass: float) -> None:
        """Change C_damp [N s/m] and C_mass [kg] of the cloth in the hand, which starts again from rest.

        Raises:
            ValueError: values that no cloth has.
        """
        name = f"damp{damping:.3f}-mass{mass:.3f}"
        self.set_cloth(replace(self.env.cloth, name=name, damping=damping, mass=mass))

    def reset(self) -> None:
        """Let the cloth hang still at the arm's home; controller and estimator forget what they saw."""
        self._refuse_while_recording("the run")
        self.observation, _ = self.env.reset()
        self.step_number = 0
        self._random = {
            "random": RandomPolicy(self.arm, seed=time.time_ns() % 2**32),
            "operator": OperatorPolicy(self.arm, seed=time.time_ns() % 2**32),
        }
        self._make_controller()
        self._estimator = BiasEstimator(self.model, self._p)

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.copy()

    def set_p(self, p: np.ndarray) -> None:
        """Use this p from the next step on; the estimation goes on from it.

        Raises:
            ValueError: p of another size or not finite.
        """
        self._estimator = BiasEstimator(self.model, p)
        self._p = self._estimator.p
        self._controller.p = self._p

    @property
    def nearest(self) -> str:
        """The trained material whose p is nearest."""
        return nearest_material(self._p, self.biases)

    @property
    def target(self) -> np.ndarray:
        """Mask `[H, W]` to realise."""
        return self._target

    def set_target(self, mask: np.ndarray) -> tuple[np.ndarray, float]:
        """Aim at another image from the next step on.

        Returns:
            What the autoencoder makes of it `[H, W]`, 0 to 1, and the chamfer distance of that to what was asked
            [pixel]: beyond `usual_distance` for an image unlike any cloth, infinite where no cloth is left.

        Raises:
            ValueError: another shape, or no cloth in it.
        """
        mask = check_mask(mask)
        z = encode(self.autoencoder, mask)
        reconstruction = decode(self.autoencoder, z)
        self._target = mask
        self._controller.z_ref = torch.as_tensor(z)
        return reconstruction, _misunderstanding(mask, reconstruction)

    def set_driver(self, driver: str) -> None:
        """Change who chooses the commands.

        Raises:
            ValueError: unknown driver; the message lists the choices.
        """
        if driver not in DRIVERS:
            raise ValueError(f"unknown driver {driver!r}; choose from {', '.join(DRIVERS)}")
        self.driver = driver
        self._make_controller()

    def set_hand(self, u: np.ndarray) -> None:
        """Command `[D_u]` for the driver "hand".

        Raises:
            ValueError: another shape, not finite or out of range.
        """
        self.hand = check_command(self.arm, u)

    def set_tension(self, f_const: float | None) -> None:
        """Fix the stiffness command of a muscle arm [N], or leave it to the controller with None.

        Raises:
            ValueError: outside the arm's range, or an arm without muscles.
        """
        if f_const is not None:
            if len(self.arm.command_lower) <= len(self.arm.lower):
                raise ValueError(f"the {self.arm.name} arm has no stiffness to set")
            check_command(self.arm, [*self.arm.home_command[: len(self.arm.lower)], f_const])
        self._tension = f_const
        self._make_controller()

    def step(self, *, solve: bool = True) -> Moment:
        """Choose a command, send it, and look.

        Args:
            solve: False lets the controller go on with its last plan, for when the time for a solve has run out.

        Raises:
            SimulationError: the physics diverged.
        """
        start = time.perf_counter()
        seen = self.observation
        u, solved = self._choose(seen, solve)
        if self.recording:
            self.recorder.add(seen, u, self._about())
        if self.estimating:
            self._p = self._estimator.update(observe(self.autoencoder, seen), u)
            self._controller.p = self._p
        self.observation, *_ = self.env.step(u)
        self.step_number += 1
        image = self.observation["image"].astype(bool)
        z = encode(self.autoencoder, image)
        return Moment(
            step=self.step_number,
            image=image,
            reconstruction=decode(self.autoencoder, z),
            distance=float(np.linalg.norm(self._controller.z_ref.numpy() - z)),
            command=u,
            theta=self.arm.angles(self.env.data),
            p=self.p,
            seconds=time.perf_counter() - start,
            solved=solved,
        )

    def picture(self) -> np.ndarray:
        """The scene now, `[h, w, 3]` uint8."""
        return self.env.render()

    def record(self) -> None:
        """Start recording.

        Raises:
            FileExistsError: an unfinished recording was found: save or discard it first.
        """
        self.recorder.start()
        self.recording = True

    def stop_recording(self) -> None:
        """Stop recording; what was recorded waits to be saved or discarded."""
        if self.recording:
            self.recorder.flush(self._about())
            self.recording = False

    def save_recording(self, name: str) -> Path:
        """Stop recording and save, or save what was stopped or what an interrupted session left.

        Raises:
            ValueError: a bad or existing name (the recording then goes on), or nothing was recorded.
        """
        self.recorder.path(name)
        self.stop_recording()
        return self.recorder.finish(name)

    def discard_recording(self) -> None:
        """Stop recording and forget it."""
        self.recording = False
        self.recorder.discard()

    def close(self) -> None:
        """Release the OpenGL contexts."""
        self.env.close()

    def _choose(self, observation, solve: bool) -> tuple[np.ndarray, bool]:
        if self.driver == "control":
            solve = solve or not self._controller.trace  # the first plan must come from a solve
            return (self._controller if solve else self._controller.coast)(observation), solve
        u = self.hand.copy() if self.driver == "hand" else self._random[self.driver](observation)
        if self._tension is not None and self.driver != "hand":
            u[len(self.arm.lower) :] = self._tension
        return u, False

    def _make_controller(self) -> None:
        """Start the controller anew, since it was not asked for a while or has other limits."""
        arm = self.arm
        if self._tension is not None:
            arm = replace(arm, tension_range=(self._tension, self._tension))
        self._controller = ControlPolicy(self.model, self.autoencoder, arm, self._target, self._p, plans=self._plans)

    def _about(self) -> dict:
        return {"cloth": self.env.cloth, "arm": self.arm.name, "policy": self.driver, "seed": 0}

    def _refuse_while_recording(self, what: str) -> None:
        if self.recording:
            raise ValueError(f"{what} cannot change during a recording: save or discard it first")
