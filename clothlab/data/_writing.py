"""What the repository's own programs write into `data/`, for `load` to find."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from clothlab._files import write_bytes
from clothlab._store import Folder, data_folder, record_again
from clothlab._validation import check_mask, check_name
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.data._reading import load_autoencoder
from clothlab.method._weights import SUFFIX, packed
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.checkpoint import Checkpoint
from clothlab.simulation._arm_data import arm_data


def save(trained: ClothCheckpoint, *, data: Folder = None) -> None:
    """Write what `load(NAME)` finds, as `data/weights/dpmpb-NAME.safetensors`.

    `trained.save(path)` writes one file. Here the autoencoder goes into a file of its
    own, `autoencoder-NAME.safetensors`, unless it lies there already: it is ten times
    as large as a model, and five trainings share one.
    """
    fingerprint = trained.autoencoder.fingerprint()
    about = {
        "arm": arm_data(trained.arm),
        "sees_with": trained.autoencoder_name,
        "autoencoder": fingerprint,
        "materials": list(trained.biases),
    }
    numbers = {"losses": trained.losses, "p": list(trained.biases.values())}

    # The model's file is made, and refused, before the autoencoder's is written.
    content = _packed("dpmpb", about, trained.model, numbers)
    if not _is_there(fingerprint, trained.autoencoder_name, data):
        save_autoencoder(trained.autoencoder, [], trained.autoencoder_name, data=data)
    _write_weights("dpmpb", trained.name, content, data)


def _is_there(fingerprint: str, name: str, data: Folder) -> bool:
    """Whether `data/` has the autoencoder of this fingerprint under this name."""
    if not _weights_path("autoencoder", name, data_folder(data)).is_file():
        return False
    autoencoder, _ = load_autoencoder(name, data=data)
    return autoencoder.fingerprint() == fingerprint


def save_model(trained: Checkpoint, *, data: Folder = None) -> None:
    """Write the model of a robot without arm and autoencoder, and its p.

    The file is `data/weights/model-NAME.safetensors`.
    """
    model = trained.model
    about = {
        "sizes": [model.state_size, model.command_size, model.bias_size],
        "materials": list(trained.biases),
    }
    numbers = {"p": list(trained.biases.values())}
    content = _packed("model", about, model, numbers)
    _write_weights("model", trained.name, content, data)


def save_autoencoder(
    autoencoder: Autoencoder, losses: ArrayLike, name: str, *, data: Folder = None
) -> None:
    """Write an autoencoder and its loss curve.

    Args:
        autoencoder: as it was trained.
        losses: of each epoch, `[epochs]` [nat per pixel].
        name: the file is `data/weights/autoencoder-NAME.safetensors`.
        data: folder to write into.
    """
    about = {"latent_size": autoencoder.latent_size}
    content = _packed("autoencoder", about, autoencoder, {"losses": losses})
    _write_weights("autoencoder", name, content, data)


def save_target(mask: ArrayLike, name: str, *, data: Folder = None) -> None:
    """Write a target mask `[H, W]` as `data/targets/NAME.png`.

    That of a set has both names, `SET/NAME`.
    """
    _, content = cv2.imencode(".png", check_mask(mask).astype(np.uint8) * 255)
    *name_of_set, own = name.split("/", 1) if isinstance(name, str) else [name]
    data = data_folder(data)
    folder = data / "targets"
    for each in name_of_set:
        folder = folder / check_name("set", each)
    write_bytes(folder / f"{check_name('target', own)}.png", content.tobytes())


def _packed(
    kind: str, about: dict[str, Any], network: nn.Module, numbers: Mapping[str, Any]
) -> bytes:
    """The content of a file of weights, and of numbers that belong to them."""
    tensors = dict(network.state_dict())
    for name, values in numbers.items():
        tensors[name] = torch.as_tensor(np.array(values), dtype=torch.float32)
    return packed(kind, about, tensors)


def _weights_path(kind: str, name: str, data: Path) -> Path:
    return data / "weights" / f"{kind}-{check_name('training', name)}{SUFFIX}"


def _write_weights(kind: str, name: str, content: bytes, data: Folder) -> None:
    data = data_folder(data)
    path = _weights_path(kind, name, data)
    write_bytes(path, content)
    record_again(path, data)
