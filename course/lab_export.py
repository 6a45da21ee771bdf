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
# What graphs are made of; the sums are those of the weights
_MADE_OF = ("clothlab/method/*.py", "course/lab_export.py", "data/SHA256SUMS")
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

    def follow(
        self, s: Tensor, u: Tensor, p: Tensor, h: Tensor, c: Tensor
    ) -> AnyMemory:
        """The memory after a step that was seen."""
        return self._rollout(self._model, p).follow(s, u, Memory(h, c))

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
        self, s: Tensor, u: Tensor, p: Tensor, h: Tensor, c: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """What N attempts were like, what was predicted of them, and their kernel.

        States are `[N, D_s]`, plans `[N, T, D_u]`, memories `[N, 2, 1, 30]`.
        """
        memory = Memory(h[:, :, 0].movedim(1, 0), c[:, :, 0].movedim(1, 0))
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
    method = _Method(trained)
    model = trained.model
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)

        def write(function: Any, inputs: Any, *outputs: str, **more: Any) -> None:
            export_onnx(made / function.__name__, function, inputs, outputs, **more)

        # The images, and the steps that were seen
        step = _step(trained)
        image = {"image": torch.zeros(HEIGHT, WIDTH)}
        z = torch.ones(trained.autoencoder.latent_size)
        with torch.no_grad():
            write(method.encode, image, "z")
            write(method.decode, {"z": z}, "image")
            write(method.follow, step, "next_h", "next_c")
        export_estimation(made / "linearise", model)

        # The paper's control
        plan = model.u_mean.repeat(ControlSettings.horizon, 1)
        around = step | {"z_ref": z, "mask": torch.ones(len(plan))}
        limits = {"lower": model.u_mean - 1, "upper": model.u_mean + 1}
        some = {"u": plan.repeat(2, 1, 1)}
        with torch.no_grad():
            write(method.predict, around | some, "states", "losses", free={"u": [0]})
        inputs = around | {"u": plan} | limits
        write(method.descend, inputs, "plan", "losses", gradients=True)

        # Iterative learning; its graphs take as many plans as there may be, or fewer
        learning = IterativeLearningSettings()
        around = step | {"z_ref": z, "caution": torch.ones(())} | _taught(trained)
        starts = {"u": plan.repeat(learning.starts, 1, 1)}
        tried = {"u": plan.repeat(learning.remembered, 1, 1)}
        judged = {"u": plan.repeat(learning.remembered + learning.recorded + 1, 1, 1)}
        attempts = {
            name: each[None].repeat(learning.remembered, *(1 for _ in each.shape))
            for name, each in step.items()
        }
        attempts |= tried | {"p": step["p"]}
        with torch.no_grad():
            write(method.distance, around | judged, "losses")
            write(method.look_back, attempts, "x", "predicted", "kernel")
        inputs = around | starts | limits
        write(method.improve, inputs, "plans", "losses", gradients=True)
        written = {path.name: path.read_bytes() for path in sorted(made.iterdir())}
    return _sharing(written)


def _step(trained: ClothCheckpoint) -> dict[str, Tensor]:
    """An example of a state, a command, p and a memory."""
    model = trained.model
    p = torch.zeros(model.bias_size)
    memory = _named(model.initial_memory())
    return {"s": model.s_mean, "u": model.u_mean, "p": p, **memory}


def _taught(trained: ClothCheckpoint) -> dict[str, Tensor]:
    """An example of what attempts taught: nothing."""
    count = IterativeLearningSettings.remembered
    horizon = ControlSettings.horizon
    sizes = {
        "x": (count, features(trained)),
        "inverse": (count, count),
        "weights": (count, horizon * trained.autoencoder.latent_size),
        "variance": (),
    }
    return {name: torch.zeros(size) for name, size in sizes.items()}


def features(trained: ClothCheckpoint) -> int:
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
