"""The method of the page, as graphs of what Python computes.

For each arm, functions of tensors become ONNX graphs, with their gradients where they
take some. So the page has no network, loss or gradient of its own.
"""

from collections.abc import Callable, Mapping
from typing import Any

import onnx
import torch
from onnx.external_data_helper import set_external_data
from torch import Tensor

from clothlab import ControlSettings
from clothlab.method.cloth_task import control_loss
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.weights import ClothCheckpoint
from web import estimation
from web.control import improve, limits_of, step_sizes
from web.images import HEIGHT, SAMPLES, WIDTH, Images
from web.learning import Learned, Learning
from web.network import Memory, Network
from web.onnx_graph import graph

_WEIGHTS = "weights"  # what the graphs of an arm have in common
_LARGE = 1024  # [byte] from which on a tensor lies there
_WINDOW = 30  # steps of an example
# Iterative learning improves many plans at once, with few sizes of a step each
_FEW = step_sizes(10**-2.5, ControlSettings.largest_step, 9)


class Method:
    """What the page computes with the weights of an arm, as functions of tensors.

    In all of them, s is a state `[D_s]`, u are plans `[B, T, D_u]`, p is `[D_p]`, h and
    c are the memory before, `[2, 1, 30]`, z_ref is the target `[D_z]`, and lower and
    upper are limits `[D_u]`, since an arm's tension may be fixed. A descent does one
    iteration: unrolled, three would take three times as long to export and to load.

    Args:
        trained: the weights.
    """

    def __init__(self, trained: ClothCheckpoint):
        self.model = trained.model
        self._tensions = trained.layout.tensions
        self._settings = ControlSettings()
        latent = trained.autoencoder.latent_size
        self._learning = Learning(self.model, latent, IterativeLearningSettings())

    def follow(self, s: Tensor, u: Tensor, p: Tensor, h: Tensor, c: Tensor) -> Memory:
        """The memory after a step that was seen, with the command u `[D_u]`."""
        return Network(self.model, p).follow(s, u, (h, c))

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

        The mask `[T]` says which steps count.
        """
        states = Network(self.model, p).predict(s, u, (h, c))
        weight = self._settings.tension_weight
        losses = control_loss(states, z_ref, mask, self._tensions, weight)
        distances = control_loss(states, z_ref, mask, slice(0), 0.0)
        return losses, distances

    def descend(self, s: Tensor, u: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """A plan u `[T, D_u]` after one iteration, and its loss before and after.

        What `predict` is given comes first, then the limits.
        """
        *around, lower, upper = given
        settings = self._settings
        sizes = step_sizes(
            settings.smallest_step, settings.largest_step, settings.candidates
        )

        def loss(plans: Tensor) -> Tensor:
            losses, _ = self.predict(s, plans, *around)
            return losses

        limits = limits_of(lower, upper, self.model.u_std)
        found, before, after = improve(loss, u[None], limits, sizes)
        return found[0], torch.cat([before, after])

    def estimate(self, s: Tensor, u: Tensor, p: Tensor, judged: Tensor) -> Tensor:
        """How p moves by a window of any length: see `estimation.step`."""
        return estimation.step(self.model, s, u, p, judged)

    def teach(
        self, s: Tensor, u: Tensor, z: Tensor, tried: Tensor, *around: Tensor
    ) -> Learned:
        """What attempts teach: see `Learning.teach`.

        After them come p, and the parts of the memories `[N, 2, 1, 30]`.
        """
        p, *memories = around
        h, c = (each[:, :, 0].movedim(1, 0) for each in memories)
        return self._learning.teach(s, u, z, tried, p, (h, c))

    def distance(self, s: Tensor, u: Tensor, *given: Tensor) -> Tensor:
        """Distance that iterative learning expects of plans, `[B]`.

        Given are p, h, c, z_ref, the weight of the variance, and what attempts taught.
        """
        p, h, c, z_ref, caution, *learned = given
        start = (s, p, (h, c))
        return self._learning.distance(u, start, (z_ref, caution), Learned(*learned))

    def improve(self, s: Tensor, u: Tensor, *given: Tensor) -> tuple[Tensor, Tensor]:
        """Such plans after one iteration of a descent, and their distances.

        What `distance` is given comes first, then the limits.
        """
        *around, lower, upper = given

        def loss(plans: Tensor) -> Tensor:
            return self.distance(s, plans, *around)

        limits = limits_of(lower, upper, self.model.u_std)
        found, _, after = improve(loss, u, limits, _FEW)
        return found, after


def graphs(trained: ClothCheckpoint) -> dict[str, bytes]:
    """The graphs of an arm by name, and their weights."""
    written = _of_images(trained)
    method = Method(trained)
    examples = _Examples(trained)
    add = _adding(written)

    # Memory and estimation
    add(method.follow, examples.step, "next_h", "next_c")
    free = {"s": [0], "u": [0], "judged": [0]}
    add(method.estimate, examples.window, "step", free=free)

    # The paper's control
    aim = examples.step | {"z_ref": examples.z, "mask": torch.ones(examples.horizon)}
    some = aim | examples.plans(2)
    add(method.predict, some, "losses", "distances", free={"u": [0]})
    one = aim | {"u": examples.plan} | examples.limits
    add(method.descend, one, "plan", "losses", grad=True)

    # Iterative learning: as many plans as there may be, or fewer
    learning = IterativeLearningSettings()
    add(method.teach, examples.attempts(learning.remembered), *Learned._fields)
    around = examples.step | {"z_ref": examples.z, "caution": torch.ones(())}
    around |= examples.taught(learning.remembered)
    judged = examples.plans(learning.remembered + learning.recorded + 1)
    add(method.distance, around | judged, "losses")
    starts = around | examples.plans(learning.starts) | examples.limits
    add(method.improve, starts, "plans", "losses", grad=True)
    return _sharing(written)


def _of_images(trained: ClothCheckpoint) -> dict[str, bytes]:
    """What the camera sees, and what is aimed at."""
    written: dict[str, bytes] = {}
    add = _adding(written)
    images = Images(trained.autoencoder)
    samples = torch.zeros(HEIGHT, WIDTH, len(SAMPLES))
    picture = {"green": samples, "blue": samples}
    # Nothing is free, but of the autoencoder only the exporter can make a graph
    add(images.see, picture, "mask", "z", "reconstruction", free={})
    image = torch.ones(HEIGHT, WIDTH)
    given = {"image": image, "images": image.repeat(2, 1, 1)}
    outputs = ("known", "z", "reconstruction", "distance", "overlap")
    add(images.aim, given, *outputs, free={"images": [0]})
    return written


def _adding(written: dict[str, bytes]) -> Callable[..., None]:
    """What adds the graph of a function to those that are written, by its name."""

    def add(
        function: Any, inputs: Any, *outputs: str, free: Any = None, grad: bool = False
    ) -> None:
        with torch.set_grad_enabled(grad):
            written[function.__name__] = graph(function, inputs, outputs, free=free)

    return add


class _Examples:
    """Examples of what goes into the graphs of an arm."""

    def __init__(self, trained: ClothCheckpoint):
        model = trained.model
        self._model = model
        self.horizon = ControlSettings.horizon

        # A step, with a memory before it
        h, c = model.initial_memory()
        p = torch.zeros(model.bias_size)
        self.step = {"s": model.s_mean, "u": model.u_mean, "p": p, "h": h, "c": c}

        # What is wanted, with a plan, and between which limits
        self.z = torch.ones(trained.autoencoder.latent_size)
        self.plan = model.u_mean.repeat(self.horizon, 1)
        self.limits = {"lower": model.u_mean - 1, "upper": model.u_mean + 1}

    @property
    def window(self) -> dict[str, Tensor]:
        """Steps that were seen."""
        return {
            "s": self._model.s_mean.repeat(_WINDOW + 1, 1),
            "u": self._model.u_mean.repeat(_WINDOW + 1, 1),
            "p": self.step["p"],
            "judged": torch.ones(_WINDOW),
        }

    def plans(self, count: int) -> dict[str, Tensor]:
        """So many plans."""
        return {"u": self.plan.repeat(count, 1, 1)}

    def attempts(self, count: int) -> dict[str, Tensor]:
        """So many attempts, each with its state and memory."""
        each = {
            name: value.expand(count, *value.shape).clone()
            for name, value in self.step.items()
        }
        seen = {"z": self.z.repeat(count, self.horizon, 1), "tried": torch.ones(count)}
        given = each | seen | self.plans(count) | {"p": self.step["p"]}
        order = ("s", "u", "z", "tried", "p", "h", "c")
        return {name: given[name] for name in order}

    def taught(self, count: int) -> dict[str, Tensor]:
        """What so many attempts taught: nothing."""
        model = self._model
        features = self.horizon * model.command_size + model.state_size
        return {
            "x": torch.zeros(count, features),
            "inverse": torch.zeros(count, count),
            "weights": torch.zeros(count, self.horizon * len(self.z)),
            "variance": torch.zeros(()),
        }


def _sharing(written: Mapping[str, bytes]) -> dict[str, bytes]:
    """The graphs without their large tensors, which lie in one file for all of them."""
    weights = bytearray()
    places: dict[bytes, int] = {}
    files = {}
    for name, content in written.items():
        model = onnx.load_from_string(content)
        for tensor in model.graph.initializer:
            values = tensor.raw_data
            if len(values) < _LARGE:
                continue
            if values not in places:
                places[values] = len(weights)
                weights += values
            set_external_data(tensor, _WEIGHTS, places[values], len(values))
            tensor.ClearField("raw_data")
        files[name] = model.SerializeToString()
    return files | {_WEIGHTS: bytes(weights)}
