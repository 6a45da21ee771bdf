"""The state of a training between two epochs, as a file: it goes on bit for bit.

As in all files of weights there is no pickle in it (`_weights`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR

from clothlab._files import write_bytes
from clothlab.method._weights import packed, unpacked

_KIND = "training"
_TITLE = "state of a training"


@dataclass(frozen=True, eq=False)
class TrainingState:
    """All that the next epoch depends on, and what was noted of those before."""

    tensors: dict[str, Tensor]  # weights, p, Adam's moments, random numbers, notes
    said: dict[str, Any]  # learning rates, and notes in words

    def save(self, path: Path, training: Mapping[str, Any]) -> None:
        """Write it whole, with what says of which training it is."""
        about = {"training": dict(training), **self.said}
        write_bytes(path, packed(_KIND, about, self.tensors))

    @classmethod
    def load(cls, path: Path, training: Mapping[str, Any]) -> "TrainingState":
        """Read it; a ValueError if it is that of another training."""
        said, tensors = unpacked(path, _KIND, _TITLE)
        begun = said["training"]
        for name, value in training.items():
            if begun.get(name) != value:
                raise ValueError(
                    f"{path} is of a training with other {name}: {begun.get(name)}, "
                    f"here {value}; go on with those, or choose another file"
                )
        return cls(tensors, said)


def of_optimiser(optimizer: Adam, schedule: CosineAnnealingLR) -> TrainingState:
    """Adam's moments, and where the learning rates are."""
    state = optimizer.state_dict()
    tensors = {
        f"adam.{number}.{name}": value.detach().cpu().clone()
        for number, moments in state["state"].items()
        for name, value in moments.items()
    }
    rates = [group["lr"] for group in state["param_groups"]]
    return TrainingState(tensors, {"rates": rates, "schedule": schedule.state_dict()})


def set_optimiser(
    optimizer: Adam, schedule: CosineAnnealingLR, state: TrainingState
) -> None:
    """Set both to where they were."""
    whole = optimizer.state_dict()
    for group, rate in zip(whole["param_groups"], state.said["rates"], strict=True):
        group["lr"] = rate
    moments: dict[int, dict[str, Tensor]] = {}
    for name, value in state.tensors.items():
        if name.startswith("adam."):
            _, number, moment = name.split(".")
            moments.setdefault(int(number), {})[moment] = value
    optimizer.load_state_dict(whole | {"state": moments})
    schedule.load_state_dict(state.said["schedule"])


def random_numbers(device: torch.device) -> dict[str, Tensor]:
    """Where torch's random numbers are, on the processor and on this device."""
    found = {"random.cpu": torch.get_rng_state()}
    if device.type == "cuda":
        found["random.cuda"] = torch.cuda.get_rng_state(device)
    return found


def set_random_numbers(device: torch.device, tensors: Mapping[str, Tensor]) -> None:
    """Let them go on from there."""
    torch.set_rng_state(tensors["random.cpu"])
    if device.type == "cuda" and "random.cuda" in tensors:
        torch.cuda.set_rng_state(tensors["random.cuda"], device)
