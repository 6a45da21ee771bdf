"""What is left of a training, in one file that can lie anywhere.

A model alone is of little use: p means nothing without the names of the materials, a
prediction nothing without the units of its states, a latent image nothing without the
autoencoder that made it. So all of that travels together.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from clothlab._files import reading, write_bytes
from clothlab._validation import check_array, check_kind, check_names, check_number
from clothlab.method._quick_tanh import quicken
from clothlab.method._weights import (
    above,
    below,
    check_suffix,
    filled,
    named_biases,
    packed,
    unpacked,
)
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining

_KIND = "checkpoint"


@dataclass(frozen=True, eq=False, kw_only=True)
class Checkpoint:
    """A trained model of any robot, and what one has to know to use it.

    `save` writes it into one file, `load` reads it back, on any machine.
    """

    name: str  # of the training, such as torque-0
    model: DPMPB
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

    def __post_init__(self) -> None:
        check_kind("name", self.name, str)
        model = check_kind("model", self.model, DPMPB)
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

    def save(self, path: str | Path) -> None:
        """Write one file, whole or not at all; its name ends in `.safetensors`.

        A ValueError, before anything is written, if a number is not finite.
        """
        path = Path(path)
        check_suffix(path)
        write_bytes(path, packed(_KIND, self._about(), self._tensors()))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read such a file; the networks are in evaluation mode, and are not trained.

        A ValueError names a file that is damaged, of another kind, or of a newer
        version; a file that is not there is a FileNotFoundError.
        """
        path = Path(path)
        check_suffix(path)
        about, tensors = unpacked(path, _KIND, _KIND)
        with reading(path, _KIND):
            return cls(**cls._fields(about, tensors))

    def _about(self) -> dict[str, Any]:
        """What the file says in words."""
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

        # A network's name stands before those of its layers.
        tensors |= above("model.", self.model.state_dict())
        if self.autoencoder is not None:
            tensors |= above("autoencoder.", self.autoencoder.state_dict())
        return tensors

    @classmethod
    def _fields(
        cls, about: Mapping[str, Any], tensors: dict[str, Tensor]
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
        }

        # The networks are made in their sizes, and filled.
        model = quicken(DPMPB(*about["sizes"]))
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
