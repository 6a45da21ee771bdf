"""What lies in `data/`: trials, weights, targets and results, each checked against its hash when it is loaded.

`load("torque-0")` gives all that belongs together. Weights say which arm and which autoencoder they were trained with,
so that a pair that does not belong together is refused.
"""

import json
import os
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike
from safetensors.torch import save as to_bytes

from clothlab._files import LEFT_OVER, read_tensors, reading, sha256, write_bytes
from clothlab._validation import check_array, check_name, check_number, choose
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import DPMPB
from clothlab.learning.trained import Trained
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.vision import check_mask, mask_from_file
from clothlab.trials import Trial, load_trial

OWN_TRIALS = Path("trials") / "mine"  # what a user records: not part of the repository, so without a hash
MORE = "-more"  # ending of sets of trials beyond the paper's amount
LEFT_OUT = f"trials/*{MORE}/*"  # the repository has their hashes alone
LEFT_TO_MAKE = "left to `make data`"  # verdict on such a recording where it is not there, which is no fault
CHECKSUMS = "SHA256SUMS"  # in the format of `sha256sum`, so that `sha256sum --check --ignore-missing` works too
WEIGHTS_FORMAT = 1
RESULTS_FORMAT = 1

M = TypeVar("M", bound=torch.nn.Module)
Folder = str | Path | None  # None: wherever `data_folder` finds it


def data_folder(data: Folder = None) -> Path:
    """The folder given, or the one that `CLOTHLAB_DATA` names, or that of the clone that the package runs from."""
    if data is None:
        data = os.environ.get("CLOTHLAB_DATA") or Path(__file__).resolve().parents[1] / "data"
    if not str(data) or not Path(data).is_dir():
        raise FileNotFoundError(
            f"no data in {str(data)!r}: clone the repository, which has a folder data/, and run from there, or set "
            "CLOTHLAB_DATA to that folder"
        )
    return Path(data)


def own_trials(data: Folder = None) -> Path:
    """Where a user's recordings are: the folder that `CLOTHLAB_RECORDINGS` names, or `trials/mine` of the data.

    Args:
        data: folder to look in, whatever the environment says.

    Raises:
        FileNotFoundError: as `data_folder`.
    """
    named = os.environ.get("CLOTHLAB_RECORDINGS")
    return Path(named).expanduser() if named and data is None else data_folder(data) / OWN_TRIALS


def load(name: str = "torque-0", *, data: Folder = None) -> Trained:
    """Load arm, autoencoder, model and parametric biases together.

    Args:
        name: which training; `torque-0` to `torque-4` differ in their seed alone.
        data: folder to look in.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file, or a model and an autoencoder that do not belong together.
    """
    path, about, tensors = _load_tensors("dpmpb", name, data)
    with reading(path, "dpmpb weights"):
        arm, sees_with, materials = get_arm(about["arm"]), about["sees_with"], list(about["materials"])
        fingerprint = about["autoencoder"]
    autoencoder, _ = load_autoencoder(sees_with, data=data)
    if autoencoder.fingerprint() != fingerprint:
        raise ValueError(
            f"the weights {name!r} were trained with another autoencoder than the {sees_with!r} that lies here: train "
            "them again with `make train`, or restore the files with `git checkout data/weights`"
        )
    with reading(path, "dpmpb weights"):
        losses = check_array("losses", tensors.pop("losses"), ("epochs",))
        p = check_array("p", tensors.pop("p"), (len(materials), "D_p"), np.float32)
        sizes = arm.layout(autoencoder.latent_size).size, len(arm.command_names), p.shape[1]
        model = filled(lambda: DPMPB(*sizes), tensors)
    return Trained(name, arm, autoencoder, model, dict(zip(materials, p, strict=True)), losses, sees_with)


def save(trained: Trained, *, data: Folder = None) -> None:
    """Write model, biases and losses as `data/weights/dpmpb-NAME.safetensors`; its autoencoder is saved by itself."""
    about: dict[str, Any] = {"kind": "dpmpb", "arm": trained.arm.name, "sees_with": trained.autoencoder_name}
    about |= {"autoencoder": trained.autoencoder.fingerprint(), "materials": list(trained.biases)}
    p = check_array("p", list(trained.biases.values()), ("K", trained.model.bias_size), np.float32)
    _save_tensors("dpmpb", trained.name, trained.model, about, data, losses=trained.losses, p=p)


def load_autoencoder(name: str = "torque", *, data: Folder = None) -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder, in evaluation mode, and its training loss of each epoch [nat per pixel].

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    path, about, tensors = _load_tensors("autoencoder", name, data)
    with reading(path, "autoencoder weights"):
        losses = check_array("losses", tensors.pop("losses"), ("epochs",))
        latent_size = check_number("latent_size", about["latent_size"], int, at_least=1)
        return filled(lambda: Autoencoder(latent_size), tensors), losses


def save_autoencoder(model: Autoencoder, losses: ArrayLike, name: str, *, data: Folder = None) -> None:
    """Write an autoencoder and its loss curve [nat per pixel] as `data/weights/autoencoder-NAME.safetensors`."""
    about = {"kind": "autoencoder", "latent_size": model.latent_size}
    _save_tensors("autoencoder", name, model, about, data, losses=losses)


def filled(make: Callable[[], M], tensors: Mapping[str, torch.Tensor]) -> M:
    """A network with weights from a file, to be used and not trained.

    Args:
        make: makes the network, of sizes that may come from the same file.
        tensors: its weights by name; none missing, none left over.

    Raises:
        ValueError: weights of another network. Memory for a network that a file only claims to hold is not taken.
    """
    with torch.device("meta"):  # where tensors have a shape and no content
        wanted = {name: list(tensor.shape) for name, tensor in make().state_dict().items()}
    given = {name: list(tensor.shape) for name, tensor in tensors.items()}
    for name in sorted(wanted.keys() | given.keys()):
        if wanted.get(name) != given.get(name):
            raise ValueError(f"{name} has the shape {given.get(name)}, where the network has {wanted.get(name)}")
    model = make()
    model.load_state_dict(tensors)
    return model.eval().requires_grad_(False)


def load_trials(name: str, *, first: int | None = None, data: Folder = None) -> list[Trial]:
    """Load a set of recorded trials, such as `"train"` or `"evaluation"`, in the order of their file names.

    Args:
        name: which set; `"mine"` is what you recorded in the live lab (`own_trials`), perhaps nothing yet. Those that
            end in `-more` are not part of the repository: `make data` records them.
        first: only so many of them, or all that there are where there are fewer.
        data: folder to look in.

    Raises:
        KeyError: unknown set; the message lists the choices.
        ValueError: a damaged, altered or missing file.
    """
    own, data = own_trials(data), data_folder(data)
    chosen = choose("trials", name, _sets("trials", data) | {OWN_TRIALS.name: own})
    first = None if first is None else check_number("first", first, int, at_least=0)
    if chosen == own:
        return [load_trial(path) for path in sorted(own.glob("*.npz"))[:first]]
    return [load_trial(_checked(path, data)) for path in _listed(chosen, ".npz", data)[:first]]


def load_targets(name: str | None = None, *, data: Folder = None) -> dict[str, np.ndarray]:
    """Load target masks, `{name: [H, W]}`, bool, under the names that `load_target` knows.

    Args:
        name: which set, such as `"held-out"`, `"drawn"` or `"development"`; without it, those that belong to none.
        data: folder to look in.

    Raises:
        KeyError: unknown set; the message lists the choices.
        ValueError: as `load_target`, or a file is missing.
    """
    data = data_folder(data)
    folder = data / "targets" if name is None else choose("set of targets", name, _sets("targets", data))
    within = "" if name is None else f"{name}/"
    names = [within + path.stem for path in _listed(folder, ".png", data)]
    return {each: load_target(each, data=data) for each in names}


def load_target(name: str, *, data: Folder = None) -> np.ndarray:
    """Load a target mask `[H, W]`, bool: `"target-1"`, or of a set, `"drawn/bar"`.

    Raises:
        KeyError: unknown name or set; the message lists the choices.
        ValueError: a damaged or altered file, or an image of another size or without a cloth.
    """
    data = data_folder(data)
    folder, own = "targets", name
    if isinstance(name, str) and "/" in name:
        within, _, own = name.rpartition("/")
        folder = f"targets/{choose('set of targets', within, _sets('targets', data)).name}"
    path = _find(folder, "", ".png", "target", own, data)
    with reading(path, "target"):
        return mask_from_file(path.read_bytes())


def save_target(mask: ArrayLike, name: str, *, data: Folder = None) -> None:
    """Write a target mask `[H, W]` as `data/targets/NAME.png`, or of a set as `data/targets/SET/NAME.png`."""
    _, content = cv2.imencode(".png", check_mask(mask).astype(np.uint8) * 255)
    *within, own = name.split("/", 1) if isinstance(name, str) else [name]
    folder = (data_folder(data) / "targets").joinpath(*(check_name("set", each) for each in within))
    write_bytes(folder / f"{check_name('target', own)}.png", content.tobytes())


def recorded_with(target: str) -> tuple[str, str]:
    """Names of the arm and the cloth that a target was recorded with, as its own name has it.

    Args:
        target: name of a recorded target, such as `"held-out/torque_damp0.03-mass0.05_4"`.

    Raises:
        ValueError: a target whose name does not say so, such as a drawn one.
        KeyError: an unknown arm or cloth; the message lists the choices.
    """
    found = re.fullmatch(r"(?:.*/)?([^_/]+)_([^_/]+)_\d+", str(target))
    if not found:
        raise ValueError(f"{target!r} does not say what it was recorded with, as held-out/ARM_CLOTH_0 does")
    return get_arm(found[1]).name, get_cloth(found[2]).name


def save_results(results: Mapping[str, Any], name: str, *, data: Folder = None) -> None:
    """Write measured results as `data/results/NAME.json`.

    Raises:
        ValueError: numbers that are not finite.
        TypeError: what JSON has no word for.
    """
    text = json.dumps({"format": RESULTS_FORMAT, **results}, indent=1, allow_nan=False)
    text = re.sub(r'\[[^][{}"]*\]', lambda row: " ".join(row[0].split()), text)  # a row of numbers on one line
    write_bytes(data_folder(data) / "results" / f"{check_name('result', name)}.json", text.encode() + b"\n")


def load_results(name: str, *, data: Folder = None) -> dict[str, Any]:
    """Load measured results.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file, or one of another format.
    """
    path = _find("results", "", ".json", "results", name, data)
    with reading(path, "results"):
        results = json.loads(path.read_bytes())
        if results.pop("format") != RESULTS_FORMAT:
            raise ValueError(f"its format is not {RESULTS_FORMAT}, this version's")
        return results


def read_results(name: str, suffix: str, *, data: Folder = None) -> bytes:
    """The content of `data/results/NAME SUFFIX`.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: an altered file.
    """
    return _find("results", "", suffix, "results", name, data).read_bytes()


def write_checksums(data: Folder = None) -> None:
    """Record the hash of every file in `data/`, in `data/SHA256SUMS`; what is left to `make data` keeps its own."""
    data = data_folder(data)
    hashes = {name: digest for name, digest in _checksums(data)[0].items() if _left_out(name)}
    hashes |= {path.relative_to(data).as_posix(): sha256(path) for path in _files(data)}
    lines = [f"{hashes[name]}  {name}\n" for name in sorted(hashes)]
    write_bytes(data / CHECKSUMS, "".join(lines).encode())


def check_data(data: Folder = None) -> dict[str, str]:
    """Compare every file in `data/` with its recorded hash.

    Returns:
        `{file: verdict}`, each "ok", "missing", `LEFT_TO_MAKE`, "altered", "not recorded", "damaged" or "left over".
        Damaged is the list of hashes itself, left over is what an interrupted write did not remove.
    """
    data = data_folder(data)
    recorded, damaged = _checksums(data)
    present = {path.relative_to(data).as_posix() for path in _files(data)}
    verdict = {CHECKSUMS: "damaged"} if damaged else {}
    verdict |= {name: LEFT_TO_MAKE if _left_out(name) else "missing" for name in recorded if name not in present}
    for name in sorted(present):
        if name not in recorded:
            verdict[name] = "not recorded"
        else:
            verdict[name] = "ok" if sha256(data / name) == recorded[name] else "altered"
    left_over = sorted(path for path in data.rglob(f".*{LEFT_OVER}"))
    return verdict | {path.relative_to(data).as_posix(): "left over" for path in left_over}


def cure(name: str) -> str:
    """What brings back a file of `data/`, as an imperative."""
    return "record it with `make data`" if _left_out(name) else f"restore it with `git checkout data/{name}`"


def _left_out(name: str) -> bool:
    return PurePosixPath(str(name)).match(LEFT_OUT)


def _files(data: Path) -> list[Path]:
    kept = {".npz", ".safetensors", ".png", ".json", ".csv"}
    return sorted(
        path
        for path in data.rglob("*")
        if path.suffix in kept and path.is_file() and data / OWN_TRIALS not in path.parents
    )


def _checksums(data: Path) -> tuple[dict[str, str], bool]:
    """Recorded hashes, `{file: hash}`, and whether there are lines that say none, or one of a file elsewhere."""
    path = data / CHECKSUMS
    if not path.exists():
        return {}, False
    with reading(path, "list of hashes"):
        return _parsed(path.read_bytes().decode(errors="replace"))


@lru_cache(maxsize=1)  # of hundreds of trials, each is looked up in hundreds of lines
def _parsed(text: str) -> tuple[dict[str, str], bool]:
    found = [re.fullmatch(r"([0-9a-fA-F]{64}) [ *](\S.*)", line) for line in text.splitlines() if line.strip()]
    inside = {match[2]: match[1].lower() for match in found if match and ".." not in PurePosixPath(match[2]).parts}
    return inside, len(inside) < len(found)


def _sets(folder: str, data: Path) -> dict[str, Path]:
    """The folders in `data/FOLDER`, those that are there and those that should be, in the order of their names."""
    there = {path for path in (data / folder).glob("*") if path.is_dir()}
    recorded = {(data / name).parent for name in _checksums(data)[0]}
    return {path.name: path for path in sorted(there | recorded) if path.parent == data / folder}


def _listed(folder: Path, suffix: str, data: Path) -> list[Path]:
    """The files of a folder and those that should be there, in the order of their names."""
    there = {path for path in folder.glob("*") if path.is_file()}
    recorded = {data / name for name in _checksums(data)[0]}
    return sorted(path for path in there | recorded if path.parent == folder and path.suffix == suffix)


def _checked(path: Path, data: Path) -> Path:
    """Return `path` if its content is the one whose hash was recorded."""
    recorded, damaged = _checksums(data)
    name = path.relative_to(data).as_posix()
    if not path.is_file():
        raise ValueError(f"data/{name} is missing: {cure(name)}")
    if name not in recorded and damaged:
        raise ValueError(f"data/{CHECKSUMS} is damaged: {cure(CHECKSUMS)}")
    if recorded.get(name, "") and sha256(path) != recorded[name]:
        raise ValueError(
            f"data/{name} is damaged or was altered: {cure(name)}, or record a change you made with "
            "`python -m clothlab checksums`"
        )
    return path


def _find(folder: str, prefix: str, suffix: str, kind: str, name: str, data: Folder) -> Path:
    """The file `data/FOLDER/PREFIX NAME SUFFIX`."""
    data = data_folder(data)
    paths = [path for path in _listed(data / folder, suffix, data) if path.name.startswith(prefix)]
    choices = {path.name.removeprefix(prefix).removesuffix(suffix): path for path in paths}
    return _checked(choose(kind, name, choices, "(none yet: run `make data train`)"), data)


def _save_tensors(
    kind: str,
    name: str,
    model: torch.nn.Module,
    about: dict[str, Any],
    data: Folder,
    losses: ArrayLike,
    **extra: np.ndarray,
) -> None:
    path = data_folder(data) / "weights" / f"{kind}-{check_name('training', name)}.safetensors"
    extra["losses"] = check_array("losses", losses, ("epochs",), np.float32)
    tensors = {key: tensor.contiguous() for key, tensor in model.state_dict().items()}
    tensors |= {key: torch.as_tensor(array) for key, array in extra.items()}
    _check_finite(tensors)
    write_bytes(path, to_bytes(tensors, metadata={"clothlab": json.dumps({"format": WEIGHTS_FORMAT} | about)}))


def _load_tensors(kind: str, name: str, data: Folder) -> tuple[Path, dict[str, Any], dict[str, torch.Tensor]]:
    path = _find("weights", f"{kind}-", ".safetensors", f"{kind} weights", name, data)
    with reading(path, f"{kind} weights"):
        words, tensors = read_tensors(path)
        about = json.loads(words["clothlab"])
        if (about["format"], about["kind"]) != (WEIGHTS_FORMAT, kind):
            raise ValueError(f"its format is not {WEIGHTS_FORMAT}, this version's")
        _check_finite(tensors)
    return path, about, tensors


def _check_finite(tensors: dict[str, torch.Tensor]) -> None:
    broken = [key for key, tensor in tensors.items() if not tensor.isfinite().all()]
    if broken:
        raise ValueError(f"numbers of {broken[0]} are not finite")
