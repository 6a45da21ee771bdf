"""What lies in `data/`: trials, weights, targets and results, each checked against its
hash when it is loaded.

`load("torque-0")` gives all that belongs together. Weights say which arm and which
autoencoder they were trained with, so that a pair that does not belong together is
refused. `data` is the folder to use instead of the one that `data_folder` finds. An
unknown name is a KeyError that lists the choices; a file that is missing, damaged or
altered is a ValueError that names it, and what brings it back.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike
from safetensors import safe_open
from safetensors.torch import save as to_bytes

from clothlab._files import OtherKindError, reading, sha256, write_bytes
from clothlab._validation import check_name, choose
from clothlab.masks import check_mask
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.fast_rollout import quicken
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import arm_data, arm_from_data
from clothlab.simulation.vision import mask_from_file
from clothlab.trained import Trained
from clothlab.trials import Trial, load_trial

# What a user records: not part of the repository, so without a hash
OWN_TRIALS = Path("trials") / "mine"
_LEFT_OUT = (
    "trials/*-more/*"  # beyond the paper's amount: the repository has only their hashes
)
# Verdict on such a recording where it is not there, which is no fault
LEFT_TO_MAKE = "left to `make data`"
# In the format of `sha256sum`, so that `sha256sum --check --ignore-missing` works too
CHECKSUMS = "SHA256SUMS"
# Of files whose hash is recorded
_SUFFIXES = {".npz", ".safetensors", ".png", ".json", ".csv"}
_WEIGHTS_FORMAT = 1

_M = TypeVar("_M", bound=torch.nn.Module)
Folder = str | Path | None  # None: wherever `data_folder` finds it


def data_folder(data: Folder = None) -> Path:
    """The folder given, or the one that `CLOTHLAB_DATA` names, or that of the clone
    that the package runs from.
    """
    if data is None:
        data = (
            os.environ.get("CLOTHLAB_DATA")
            or Path(__file__).resolve().parents[1] / "data"
        )
    if not str(data) or not Path(data).is_dir():
        raise FileNotFoundError(
            f"no data in {str(data)!r}: clone the repository, which has a folder data/, and run from there, or set "
            "CLOTHLAB_DATA to that folder"
        )
    return Path(data)


def own_trials(data: Folder = None) -> Path:
    """Where a user's recordings are: the folder that `CLOTHLAB_RECORDINGS` names, or
    `trials/mine` of the data.
    """
    named = os.environ.get("CLOTHLAB_RECORDINGS")
    return (
        Path(named).expanduser()
        if named and data is None
        else data_folder(data) / OWN_TRIALS
    )


def load(name: str = "torque-0", *, data: Folder = None) -> Trained:
    """Load arm, autoencoder, model and parametric biases together; `torque-0` to
    `torque-4` differ in their seed.
    """
    path, about, tensors = _load_tensors("dpmpb", name, data)
    with reading(path, "dpmpb weights"):
        arm = arm_from_data(about["arm"])
        autoencoder_name, fingerprint = about["sees_with"], about["autoencoder"]
    autoencoder, _ = load_autoencoder(autoencoder_name, data=data)
    if autoencoder.fingerprint() != fingerprint:
        raise ValueError(
            f"the weights {name!r} were trained with another autoencoder than the {autoencoder_name!r} that lies here: "
            "train them again with `make train`, or restore the files with `git checkout data/weights`"
        )
    with reading(path, "dpmpb weights"):
        losses, p = tensors.pop("losses").double().numpy(), tensors.pop("p").numpy()
        biases = dict(zip(about["materials"], p, strict=True))
        states = arm.layout(autoencoder.latent_size).size
        model = quicken(DPMPB(states, len(arm.command_names), p.shape[1]))
        return Trained(
            name,
            arm,
            autoencoder,
            _filled(model, tensors),
            biases,
            losses,
            autoencoder_name,
        )


def save(trained: Trained, *, data: Folder = None, overwrite: bool = False) -> None:
    """Write model, biases, losses and arm as `data/weights/dpmpb-NAME.safetensors`, so
    that `load(NAME)` finds all.

    The autoencoder goes into a file of its own, `autoencoder-NAME.safetensors`, unless
    it lies there already. A ValueError, before anything is written, if another model or
    autoencoder has one of the names: choose other names (`dataclasses.replace`), or set
    `overwrite`.
    """
    fingerprint = trained.autoencoder.fingerprint()
    about = {
        "arm": arm_data(trained.arm),
        "sees_with": trained.autoencoder_name,
        "autoencoder": fingerprint,
        "materials": list(trained.biases),
    }
    p = np.array(list(trained.biases.values()))
    # The model's file is made, and refused, before the autoencoder's is written.
    model = _weights_file(
        "dpmpb",
        trained.name,
        trained.model,
        about,
        data,
        overwrite,
        losses=trained.losses,
        p=p,
    )
    if not _is_there(fingerprint, trained.autoencoder_name, data):
        save_autoencoder(
            trained.autoencoder,
            [],
            trained.autoencoder_name,
            data=data,
            overwrite=overwrite,
        )
    _write_weights(*model, data)


def _is_there(fingerprint: str, name: str, data: Folder) -> bool:
    """Whether the autoencoder of this name in `data/` is the one with this fingerprint."""
    if not _weights_path("autoencoder", name, data_folder(data)).is_file():
        return False
    autoencoder, _ = load_autoencoder(name, data=data)
    return autoencoder.fingerprint() == fingerprint


def save_model(
    model: DPMPB,
    biases: Mapping[str, np.ndarray],
    name: str,
    *,
    data: Folder = None,
    overwrite: bool = False,
) -> None:
    """Write the model of a robot without arm and autoencoder, and its p, as
    `data/weights/model-NAME.safetensors`.

    A ValueError if there is another one of this name, unless `overwrite` is set.
    """
    about = {
        "sizes": [model.state_size, model.command_size, model.bias_size],
        "materials": list(biases),
    }
    p = np.array(list(biases.values()))
    _write_weights(
        *_weights_file("model", name, model, about, data, overwrite, p=p), data
    )


def load_model(
    name: str, *, data: Folder = None
) -> tuple[DPMPB, dict[str, np.ndarray]]:
    """Load such a model, and p of each material `{name: [D_p]}`."""
    path, about, tensors = _load_tensors("model", name, data)
    with reading(path, "model weights"):
        biases = dict(zip(about["materials"], tensors.pop("p").numpy(), strict=True))
        return _filled(quicken(DPMPB(*about["sizes"])), tensors), biases


def load_autoencoder(
    name: str = "torque", *, data: Folder = None
) -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder, in evaluation mode, and its training loss of each epoch [nat
    per pixel].
    """
    path, about, tensors = _load_tensors("autoencoder", name, data)
    with reading(path, "autoencoder weights"):
        losses = tensors.pop("losses").double().numpy()
        return _filled(Autoencoder(about["latent_size"]), tensors), losses


def save_autoencoder(
    model: Autoencoder,
    losses: ArrayLike,
    name: str,
    *,
    data: Folder = None,
    overwrite: bool = False,
) -> None:
    """Write an autoencoder and its loss curve [nat per pixel] as
    `data/weights/autoencoder-NAME.safetensors`.

    A ValueError if there is another one of this name, unless `overwrite` is set.
    """
    about = {"latent_size": model.latent_size}
    file = _weights_file(
        "autoencoder", name, model, about, data, overwrite, losses=np.asarray(losses)
    )
    _write_weights(*file, data)


def _filled(model: _M, tensors: Mapping[str, torch.Tensor]) -> _M:
    """A network with weights from a file, to be used and not trained."""
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise OtherKindError(
            f"its layers are not those of {type(model).__name__}: {reason:.200}"
        ) from None
    return model.eval().requires_grad_(False)


def load_trials(name: str, *, data: Folder = None) -> list[Trial]:
    """Load a set of recorded trials, such as `"train"` or `"evaluation"`, in the order
    of their file names.

    `"mine"` is what you recorded in the live lab, perhaps nothing yet. Sets that end in
    `-more` are not part of the repository: `make data` records them.
    """
    own, data = own_trials(data), data_folder(data)
    folder = choose("trials", name, _sets("trials", data) | {OWN_TRIALS.name: own})
    if folder == own:
        return [load_trial(path) for path in sorted(own.glob("*.npz"))]
    return [
        load_trial(_checked(path, data))
        for path in _listed(f"trials/{name}/*.npz", data).values()
    ]


def load_targets(
    name: str | None = None, *, data: Folder = None
) -> dict[str, np.ndarray]:
    """Load a set of target masks `[H, W]`, bool, by their names: `"held-out"`,
    `"drawn"`; or those that are in none.
    """
    data = data_folder(data)
    within = "" if name is None else _within(name, data)
    return {
        within + own: _read_target(path, data)
        for own, path in _listed(f"targets/{within}*.png", data).items()
    }


def load_target(name: str, *, data: Folder = None) -> np.ndarray:
    """Load a target mask `[H, W]`, bool: `"target-1"`, or of a set, `"drawn/bar"`."""
    data = data_folder(data)
    *name_of_set, own = str(name).rsplit("/", 1)
    within = "".join(_within(each, data) for each in name_of_set)
    return _read_target(
        choose("target", own, _listed(f"targets/{within}*.png", data)), data
    )


def _read_target(path: Path, data: Path) -> np.ndarray:
    with reading(_checked(path, data), "target"):
        return mask_from_file(path.read_bytes())


def _within(name: str, data: Path) -> str:
    return choose("set of targets", name, _sets("targets", data)).name + "/"


def save_target(mask: ArrayLike, name: str, *, data: Folder = None) -> None:
    """Write a target mask `[H, W]` as `data/targets/NAME.png`, or of a set as
    `data/targets/SET/NAME.png`.
    """
    _, content = cv2.imencode(".png", check_mask(mask).astype(np.uint8) * 255)
    *within, own = name.split("/", 1) if isinstance(name, str) else [name]
    folder = (data_folder(data) / "targets").joinpath(
        *(check_name("set", each) for each in within)
    )
    write_bytes(folder / f"{check_name('target', own)}.png", content.tobytes())


def save_results(
    content: bytes, name: str, suffix: str, *, data: Folder = None
) -> None:
    """Write `data/results/NAME SUFFIX`."""
    if suffix not in _SUFFIXES:
        raise ValueError(
            f"results end in {', '.join(sorted(_SUFFIXES))}, got {suffix!r}"
        )
    write_bytes(
        data_folder(data) / "results" / f"{check_name('result', name)}{suffix}", content
    )


def load_results(name: str, suffix: str, *, data: Folder = None) -> bytes:
    """The content of `data/results/NAME SUFFIX`."""
    return _find("results", f"results/*{suffix}", name, data).read_bytes()


def write_checksums(data: Folder = None) -> None:
    """Record the hash of every file in `data/`, in `data/SHA256SUMS`; what is left to
    `make data` keeps its own.
    """
    data = data_folder(data)
    hashes = {
        name: digest for name, digest in _recorded(data).items() if _is_left_out(name)
    }
    hashes |= {name: sha256(data / name) for name in _present(data)}
    _write_hashes(hashes, data)


def _write_hashes(hashes: Mapping[str, str], data: Path) -> None:
    lines = [f"{hashes[name]}  {name}\n" for name in sorted(hashes)]
    write_bytes(data / CHECKSUMS, "".join(lines).encode())


def check_data(data: Folder = None) -> dict[str, str]:
    """Compare each file in `data/` with its hash: "ok", "missing", `LEFT_TO_MAKE`,
    "altered" or "not recorded".
    """
    data = data_folder(data)
    recorded = _recorded(data)
    return {
        name: _verdict(data / name, recorded.get(name))
        for name in sorted({*recorded, *_present(data)})
    }


def cure(name: str) -> str:
    """What brings back a file of `data/`, as an imperative."""
    return (
        "record it with `make data`"
        if _is_left_out(name)
        else f"restore it with `git checkout data/{name}`"
    )


def _is_left_out(name: str) -> bool:
    return PurePosixPath(name).match(_LEFT_OUT)


def _recorded(data: Path) -> dict[str, str]:
    """Recorded hashes, `{file: hash}`."""
    path = data / CHECKSUMS
    with reading(path, "list of hashes"):
        lines = path.read_text().splitlines() if path.exists() else []
        pairs = (line.split("  ") for line in lines)
        return {name: digest for digest, name in pairs}


def _present(data: Path) -> list[str]:
    """Files of the repository that are there."""
    paths = (
        path
        for path in data.rglob("*")
        if path.suffix in _SUFFIXES and data / OWN_TRIALS not in path.parents
    )
    return [path.relative_to(data).as_posix() for path in paths if path.is_file()]


def _verdict(path: Path, recorded: str | None) -> str:
    if not path.is_file():
        return LEFT_TO_MAKE if _is_left_out("/".join(path.parts[-3:])) else "missing"
    if recorded is None:
        return "not recorded"
    return "ok" if sha256(path) == recorded else "altered"


def _sets(kind: str, data: Path) -> dict[str, Path]:
    """The folders in `data/KIND`, those that are there and those that should be."""
    there = {path.name for path in (data / kind).glob("*") if path.is_dir()}
    parts = (name.split("/") for name in _recorded(data))
    recorded = {each[1] for each in parts if each[0] == kind and len(each) == 3}
    return {name: data / kind / name for name in sorted(there | recorded)}


def _listed(pattern: str, data: Path) -> dict[str, Path]:
    """The files that fit a pattern, those that are there and those that should be, by
    what stands for its `*`.
    """
    start, end = pattern.split("*")
    there = {
        path.relative_to(data).as_posix()
        for path in data.glob(pattern)
        if path.is_file()
    }
    fitting = {
        name
        for name in _recorded(data)
        if name.startswith(start) and name.endswith(end)
    } | there
    inner = (name[len(start) : len(name) - len(end)] for name in sorted(fitting))
    return {name: data / f"{start}{name}{end}" for name in inner if "/" not in name}


def _find(kind: str, pattern: str, name: str, data: Folder) -> Path:
    """The file that fits a pattern with this name for its `*`."""
    data = data_folder(data)
    return _checked(
        choose(kind, name, _listed(pattern, data), "(none yet: run `make data train`)"),
        data,
    )


def _checked(path: Path, data: Path) -> Path:
    """The path, if the file's content is the one whose hash was recorded."""
    name = path.relative_to(data).as_posix()
    verdict = _verdict(path, _recorded(data).get(name))
    if verdict in ("missing", LEFT_TO_MAKE):
        raise ValueError(f"data/{name} is missing: {cure(name)}")
    if verdict == "altered":
        raise ValueError(
            f"data/{name} is damaged or was altered: {cure(name)}, or record a change you made with "
            "`python -m clothlab checksums`"
        )
    return path


def _weights_file(
    kind: str,
    name: str,
    model: torch.nn.Module,
    about: dict[str, Any],
    data: Folder,
    overwrite: bool,
    **more: np.ndarray,
) -> tuple[Path, bytes]:
    """Path and content of a file of weights; a ValueError if it may not be written."""
    data = data_folder(data)
    path = _weights_path(kind, name, data)
    tensors = {key: tensor.contiguous() for key, tensor in model.state_dict().items()}
    tensors |= {
        key: torch.as_tensor(array, dtype=torch.float32) for key, array in more.items()
    }
    _check_numbers(tensors)
    about = {"format": _WEIGHTS_FORMAT, "kind": kind, **about}
    content = to_bytes(tensors, metadata={"clothlab": json.dumps(about)})
    if not overwrite and path.is_file() and path.read_bytes() != content:
        raise ValueError(
            f"data/weights/{path.name} exists and differs: choose another name, or pass overwrite=True"
        )
    return path, content


def _write_weights(path: Path, content: bytes, data: Folder) -> None:
    write_bytes(path, content)
    _record_again(path, data_folder(data))


def _weights_path(kind: str, name: str, data: Path) -> Path:
    return data / "weights" / f"{kind}-{check_name('training', name)}.safetensors"


def _record_again(path: Path, data: Path) -> None:
    """Give a file that was overwritten its new hash, where it had one."""
    hashes = _recorded(data)
    name = path.relative_to(data).as_posix()
    if name in hashes:
        _write_hashes(hashes | {name: sha256(path)}, data)


def _load_tensors(
    kind: str, name: str, data: Folder
) -> tuple[Path, dict[str, Any], dict[str, torch.Tensor]]:
    path = _find(f"{kind} weights", f"weights/{kind}-*.safetensors", name, data)
    with reading(path, f"{kind} weights"):
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
        if "clothlab" not in metadata:
            raise OtherKindError("clothlab did not write it")
        about = json.loads(metadata["clothlab"])
        if about["format"] != _WEIGHTS_FORMAT:
            raise OtherKindError(
                f"its format is {about['format']}, this version reads {_WEIGHTS_FORMAT}"
            )
        if about["kind"] != kind:
            raise OtherKindError(f"it holds {about['kind']} weights")
        _check_numbers(tensors)
    return path, about, tensors


def _check_numbers(tensors: Mapping[str, torch.Tensor]) -> None:
    """Refuse numbers with which a network would compute nonsense, in silence."""
    for key, tensor in tensors.items():
        if not tensor.isfinite().all():
            raise ValueError(f"numbers of {key} are not finite")
        if key.endswith("_std") and not (tensor > 0).all():
            raise ValueError(f"standard deviations {key} are not all above 0")
