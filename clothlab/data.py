"""What lies in `data/`: trials, weights, targets and results, by their names.

`load("torque-0")` gives all that belongs together. Each file is checked against its
hash before it is read, and fetched before that where the package has no clone. The
argument `data` of these functions is the folder to use instead of the one that
`data_folder` finds. An unknown name is a KeyError that lists the choices; a file that
is missing, damaged or altered is a ValueError that names it, and what brings it back.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._files import reading
from clothlab._store import (
    CHECKSUMS,
    OWN_TRIALS,
    Folder,
    check_data,
    check_own,
    checked,
    data_folder,
    find,
    listed,
    record_again,
    sets,
    write,
    write_checksums,
)
from clothlab._validation import check_mask, check_name, choose
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method._quick_tanh import quicken
from clothlab.method._weights import (
    SUFFIX,
    check_free,
    filled,
    named_biases,
    packed,
    unpacked,
)
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.checkpoint import Checkpoint
from clothlab.method.model import DPMPB
from clothlab.simulation._arm_data import arm_data, arm_from_data
from clothlab.simulation._mask_files import mask_from_file
from clothlab.trials import Trial, load_trial

__all__ = [
    "CHECKSUMS",
    "OWN_TRIALS",
    "Folder",
    "check_data",
    "data_folder",
    "load",
    "load_autoencoder",
    "load_model",
    "load_target",
    "load_targets",
    "load_trials",
    "own_trials",
    "save",
    "save_autoencoder",
    "save_model",
    "save_target",
    "write_checksums",
]


def own_trials(data: Folder = None) -> Path:
    """Where a user's recordings are.

    It is the folder that `CLOTHLAB_RECORDINGS` names, or `trials/mine` of the data.
    """
    named = os.environ.get("CLOTHLAB_RECORDINGS")
    if named and data is None:
        return Path(named).expanduser()
    return data_folder(data) / OWN_TRIALS


def load(name: str | Path = "torque-0", *, data: Folder = None) -> ClothCheckpoint:
    """Load arm, autoencoder, model and p of each cloth together.

    Either by name from `data/`, where `torque-0` to `torque-4` differ in their seed, or
    by the path of a file that `ClothCheckpoint.save` wrote, which ends in
    `.safetensors`.
    """
    if isinstance(name, Path) or str(name).endswith(SUFFIX):
        return ClothCheckpoint.load(name)

    # What the model's file says of what belongs to it.
    path, about, tensors = _load_weights("dpmpb", name, data)
    with reading(path, "dpmpb weights"):
        arm = arm_from_data(about["arm"])
        autoencoder_name = about["sees_with"]
        fingerprint = about["autoencoder"]

    # A model is nothing without the autoencoder whose z it was trained on.
    autoencoder, _ = load_autoencoder(autoencoder_name, data=data)
    if autoencoder.fingerprint() != fingerprint:
        raise ValueError(
            f"the weights {name!r} were trained with another autoencoder than the"
            f" {autoencoder_name!r} that lies here: train them again with `make train`,"
            " or restore the files with `git checkout data/weights`"
        )

    # What is left in the file are the layers.
    with reading(path, "dpmpb weights"):
        losses = tensors.pop("losses").double().numpy()
        p = tensors.pop("p")
        state_size = arm.layout(autoencoder.latent_size).size
        model = quicken(DPMPB(state_size, len(arm.command_names), p.shape[1]))
        return ClothCheckpoint(
            name=name,
            arm=arm,
            autoencoder=autoencoder,
            model=filled(model, tensors),
            biases=named_biases(about["materials"], p),
            losses=losses,
            autoencoder_name=autoencoder_name,
        )


def save(
    trained: ClothCheckpoint, *, data: Folder = None, overwrite: bool = False
) -> None:
    """Write what `load(NAME)` finds, as `data/weights/dpmpb-NAME.safetensors`.

    `trained.save(path)` writes one file. Here the autoencoder goes into a file of its
    own, `autoencoder-NAME.safetensors`, unless it lies there already: it is ten times
    as large as a model, and five trainings share one. A ValueError, before anything is
    written, if another model or autoencoder has one of the names: choose other names
    (`dataclasses.replace`), or set `overwrite`.
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
    path = _free_path("dpmpb", trained.name, content, data, overwrite)
    if not _is_there(fingerprint, trained.autoencoder_name, data):
        save_autoencoder(
            trained.autoencoder,
            [],
            trained.autoencoder_name,
            data=data,
            overwrite=overwrite,
        )
    _write_weights(path, content, data)


def _is_there(fingerprint: str, name: str, data: Folder) -> bool:
    """Whether `data/` has the autoencoder of this fingerprint under this name."""
    if not _weights_path("autoencoder", name, data_folder(data)).is_file():
        return False
    autoencoder, _ = load_autoencoder(name, data=data)
    return autoencoder.fingerprint() == fingerprint


def save_model(
    trained: Checkpoint, *, data: Folder = None, overwrite: bool = False
) -> None:
    """Write the model of a robot without arm and autoencoder, and its p.

    The file is `data/weights/model-NAME.safetensors`; a ValueError if there is another
    one of this name, unless `overwrite` is set.
    """
    model = trained.model
    about = {
        "sizes": [model.state_size, model.command_size, model.bias_size],
        "materials": list(trained.biases),
    }
    numbers = {"p": list(trained.biases.values())}
    content = _packed("model", about, model, numbers)
    path = _free_path("model", trained.name, content, data, overwrite)
    _write_weights(path, content, data)


def load_model(name: str, *, data: Folder = None) -> Checkpoint:
    """Load such a model and p of each material."""
    path, about, tensors = _load_weights("model", name, data)
    with reading(path, "model weights"):
        biases = named_biases(about["materials"], tensors.pop("p"))
        model = filled(quicken(DPMPB(*about["sizes"])), tensors)
        return Checkpoint(name=name, model=model, biases=biases)


def load_autoencoder(
    name: str = "torque", *, data: Folder = None
) -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder, in evaluation mode, and its loss curve.

    The curve is the training's loss of each epoch `[epochs]` [nat per pixel].
    """
    path, about, tensors = _load_weights("autoencoder", name, data)
    with reading(path, "autoencoder weights"):
        losses = tensors.pop("losses").double().numpy()
        return filled(Autoencoder(about["latent_size"]), tensors), losses


def save_autoencoder(
    autoencoder: Autoencoder,
    losses: ArrayLike,
    name: str,
    *,
    data: Folder = None,
    overwrite: bool = False,
) -> None:
    """Write an autoencoder and its loss curve.

    Args:
        autoencoder: as it was trained.
        losses: of each epoch, `[epochs]` [nat per pixel].
        name: the file is `data/weights/autoencoder-NAME.safetensors`.
        data: folder to write into.
        overwrite: whether another one of this name may be lost; else a ValueError.
    """
    about = {"latent_size": autoencoder.latent_size}
    content = _packed("autoencoder", about, autoencoder, {"losses": losses})
    path = _free_path("autoencoder", name, content, data, overwrite)
    _write_weights(path, content, data)


def load_trials(name: str, *, data: Folder = None) -> list[Trial]:
    """Load a set of recorded trials, in the order of their file names.

    `"train"` and `"evaluation"` are the torque arm's; `"mine"` is what you recorded in
    the live lab, perhaps nothing yet. Sets that end in `-more` are not part of the
    repository: `make data` records them.
    """
    own = own_trials(data)
    data = data_folder(data)
    folder = choose("trials", name, sets("trials", data) | {OWN_TRIALS.name: own})
    if folder == own:
        return [load_trial(path) for path in sorted(own.glob("*.npz"))]
    paths = listed(f"trials/{name}/*.npz", data).values()
    return [load_trial(checked(path, data)) for path in paths]


def load_targets(
    name: str | None = None, *, data: Folder = None
) -> dict[str, np.ndarray]:
    """Load a set of target masks `[H, W]`, bool, by their names.

    The set is `"held-out"`, `"drawn"` or `"development"`; without a name, the targets
    that are in none.
    """
    data = data_folder(data)
    within = "" if name is None else _within(name, data)
    paths = listed(f"targets/{within}*.png", data)
    return {within + own: _read_target(path, data) for own, path in paths.items()}


def load_target(name: str, *, data: Folder = None) -> np.ndarray:
    """Load a target mask `[H, W]`, bool: `"target-1"`, or of a set, `"drawn/bar"`."""
    data = data_folder(data)
    *name_of_set, own = str(name).rsplit("/", 1)
    within = "".join(_within(each, data) for each in name_of_set)
    paths = listed(f"targets/{within}*.png", data)
    return _read_target(choose("target", own, paths), data)


def _read_target(path: Path, data: Path) -> np.ndarray:
    with reading(checked(path, data), "target"):
        return mask_from_file(path.read_bytes())


def _within(name: str, data: Path) -> str:
    return choose("set of targets", name, sets("targets", data)).name + "/"


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
    write(folder / f"{check_name('target', own)}.png", content.tobytes(), data)


def _load_weights(
    kind: str, name: str, data: Folder
) -> tuple[Path, dict[str, Any], dict[str, Tensor]]:
    """Path of a file of weights, what it says, and its tensors."""
    title = f"{kind} weights"
    path = find(title, f"weights/{kind}-*{SUFFIX}", name, data)
    return path, *unpacked(path, kind, title)


def _packed(
    kind: str, about: dict[str, Any], network: nn.Module, numbers: Mapping[str, Any]
) -> bytes:
    """The content of a file of weights, and of numbers that belong to them."""
    tensors = dict(network.state_dict())
    for name, values in numbers.items():
        tensors[name] = torch.as_tensor(np.array(values), dtype=torch.float32)
    return packed(kind, about, tensors)


def _free_path(
    kind: str, name: str, content: bytes, data: Folder, overwrite: bool
) -> Path:
    """Where a file of weights goes; a ValueError if another one would be lost."""
    data = data_folder(data)
    path = _weights_path(kind, name, data)
    check_own(path, data)
    check_free(path, content, overwrite=overwrite)
    return path


def _weights_path(kind: str, name: str, data: Path) -> Path:
    return data / "weights" / f"{kind}-{check_name('training', name)}{SUFFIX}"


def _write_weights(path: Path, content: bytes, data: Folder) -> None:
    data = data_folder(data)
    write(path, content, data)
    record_again(path, data)
