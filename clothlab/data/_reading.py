"""What lies in `data/` by its name: trials, weights, targets."""

from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from clothlab._files import reading
from clothlab._store import (
    OWN_TRIALS,
    Folder,
    checked,
    data_folder,
    find,
    listed,
    own_trials,
    sets,
)
from clothlab._validation import choose
from clothlab.method.autoencoder import Autoencoder
from clothlab.simulation.vision import mask_from_file
from clothlab.trials import Trial, load_trial
from clothlab.weights import (
    SUFFIX,
    Checkpoint,
    ClothCheckpoint,
    filled,
    fingerprint,
    read_tensors,
)


def load(name: str | Path = "torque-0", *, data: Folder = None) -> ClothCheckpoint:
    """Load arm, autoencoder, model and p of each cloth together.

    Either by name from `data/`, where `torque-0` to `torque-4` differ in their seed, or
    by the path of a file that `ClothCheckpoint.save` wrote, which ends in
    `.safetensors`.
    """
    if isinstance(name, Path) or str(name).endswith(SUFFIX):
        return ClothCheckpoint.load(name)

    # A model is nothing without the autoencoder whose z it was trained on.
    _, about, tensors = _load_weights("model", name, data)
    if "autoencoder" not in about:
        raise ValueError(f"{name} is no model of a cloth: `load_model` reads it")
    _, _, layers = _load_weights("autoencoder", about["autoencoder_name"], data)
    loaded = ClothCheckpoint.from_contents(about, layers | tensors)
    if fingerprint(loaded.autoencoder) != about["autoencoder"]:
        raise ValueError(
            f"the weights {name!r} were trained with another autoencoder than the"
            f" {about['autoencoder_name']!r} that lies here: train them again with "
            "`make train`, or restore the files with `git checkout data/weights`"
        )
    return loaded


def load_model(name: str, *, data: Folder = None) -> Checkpoint:
    """Load a model without arm and autoencoder, and p of each material."""
    _, about, tensors = _load_weights("model", name, data)
    return Checkpoint.from_contents(about, tensors)


def load_autoencoder(
    name: str = "torque", *, data: Folder = None
) -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder, in evaluation mode, and its loss curve.

    The curve is the training's loss of each epoch `[epochs]` [nat per pixel].
    """
    _, about, tensors = _load_weights("autoencoder", name, data)
    autoencoder = filled(Autoencoder(about["latent_size"]), tensors, "autoencoder.")
    return autoencoder, tensors["losses"].double().numpy()


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


def _load_weights(
    kind: str, name: str, data: Folder
) -> tuple[Path, dict[str, Any], dict[str, Tensor]]:
    """Path of a file of weights, what it says, and its tensors."""
    path = find(f"{kind} weights", f"weights/{kind}-*{SUFFIX}", name, data)
    return path, *read_tensors(path)
