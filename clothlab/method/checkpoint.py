"""What is left of a training, in one file that can lie anywhere.

A model alone is of little use: p means nothing without the names of the materials, a
prediction nothing without the units of its states, a latent image nothing without the
autoencoder that made it. So all of that travels together.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from clothlab import __version__
from clothlab._files import OtherKindError, reading, write_bytes
from clothlab._validation import check_array, check_kind, check_names, check_number
from clothlab.method._model_card import model_card, with_own_words
from clothlab.method._quick_tanh import quicken
from clothlab.method._weights import (
    above,
    below,
    check_free,
    check_layers,
    check_suffix,
    filled,
    named_biases,
    packed,
    unpacked,
)
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.deploy import Ranges
from clothlab.method.model import DPMPB, PredictiveModel
from clothlab.method.training import ModelTraining

_KIND = "checkpoint"


@dataclass(frozen=True, eq=False, kw_only=True)
class Checkpoint:
    """A trained model of any robot, and what one has to know to use it.

    `save` writes it into one file, `load` reads it back, on any machine.
    """

    name: str  # of the training, such as torque-0
    model: PredictiveModel
    biases: dict[str, np.ndarray]  # trained p of each material, {name: [D_p]}
    # Mean squared error of each epoch of the training, [epochs]
    losses: np.ndarray = field(default_factory=lambda: np.zeros(0))
    settings: ModelTraining | None = None  # of the training, where they are known
    step: float | None = None  # control step [s], where it is known
    state_names: tuple[str, ...] = ()  # what each number of s is, with its unit
    command_names: tuple[str, ...] = ()  # what each number of u is, with its unit
    autoencoder: Autoencoder | None = None  # of what its camera sees, if it has one
    autoencoder_name: str = ""  # several models may share one
    arm: Any = None  # of the robot itself: anything that JSON can hold
    ranges: Ranges | None = None  # of the training data, `Ranges.of(runs)`
    steps: dict[str, int] = field(default_factory=dict)  # recorded of each material
    # Of clothlab, by which it was made; older files do not say it.
    version: str = __version__

    def __post_init__(self) -> None:
        check_kind("name", self.name, str)
        model = check_kind("model", self.model, PredictiveModel)
        if np.ndim(self.losses) != 1:
            raise ValueError(f"losses are [epochs], got {np.shape(self.losses)}")

        # Each p fits the model, and so do the names.
        for material, p in self.biases.items():
            check_array(f"p of {material}", p, (model.bias_size,))
        check_names("states of the model", self.state_names, model.state_size)
        check_names("commands of the model", self.command_names, model.command_size)

        if self.settings is not None:
            check_kind("settings", self.settings, ModelTraining)
        if self.step is None:
            # A model that was trained on runs with a step remembers it.
            object.__setattr__(self, "step", getattr(model, "step", None))
        if self.step is not None:
            check_number("step", self.step, above=0)

        # What it was trained on has as many numbers, and is counted by known names.
        if self.ranges is not None:
            ranges = check_kind("ranges", self.ranges, Ranges)
            check_array("the range of s", ranges.s, (2, model.state_size))
            check_array("the range of u", ranges.u, (2, model.command_size))
        for material, count in self.steps.items():
            check_number(f"steps of {material}", count, int, at_least=0)

    def card(self) -> str:
        """What somebody who is given the file has to know, as a page of Markdown."""
        return model_card(self)

    def save(
        self, path: str | Path, *, overwrite: bool = False, card: bool = False
    ) -> None:
        """Write one file, whole or not at all; its name ends in `.safetensors`.

        With `card`, its model card lies beside it and ends in `.md`; what people wrote
        below the card's last line stays. A ValueError, before anything is written, if
        another checkpoint or another page lies there (unless `overwrite` is set), if a
        number is not finite, or if the model has layers that its class would not make
        again from its three sizes.
        """
        path = Path(path)
        check_suffix(path)
        about = self._about()
        check_layers(self.model, lambda: type(self.model)(*about["sizes"]))
        content = packed(_KIND, about, self._tensors())
        check_free(path, content, overwrite=overwrite)
        page = path.with_suffix(".md")
        text = with_own_words(self.card(), page, overwrite=overwrite) if card else ""
        write_bytes(path, content)
        if card:
            write_bytes(page, text.encode())

    @classmethod
    def load(
        cls, path: str | Path, *, network: Callable[[int, int, int], Any] = DPMPB
    ) -> Self:
        """Read such a file; the networks are in evaluation mode, and are not trained.

        A network of your own comes back through its class, `network=MyNetwork`, which
        makes it of D_s, D_u and D_p: a file of weights brings no code. A ValueError
        names a file that is damaged, of another kind, of another network, or of a newer
        version; a file that is not there is a FileNotFoundError.
        """
        path = Path(path)
        check_suffix(path)
        about, tensors = unpacked(path, _KIND, _KIND)
        with reading(path, _KIND):
            return cls(**cls._fields(about, tensors, network))

    def _about(self) -> dict[str, Any]:
        """What the file says in words."""
        # What every file says.
        model = self.model
        about = {
            "name": self.name,
            "sizes": [model.state_size, model.command_size, model.bias_size],
            "materials": list(self.biases),
            "settings": None,
            "step": self.step,
            "state_names": list(self.state_names),
            "command_names": list(self.command_names),
            "latent_size": None,
            "autoencoder_name": self.autoencoder_name,
            "arm": self._arm_to_data(),
        }

        # What older files do not have is only said where there is something to say, so
        # that they stay the same when they are saved again.
        if type(self.model) is not DPMPB:
            about["network"] = type(self.model).__name__
        if self.steps:
            about["steps"] = dict(self.steps)
        if self.version:
            about["version"] = self.version

        # Settings and autoencoder, where there are any.
        if self.settings is not None:
            about["settings"] = asdict(self.settings)
        if self.autoencoder is not None:
            about["latent_size"] = self.autoencoder.latent_size
        return about

    def _tensors(self) -> dict[str, Tensor]:
        """What the file holds in numbers."""
        losses = np.asarray(self.losses, np.float64)
        p = np.array(list(self.biases.values()))
        p = p.reshape(len(self.biases), self.model.bias_size)
        tensors = {"losses": torch.as_tensor(losses), "p": torch.as_tensor(p)}
        if self.ranges is not None:
            tensors["ranges.s"] = torch.as_tensor(self.ranges.s)
            tensors["ranges.u"] = torch.as_tensor(self.ranges.u)

        # A network's name stands before those of its layers.
        tensors |= above("model.", self.model.state_dict())
        if self.autoencoder is not None:
            tensors |= above("autoencoder.", self.autoencoder.state_dict())
        return tensors

    @classmethod
    def _fields(
        cls,
        about: Mapping[str, Any],
        tensors: dict[str, Tensor],
        network: Callable[[int, int, int], Any],
    ) -> dict[str, Any]:
        """The fields of which a file's words and numbers speak."""
        fields = {
            "name": about["name"],
            "biases": named_biases(about["materials"], tensors["p"]),
            "losses": tensors["losses"].numpy(),
            "step": about["step"],
            "state_names": tuple(about["state_names"]),
            "command_names": tuple(about["command_names"]),
            "autoencoder_name": about["autoencoder_name"],
            "arm": cls._arm_from_data(about["arm"]),
            "steps": about.get("steps", {}),
            "version": about.get("version", ""),
        }
        # Ranges may be unknown.
        ranges = below("ranges.", tensors)
        if ranges:
            fields["ranges"] = Ranges(ranges["s"].numpy(), ranges["u"].numpy())

        # The networks are made in their sizes, and filled.
        model = _made(network, about)
        fields["model"] = filled(model, below("model.", tensors))
        fields["model"].step = about["step"]
        if about["latent_size"] is not None:
            autoencoder = Autoencoder(about["latent_size"])
            layers = below("autoencoder.", tensors)
            fields["autoencoder"] = filled(autoencoder, layers)

        # An unknown or illegal setting is refused as at its first writing.
        if about["settings"] is not None:
            fields["settings"] = ModelTraining(**about["settings"])
        return fields

    def _arm_to_data(self) -> Any:
        """What the file says of the arm; who knows arms turns them into data."""
        return self.arm

    @classmethod
    def _arm_from_data(cls, data: Any) -> Any:
        """The arm of which a file says this."""
        return data


def _made(network: Callable[[int, int, int], Any], about: Mapping[str, Any]) -> Any:
    """The network that a file speaks of, by the class that the caller has."""
    wanted = about.get("network", DPMPB.__name__)
    name = getattr(network, "__name__", type(network).__name__)
    if name != wanted:
        raise OtherKindError(
            f"it holds the weights of a {wanted}, and {name} would be filled with them:"
            f" load(..., network={wanted})"
        )
    model = network(*about["sizes"])
    return quicken(model) if type(model) is DPMPB else model
