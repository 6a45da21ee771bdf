"""The method of the live lab in a page, as graphs of what Python runs.

For each arm, functions of `clothlab` become ONNX graphs, with their gradients where
they take some. So the page has no second network, loss or gradient. They are written
into `build/lab`, and anew once the code or the weights have changed.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx.external_data_helper import set_external_data
from torch import Tensor

from clothlab._files import write_bytes
from clothlab._validation import HEIGHT, WIDTH
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method._rollouts import rollout_of
from clothlab.method.cloth_task import control_loss
from clothlab.method.control import ControlSettings, Limits, descend
from clothlab.method.iterative import (
    IterativeLearningSettings,
    _descended,
    _Forecast,
    _kernel,
    _Learned,
)
from clothlab.method.model import Memory
from clothlab.method.onnx_export import _named, export_onnx
from course import lab_estimation
from course.lab_estimation import Calibrated
from course.lab_images import SAMPLES, Images
from course.repository import ROOT

LAB = ROOT / "build" / "lab"
# What graphs are made of, beside the weights
_MADE_OF = (
    "clothlab/method/*.py",
    "clothlab/simulation/vision.py",
    "course/lab_export.py",
    "course/lab_images.py",
    "course/lab_estimation.py",
)
_SUMS = ROOT / "data" / "SHA256SUMS"
_WEIGHTS = "weights"  # what the graphs of an arm have in common
_LARGE = 1024  # [byte] from which on a tensor lies there
_WINDOW = 30  # steps of an example


def graphs(trained: ClothCheckpoint, calibrated: Calibrated) -> dict[str, bytes]:
    """The graphs of an arm and their weights by name.

    Out of `build/lab`, where they are made anew only if they are old. Of what is
    calibrated, the shapes count.
    """
    folder = LAB / trained.arm.name
    stamp = folder / "made_of"
    digest = _digest()
    if not stamp.is_file() or stamp.read_text() != digest:
        shutil.rmtree(folder, ignore_errors=True)
        for name, content in export(trained, calibrated).items():
            write_bytes(folder / name, content)
        write_bytes(stamp, digest.encode())
    made = (path for path in folder.iterdir() if path != stamp)
    return {path.name: path.read_bytes() for path in sorted(made)}


def _digest() -> str:
    """Of all that graphs are made of."""
    digest = hashlib.sha256()
    for pattern in _MADE_OF:
        for path in sorted(ROOT.glob(pattern)):
            digest.update(path.read_bytes())
    sums = _SUMS.read_bytes().splitlines()
    digest.update(b"".join(line for line in sums if b"weights/" in line))
    return digest.hexdigest()


class _Method:
    """What the lab computes with the weights of an arm, as functions of tensors.

    A descent does one iteration, and the page repeats it: unrolled, three would take
    three times as long to export and to load.

    Args:
        trained: the weights.
    """

    def __init__(self, trained: ClothCheckpoint):
        self._model = trained.model
        self._rollout = rollout_of(trained.model)
        self._tensions = trained.layout.tensions
        self._z = trained.layout.z
        self._settings = ControlSettings()
        # Any one: what changes in it is put in its place
        nothing = np.ones((HEIGHT, WIDTH))
        policy = trained.controller(nothing, np.zeros(trained.model.bias_size))
        self._problem = policy.controller.problem(trained.model.s_mean)

    def follow(self, s: Tensor, u: Tensor, p: Tensor, *memory: Tensor) -> Memory:
        """The memory after a step that was seen."""
        return self._rollout(self._model, p).follow(s, u, memory)

    def predict(
        self,
        s: Tensor,
        u: Tensor,
        p: Tensor,
        h: Tensor,
        c: Tensor,
        z_ref: Tensor,
        mask: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Losses of plans `[B]`, and the distances to which they lead, `[B]`.

        Args:
            s: the state now, `[D_s]`.
            u: plans, `[B, T, D_u]`.
            p: parametric bias, `[D_p]`.
            h: hidden state of the memory, `[2, 1, 30]`.
            c: its cell state.
            z_ref: the target, `[D_z]`.
            mask: which steps count, `[T]`.
        """
        states = self._rollout(self._model, p)(s, u, Memory(h, c))
        weight = self._settings.tension_weight
        losses = control_loss(states, z_ref, mask, self._tensions, weight)
        distances = control_loss(states, z_ref, mask, slice(0), 0.0)
        return losses, distances

    def descend(self, s: Tensor, u: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """A plan u `[T, D_u]` after one iteration, and its loss before and after.

        After what `predict` is given come the limits, `lower` and `upper` `[D_u]`,
        since an arm's tension may be fixed.
        """
        *around, lower, upper = given
        limits = Limits(lower, upper, self._model.u_std * (upper > lower))

        def loss(plans: Tensor) -> Tensor:
            losses, _ = self.predict(s, plans, *around)
            return losses

        return descend(loss, u, limits, replace(self._settings, iterations=1))

    def teach(
        self, s: Tensor, u: Tensor, z: Tensor, tried: Tensor, p: Tensor, *memories: Any
    ) -> tuple[Tensor, ...]:
        """What attempts teach: the parts of `_Learned`.

        Args:
            s: states in which they began, `[N, D_s]`.
            u: their plans, `[N, T, D_u]`.
            z: what was seen after each command, `[N, T, D_z]`.
            tried: 1 for each attempt, 0 where there is none yet, `[N]`.
            p: parametric bias, `[D_p]`.
            *memories: parts of those before them, `[N, 2, 1, 30]`.
        """
        memory = tuple(each[:, :, 0].movedim(1, 0) for each in memories)
        forecast = self._forecast(s[0], p, memory, s[0, self._z], 0.0)
        x, predicted = forecast.looked_back(s, u, memory)
        settings = IterativeLearningSettings()

        # As a `ResidualModel` has it, of those that were tried
        both = tried[:, None] * tried
        noise = settings.noise * torch.eye(len(x))
        inverse = both * _inverse(both * _kernel(x, x) + noise)
        residuals = tried[:, None] * (z - predicted).flatten(1)
        squares = residuals.square().mean(1).sum()
        assumed = settings.prior_count * settings.prior_error**2
        variance = (assumed + squares) / (settings.prior_count + tried.sum())
        return x, inverse, inverse @ residuals, variance

    def distance(self, s: Tensor, u: Tensor, *given: Tensor) -> Tensor:
        """Distance that iterative learning expects of plans `[B, T, D_u]`, `[B]`.

        What is given after them: p, h, c and z_ref as in `predict`, the caution, and
        what attempts taught, the parts of `_Learned`.
        """
        p, h, c, z_ref, caution, *learned = given
        forecast = self._forecast(s, p, Memory(h, c), z_ref, caution)
        residuals = _Learned(*learned)

        def in_steps(x: Tensor) -> tuple[Tensor, Tensor]:
            mean, variance = residuals(x)
            return mean.unflatten(1, (self._settings.period, -1)), variance

        forecast.residuals = in_steps
        return forecast.distance(u)

    def improve(self, s: Tensor, u: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """Such plans after one iteration of a descent, and their distances.

        After what `distance` is given come the limits.
        """
        *around, lower, upper = given
        limits = Limits(lower, upper, self._model.u_std * (upper > lower))

        def loss(plans: Tensor) -> Tensor:
            return self.distance(s, plans, *around)

        return _descended(loss, u, limits, self._settings)

    def _forecast(
        self,
        s: Tensor,
        p: Tensor,
        memory: Memory,
        z_ref: Tensor,
        caution: float | Tensor,
    ) -> _Forecast:
        """What iterative learning expects.

        Args:
            s: state to start from, `[D_s]`.
            p: parametric bias, `[D_p]`.
            memory: recurrent state before.
            z_ref: the target, `[D_z]`.
            caution: weight of the variance.
        """
        rollout = self._rollout(self._model, p)
        problem = replace(self._problem, s=s, memory=memory, rollout=rollout)
        return _Forecast(problem, z_ref, IterativeLearningSettings(), caution)


def _inverse(matrix: Tensor) -> Tensor:
    """Of a symmetric and positive definite matrix `[N, N]`, by elimination.

    ONNX has no inverse.
    """
    count = len(matrix)
    unit = torch.eye(count, dtype=torch.float64)
    rows = torch.cat([matrix.double(), unit], dim=1)
    for k in range(count):
        row = rows[k] / rows[k, k]
        rows = rows - torch.outer(rows[:, k] - unit[k], row)
    return rows[:, count:].to(matrix.dtype)


def export(trained: ClothCheckpoint, calibrated: Calibrated) -> dict[str, bytes]:
    """The graphs of an arm by name, and their weights."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        writer = _Writer(trained, made)
        writer.write_images()
        writer.write_memory()
        writer.write_estimation(calibrated)
        writer.write_control()
        writer.write_iterative_learning()
        written = {path.name: path.read_bytes() for path in sorted(made.iterdir())}
    return _sharing(written)


class _Writer:
    """Writes the graphs of an arm, each with an example of what goes in.

    Args:
        trained: the weights.
        folder: where to.
    """

    def __init__(self, trained: ClothCheckpoint, folder: Path):
        self._trained = trained
        self._method = _Method(trained)
        self._folder = folder

        # A step, with a memory before it
        model = trained.model
        step = {"s": model.s_mean, "u": model.u_mean, "p": torch.zeros(model.bias_size)}
        self._step: dict[str, Tensor] = step | _named(model.initial_memory())

        # What is wanted, with a plan, and between which limits
        self._z = torch.ones(trained.autoencoder.latent_size)
        self._plan = model.u_mean.repeat(ControlSettings.horizon, 1)
        self._limits = {"lower": model.u_mean - 1, "upper": model.u_mean + 1}

    def write_images(self) -> None:
        """What the camera sees, and what is aimed at."""
        images = Images(self._trained.autoencoder)
        samples = torch.zeros(HEIGHT, WIDTH, len(SAMPLES))
        picture = {"green": samples, "blue": samples}
        self._write(images.see, picture, "mask", "z", "reconstruction")
        image = torch.ones(HEIGHT, WIDTH)
        given = {"image": image, "images": image.repeat(2, 1, 1)}
        outputs = ("known", "z", "reconstruction", "distance", "overlap")
        self._write(images.aim, given, *outputs, free={"images": [0]})

    def write_memory(self) -> None:
        """The memory of what was sent."""
        self._write(self._method.follow, self._step, "next_h", "next_c")

    def write_estimation(self, calibrated: Calibrated) -> None:
        """How p follows a window, of any length."""
        model = self._trained.model

        def estimate(
            s: Tensor, u: Tensor, p: Tensor, judged: Tensor, *known: Any
        ) -> Any:
            return lab_estimation.estimate(model, s, u, p, judged, Calibrated(*known))

        window = {
            "s": model.s_mean.repeat(_WINDOW + 1, 1),
            "u": model.u_mean.repeat(_WINDOW + 1, 1),
            "p": self._step["p"],
            "judged": torch.ones(_WINDOW),
        }
        free = {"s": [0], "u": [0], "judged": [0]}
        given = window | calibrated._asdict()
        self._write(estimate, given, *lab_estimation.OUTPUTS, free=free)

    def write_control(self) -> None:
        """The paper's control."""
        given = self._step | {"z_ref": self._z, "mask": torch.ones(len(self._plan))}
        some = given | self._plans(2)
        free = {"u": [0]}
        self._write(self._method.predict, some, "losses", "distances", free=free)
        one = given | {"u": self._plan} | self._limits
        self._write(self._method.descend, one, "plan", "losses", gradients=True)

    def write_iterative_learning(self) -> None:
        """Its graphs take as many plans as there may be, or fewer."""
        learning = IterativeLearningSettings()
        given = self._step | {"z_ref": self._z, "caution": torch.ones(())}
        given |= _taught(self._trained)
        judged = self._plans(learning.remembered + learning.recorded + 1)
        self._write(self._method.distance, given | judged, "losses")
        starts = given | self._plans(learning.starts) | self._limits
        self._write(self._method.improve, starts, "plans", "losses", gradients=True)

        # What was tried, each with its state and memory
        count = learning.remembered
        given = {
            name: each.expand(count, *each.shape).clone()
            for name, each in self._step.items()
        }
        given |= self._plans(count) | {"p": self._step["p"]}
        horizon = ControlSettings.horizon
        seen = {"z": self._z.repeat(count, horizon, 1), "tried": torch.ones(count)}
        order = ("s", "u", "z", "tried", "p", "h", "c")
        given = {name: (given | seen)[name] for name in order}
        self._write(self._method.teach, given, *_Learned._fields)

    def _plans(self, count: int) -> dict[str, Tensor]:
        return {"u": self._plan.repeat(count, 1, 1)}

    def _write(self, function: Any, inputs: Any, *outputs: str, **more: Any) -> None:
        path = self._folder / function.__name__
        with torch.set_grad_enabled("gradients" in more):
            export_onnx(path, function, inputs, outputs, **more)


def _taught(trained: ClothCheckpoint) -> dict[str, Tensor]:
    """An example of what attempts taught: nothing."""
    count = IterativeLearningSettings.remembered
    horizon = ControlSettings.horizon
    sizes = {
        "x": (count, _features(trained)),
        "inverse": (count, count),
        "weights": (count, horizon * trained.autoencoder.latent_size),
        "variance": (),
    }
    return {name: torch.zeros(size) for name, size in sizes.items()}


def _features(trained: ClothCheckpoint) -> int:
    """How many numbers say what a plan is like to iterative learning."""
    model = trained.model
    return ControlSettings.horizon * model.command_size + model.state_size


def _sharing(written: Mapping[str, bytes]) -> dict[str, bytes]:
    """The graphs without their large tensors, which lie in one file for all of them."""
    weights = bytearray()
    places: dict[bytes, int] = {}
    files = {}
    for name, graph in written.items():
        model = onnx.load_from_string(graph)
        for tensor in model.graph.initializer:
            content = tensor.raw_data
            if len(content) < _LARGE:
                continue
            if content not in places:
                places[content] = len(weights)
                weights += content
            set_external_data(tensor, _WEIGHTS, places[content], len(content))
            tensor.ClearField("raw_data")
        files[name] = model.SerializeToString()
    return files | {_WEIGHTS: bytes(weights)}
