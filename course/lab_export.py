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
from clothlab.method._memories import AnyMemory
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
from clothlab.method.onnx_export import _named, export_estimation, export_onnx
from course.repository import ROOT

LAB = ROOT / "build" / "lab"
# What graphs are made of, beside the weights
_MADE_OF = ("clothlab/method/*.py", "course/lab_export.py")
_SUMS = ROOT / "data" / "SHA256SUMS"
_WEIGHTS = "weights"  # what the graphs of an arm have in common
_LARGE = 1024  # [byte] from which on a tensor lies there


def graphs(trained: ClothCheckpoint) -> dict[str, bytes]:
    """The graphs of an arm and their weights by name.

    Out of `build/lab`, where they are made anew only if they are old.
    """
    folder = LAB / trained.arm.name
    stamp = folder / "made_of"
    digest = _digest()
    if not stamp.is_file() or stamp.read_text() != digest:
        shutil.rmtree(folder, ignore_errors=True)
        for name, content in export(trained).items():
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
        self._autoencoder = trained.autoencoder
        self._model = trained.model
        self._rollout = rollout_of(trained.model)
        self._tensions = trained.layout.tensions
        self._z = trained.layout.z
        self._settings = ControlSettings()
        # Any one: what changes in it is put in its place
        nothing = np.ones((HEIGHT, WIDTH))
        policy = trained.controller(nothing, np.zeros(trained.model.bias_size))
        self._problem = policy.controller.problem(trained.model.s_mean)

    def encode(self, image: Tensor) -> Tensor:
        """Of a mask `[H, W]`, z `[D_z]`."""
        return self._autoencoder.encoder(image[None, None])[0]

    def decode(self, z: Tensor) -> Tensor:
        """Of z `[D_z]`, the probability of cloth at each pixel `[H, W]`."""
        return self._autoencoder.decoder(z[None]).sigmoid()[0, 0]

    def follow(self, s: Tensor, u: Tensor, p: Tensor, *memory: Tensor) -> AnyMemory:
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
        """States `[B, T, D_s]` to which plans lead, and the losses of these, `[B]`.

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
        return states, control_loss(states, z_ref, mask, self._tensions, weight)

    def descend(self, s: Tensor, u: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """A plan u `[T, D_u]` after one iteration, and its loss before and after.

        After what `predict` is given come the limits, `lower` and `upper` `[D_u]`,
        since an arm's tension may be fixed.
        """
        *around, lower, upper = given
        limits = Limits(lower, upper, self._model.u_std * (upper > lower))

        def loss(plans: Tensor) -> Tensor:
            _, losses = self.predict(s, plans, *around)
            return losses

        return descend(loss, u, limits, replace(self._settings, iterations=1))

    def look_back(
        self, s: Tensor, u: Tensor, p: Tensor, *memories: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """What N attempts were like, what was predicted of them, and their kernel.

        States are `[N, D_s]`, plans `[N, T, D_u]`, memories `[N, 2, 1, 30]`.
        """
        memory = tuple(each[:, :, 0].movedim(1, 0) for each in memories)
        forecast = self._forecast(s[0], p, memory, s[0, self._z], 0.0)
        x, predicted = forecast.looked_back(s, u, memory)
        return x, predicted, _kernel(x, x)

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
        memory: AnyMemory,
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


def export(trained: ClothCheckpoint) -> dict[str, bytes]:
    """The graphs of an arm by name, and their weights."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        writer = _Writer(trained, made)
        writer.write_what_was_seen()
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

    def write_what_was_seen(self) -> None:
        """Images, the memory of steps, and how p predicts them."""
        image = {"image": torch.zeros(HEIGHT, WIDTH)}
        self._write(self._method.encode, image, "z")
        self._write(self._method.decode, {"z": self._z}, "image")
        self._write(self._method.follow, self._step, "next_h", "next_c")
        export_estimation(self._folder / "linearise", self._trained.model)

    def write_control(self) -> None:
        """The paper's control."""
        given = self._step | {"z_ref": self._z, "mask": torch.ones(len(self._plan))}
        some = given | self._plans(2)
        free = {"u": [0]}
        self._write(self._method.predict, some, "states", "losses", free=free)
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
        tried = {
            name: each.expand(count, *each.shape).clone()
            for name, each in self._step.items()
        }
        tried |= self._plans(count) | {"p": self._step["p"]}
        self._write(self._method.look_back, tried, "x", "predicted", "kernel")

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
