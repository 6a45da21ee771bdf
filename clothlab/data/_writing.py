"""What the repository's own programs write into `data/`, for `load` to find."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._files import write_bytes
from clothlab._store import Folder, data_folder, record_again
from clothlab._validation import check_mask, check_name
from clothlab.method.autoencoder import Autoencoder
from clothlab.weights import (
    SUFFIX,
    Checkpoint,
    ClothCheckpoint,
    prefixed,
    write_tensors,
)


def save(trained: Checkpoint, *, data: Folder = None) -> None:
    """Write what `load(NAME)` finds, as `data/weights/model-NAME.safetensors`.

    `trained.save(path)` writes one file. Here the autoencoder goes into a file of its
    own, unless one of this name lies there already: it is ten times as large as a
    model, and five trainings share one.
    """
    if isinstance(trained, ClothCheckpoint):
        name = trained.autoencoder_name
        if not _path("autoencoder", name, data).is_file():
            save_autoencoder(trained.autoencoder, [], name, data=data)
    about, tensors = trained.contents(whole=False)
    _write("model", trained.name, about, tensors, data)


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
    tensors = prefixed("autoencoder.", autoencoder)
    tensors["losses"] = torch.as_tensor(np.asarray(losses, np.float32))
    about = {"latent_size": autoencoder.latent_size}
    _write("autoencoder", name, about, tensors, data)


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


def _write(
    kind: str,
    name: str,
    about: Mapping[str, Any],
    tensors: Mapping[str, Tensor],
    data: Folder,
) -> None:
    """Write a file of weights into `data/`, and give it its hash."""
    path = _path(kind, name, data)
    write_tensors(path, about, tensors)
    record_again(path, data_folder(data))


def _path(kind: str, name: str, data: Folder) -> Path:
    file = f"{kind}-{check_name('training', name)}{SUFFIX}"
    return data_folder(data) / "weights" / file
