"""What is left of a training, in one file that can lie anywhere.

A model alone is of little use: p means nothing without the names of the materials, a
prediction nothing without the units of its states, a latent image nothing without the
autoencoder that made it. So all of that travels together, in safetensors' format:
reading a file runs no code that came with it.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import safetensors
import safetensors.torch
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._files import reading, write_bytes
from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings, IterativePolicy
from clothlab.method.model import DPMPB, usual_torch
from clothlab.method.training import ModelTraining
from clothlab.simulation.arm import Arm, StateLayout, arm_data, arm_from_data
from clothlab.trials import Trial, to_run

SUFFIX = ".safetensors"
_FORMAT = 2


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Checkpoint:
    """A trained model of any robot, and what one has to know to use it."""

    model: DPMPB  # it knows its step, and the names of its states and commands
    biases: dict[str, np.ndarray]  # trained p of each material, {name: [D_p]}
    name: str = ""  # of the training, such as torque-0
    # Mean squared error of each epoch of the training, [epochs]
    losses: np.ndarray = field(default_factory=lambda: np.zeros(0))
    settings: ModelTraining | None = None  # of the training, where they are known

    def __repr__(self) -> str:
        """Return one line: its name, the sizes, and how many materials have a p."""
        name = f" {self.name}" if self.name else ""
        kind = type(self).__name__
        return f"{kind}{name} of {self.model!r}, {len(self.biases)} materials"

    def save(self, path: str | Path, *, whole: bool = True) -> None:
        """Write one file; its name ends in `.safetensors`.

        If not `whole`, an autoencoder is only named: it lies in a file of its own.
        """
        about, tensors = self.contents(whole=whole)
        write_tensors(path, about, tensors)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read such a file; the networks are in evaluation mode, and are not trained.

        A ValueError names a file that is damaged, or that holds something else.
        """
        about, tensors = read_tensors(path)
        with reading(path, "checkpoint"):
            return cls.from_contents(about, tensors)

    @classmethod
    def from_contents(
        cls, about: Mapping[str, Any], tensors: Mapping[str, Tensor]
    ) -> Self:
        """Of what a file says in words, and what it holds in numbers."""
        return cls(**cls._fields(about, tensors))

    def contents(
        self, *, whole: bool = True
    ) -> tuple[dict[str, Any], dict[str, Tensor]]:
        """What a file says in words, and what it holds in numbers."""
        model = self.model
        about = {
            "name": self.name,
            "sizes": [model.state_size, model.command_size, model.bias_size],
            "materials": list(self.biases),
            "settings": None if self.settings is None else asdict(self.settings),
            "step": model.step,
            "state_names": list(model.state_names),
            "command_names": list(model.command_names),
        }
        p = np.array(list(self.biases.values()), np.float32)
        tensors = {
            "p": torch.as_tensor(p.reshape(len(self.biases), model.bias_size)),
            "losses": torch.as_tensor(np.asarray(self.losses, np.float32)),
        }
        return about, tensors | prefixed("model.", model)

    @classmethod
    def _fields(
        cls, about: Mapping[str, Any], tensors: Mapping[str, Tensor]
    ) -> dict[str, Any]:
        """The fields of which a file's words and numbers speak."""
        sizes = about["sizes"]
        model = filled(lambda: DPMPB(*sizes), tensors, "model.")
        model.step = about["step"]
        model.state_names = tuple(about["state_names"])
        model.command_names = tuple(about["command_names"])
        biases = zip(about["materials"], tensors["p"].numpy(), strict=True)
        settings = about["settings"]
        return {
            "model": model,
            "biases": dict(biases),
            "name": about["name"],
            "losses": tensors["losses"].double().numpy(),
            "settings": None if settings is None else ModelTraining(**settings),
        }


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ClothCheckpoint(Checkpoint):
    """A model and p of each cloth, with the arm and the eye: the autoencoder."""

    arm: Arm
    autoencoder: Autoencoder
    autoencoder_name: str = ""  # several models may share one

    @property
    def layout(self) -> StateLayout:
        """Where things lie in the state `s`."""
        return self.arm.layout(self.autoencoder.latent_size)

    def to_run(self, trial: Trial) -> Run:
        """States and commands of a recorded trial, as the model sees them.

        A ValueError for a trial of an arm with other sensors or commands.
        """
        ours = (self.arm.state_names, self.arm.command_names)
        if (trial.arm.state_names, trial.arm.command_names) != ours:
            raise ValueError(
                f"this trial is of the {trial.arm.name} arm, these weights are of the "
                f"{self.arm.name} arm: load weights of the same arm"
            )
        return to_run(self.autoencoder, trial)

    def controller(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        settings: ControlSettings = ControlSettings(),
        plans: ArrayLike | None = None,
        *,
        arm: Arm | None = None,
    ) -> ControlPolicy:
        """The paper's controller with this model.

        Args:
            target: mask `[H, W]` to realise once a period.
            p: parametric bias `[D_p]`, or the name of a trained material.
            settings: the constants of the control.
            plans: recorded ones from which a period may start, `[N, horizon, D_u]`.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        bias = choose("material", p, self.biases) if isinstance(p, str) else p
        arm = arm or self.arm
        return ControlPolicy(
            self.model, self.autoencoder, arm, target, bias, settings, plans=plans
        )

    def iterative_controller(
        self,
        target: ArrayLike,
        p: ArrayLike | str,
        runs: Sequence[Run],
        learning: IterativeLearningSettings = IterativeLearningSettings(),
        *,
        arm: Arm | None = None,
    ) -> IterativePolicy:
        """Iterative learning control with this model.

        Args:
            target: mask `[H, W]` to realise once a period.
            p: parametric bias `[D_p]`, or the name of a trained material.
            runs: recordings to begin with, as `to_run` gives them.
            learning: how much is tried, and how far an outcome teaches.
            arm: one with other limits, such as `arm.with_stiffness(10)`.
        """
        bias = choose("material", p, self.biases) if isinstance(p, str) else p
        return IterativePolicy(
            self.model,
            self.autoencoder,
            arm or self.arm,
            target,
            bias,
            runs,
            learning,
            biases=self.biases,
        )

    def contents(
        self, *, whole: bool = True
    ) -> tuple[dict[str, Any], dict[str, Tensor]]:
        about, tensors = super().contents()
        about |= {
            "arm": arm_data(self.arm),
            "latent_size": self.autoencoder.latent_size,
            "autoencoder_name": self.autoencoder_name,
            "autoencoder": fingerprint(self.autoencoder),
        }
        if whole:
            tensors |= prefixed("autoencoder.", self.autoencoder)
        return about, tensors

    @classmethod
    def _fields(
        cls, about: Mapping[str, Any], tensors: Mapping[str, Tensor]
    ) -> dict[str, Any]:
        return super()._fields(about, tensors) | {
            "arm": arm_from_data(about["arm"]),
            "autoencoder": _autoencoder(about, tensors),
            "autoencoder_name": about["autoencoder_name"],
        }


def save_autoencoder(
    autoencoder: Autoencoder, losses: ArrayLike, path: str | Path
) -> None:
    """Write an autoencoder and its losses of each epoch, `[epochs]` [nat per pixel]."""
    tensors = prefixed("autoencoder.", autoencoder)
    tensors["losses"] = torch.as_tensor(np.asarray(losses, np.float32))
    write_tensors(path, {"latent_size": autoencoder.latent_size}, tensors)


def load_autoencoder(path: str | Path) -> tuple[Autoencoder, np.ndarray]:
    """Read an autoencoder, in evaluation mode, and its losses `[epochs]`."""
    about, tensors = read_tensors(path)
    with reading(path, "autoencoder"):
        return _autoencoder(about, tensors), tensors["losses"].double().numpy()


def _autoencoder(
    about: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> Autoencoder:
    size = about["latent_size"]
    return filled(lambda: Autoencoder(size), tensors, "autoencoder.")


def fingerprint(autoencoder: Autoencoder) -> str:
    """Hash of its weights; a model's file names the one it was trained with by it."""
    digest = hashlib.sha256()
    for name, tensor in autoencoder.state_dict().items():
        digest.update(name.encode())
        digest.update(tensor.numpy().tobytes())
    return digest.hexdigest()[:16]


def write_tensors(
    path: str | Path, about: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> None:
    """Write tensors, and what is said of them, into one file.

    A ValueError for a name without the ending `.safetensors`, and for numbers of a
    training that diverged.
    """
    _check_suffix(path)
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise ValueError(f"numbers of {name} are not finite: they are not saved")
    text = json.dumps({"format": _FORMAT, **about}, allow_nan=False)
    whole = {name: tensor.contiguous() for name, tensor in tensors.items()}
    content = safetensors.torch.save(whole, metadata={"clothlab": text})
    write_bytes(path, content)


@usual_torch()
def read_tensors(path: str | Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """What a file says, and its tensors; a ValueError names one that is damaged."""
    _check_suffix(path)
    with reading(path, "weights"):
        with safetensors.safe_open(path, "pt") as file:
            about = json.loads((file.metadata() or {})["clothlab"])
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
        if about["format"] != _FORMAT:
            raise ValueError(f"its format is {about['format']}, not {_FORMAT}")
    return about, tensors


@usual_torch()
def filled(
    make: Callable[[], nn.Module], tensors: Mapping[str, Tensor], prefix: str
) -> Any:
    """A network with the weights whose names begin with a prefix, to be used.

    It is made without numbers of its own: a file may speak of a network that fits into
    no memory, and is refused once its tensors turn out to be smaller.
    """
    with torch.device("meta"):
        network = make()
    own = {
        name.removeprefix(prefix): tensor.clone()
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
    network.load_state_dict(own, assign=True)
    return network.float().eval().requires_grad_(False)


def prefixed(prefix: str, network: nn.Module) -> dict[str, Tensor]:
    """The weights of a network, their names after a prefix."""
    return {prefix + name: value for name, value in network.state_dict().items()}


def _check_suffix(path: str | Path) -> None:
    if Path(path).suffix != SUFFIX:
        raise ValueError(f"a file of weights ends in {SUFFIX}, got {str(path)!r}")
