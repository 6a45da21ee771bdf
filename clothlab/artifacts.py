"""What the recipes leave in `data/`.

Trials, weights, targets and results, each checked against its hash when it is loaded.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from clothlab._choices import choose
from clothlab._files import atomic_write, sha256
from clothlab.autoencoder import Autoencoder
from clothlab.dpmpb import DPMPB
from clothlab.trials import Trial, load_trial
from clothlab.vision import check_mask

__all__ = [
    "DATA",
    "OWN_TRIALS",
    "check_data",
    "load_autoencoder",
    "load_dpmpb",
    "load_results",
    "load_target",
    "load_targets",
    "load_trials",
    "save_autoencoder",
    "save_dpmpb",
    "save_results",
    "save_target",
    "write_checksums",
]

DATA = Path(__file__).resolve().parents[1] / "data"
OWN_TRIALS = Path("trials") / "mine"  # what a user records: not part of the repository, so without a hash
CHECKSUMS = "SHA256SUMS"  # in the format of `sha256sum`, so that `cd data; sha256sum --check SHA256SUMS` works too


def load_trials(name: str, *, data: Path = DATA) -> list[Trial]:
    """Load a set of recorded trials, such as `"train"` or `"evaluation"`.

    Args:
        name: which set; `"mine"` is what you recorded in the live lab, perhaps nothing yet.
        data: folder to look in.

    Returns:
        The trials, in the order of their file names.

    Raises:
        KeyError: unknown set; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    folder = data / "trials"
    choices = {path.name: path for path in sorted(folder.glob("*")) if path.is_dir()}
    if name == OWN_TRIALS.name:
        choices[name] = data / OWN_TRIALS
    chosen = choose("trials", name, choices, "(none yet: run `make data`)")
    return [load_trial(_checked(path, data)) for path in sorted(chosen.glob("*.npz"))]


def save_autoencoder(model: Autoencoder, losses: list[float], name: str, *, data: Path = DATA) -> None:
    """Write an autoencoder and its loss curve [nat per pixel] as `data/weights/autoencoder-NAME.safetensors`."""
    about = {"kind": "autoencoder", "latent_size": model.latent_size}
    _save_tensors(data / "weights" / f"autoencoder-{name}.safetensors", model, about, losses=torch.tensor(losses))


def load_autoencoder(name: str = "torque", *, data: Path = DATA) -> tuple[Autoencoder, np.ndarray]:
    """Load an autoencoder.

    Args:
        name: which one.
        data: folder to look in.

    Returns:
        The model in evaluation mode, and its training loss of each epoch.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    about, tensors = _load_tensors("autoencoder", name, data)
    model = Autoencoder(about["latent_size"])
    losses = tensors.pop("losses").numpy()
    model.load_state_dict(tensors)
    return model.eval(), losses


def save_dpmpb(
    model: DPMPB, biases: dict[str, np.ndarray], losses: list[float], name: str, *, data: Path = DATA
) -> None:
    """Write a DPMPB, p of each material and its loss curve as `data/weights/dpmpb-NAME.safetensors`."""
    about = {
        "kind": "dpmpb",
        "state_size": model.state_size,
        "command_size": model.command_size,
        "bias_size": model.bias_size,
        "materials": list(biases),
    }
    p = torch.as_tensor(np.stack(list(biases.values())))
    _save_tensors(data / "weights" / f"dpmpb-{name}.safetensors", model, about, losses=torch.tensor(losses), p=p)


def load_dpmpb(name: str = "torque-0", *, data: Path = DATA) -> tuple[DPMPB, dict[str, np.ndarray], np.ndarray]:
    """Load a DPMPB.

    Args:
        name: which one; `torque-0` to `torque-4` are five trainings that differ in their seed alone.
        data: folder to look in.

    Returns:
        The model in evaluation mode, p of each material `{name: [D_p]}`, and the training loss of each epoch.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    about, tensors = _load_tensors("dpmpb", name, data)
    model = DPMPB(about["state_size"], about["command_size"], about["bias_size"])
    losses, p = tensors.pop("losses").numpy(), tensors.pop("p").numpy()
    model.load_state_dict(tensors)
    return model.eval(), dict(zip(about["materials"], p, strict=True)), losses


def save_target(mask: np.ndarray, name: str, *, data: Path = DATA) -> None:
    """Write a target mask `[H, W]` as `data/targets/NAME.png`."""
    with atomic_write(data / "targets" / f"{name}.png") as temporary:
        cv2.imwrite(str(temporary), check_mask(mask).astype(np.uint8) * 255)


def load_targets(*, data: Path = DATA) -> dict[str, np.ndarray]:
    """Load all target masks, `{name: [H, W]}`, bool.

    Raises:
        ValueError: as `load_target`.
    """
    names = sorted(path.stem for path in (data / "targets").glob("*.png"))
    return {name: load_target(name, data=data) for name in names}


def load_target(name: str, *, data: Path = DATA) -> np.ndarray:
    """Load a target mask `[H, W]`, bool.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file, or an image of another size or without a cloth.
    """
    path = _find("targets/*.png", "target", name, data)
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError(f"{path} is not a picture")
    return check_mask(picture > 127)


def save_results(results: dict[str, Any], name: str, *, data: Path = DATA) -> None:
    """Write measured results as `data/results/NAME.json`."""
    with atomic_write(data / "results" / f"{name}.json") as temporary:
        temporary.write_text(json.dumps(results, indent=1) + "\n")


def load_results(name: str = "simulation", *, data: Path = DATA) -> dict[str, Any]:
    """Load measured results.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    return json.loads(_find("results/*.json", "results", name, data).read_text())


def write_checksums(data: Path = DATA) -> None:
    """Record the hash of every file in `data/`, in `data/SHA256SUMS`."""
    with atomic_write(data / CHECKSUMS) as temporary:
        lines = [f"{sha256(path)}  {path.relative_to(data).as_posix()}\n" for path in _files(data)]
        temporary.write_text("".join(lines))


def check_data(data: Path = DATA) -> dict[str, str]:
    """Compare every file in `data/` with its recorded hash.

    Returns:
        `{file: "ok" | "missing" | "altered" | "not recorded"}`.
    """
    recorded = _checksums(data)
    present = {path.relative_to(data).as_posix() for path in _files(data)}
    verdict = {name: "missing" for name in recorded if name not in present}
    for name in sorted(present):
        if name not in recorded:
            verdict[name] = "not recorded"
        else:
            verdict[name] = "ok" if sha256(data / name) == recorded[name] else "altered"
    return verdict


def _files(data: Path) -> list[Path]:
    kept = {".npz", ".safetensors", ".png", ".json"}
    return sorted(
        path
        for path in data.rglob("*")
        if path.suffix in kept and not path.name.startswith(".") and data / OWN_TRIALS not in path.parents
    )


def _checksums(data: Path) -> dict[str, str]:
    path = data / CHECKSUMS
    if not path.exists():
        return {}
    return {name: digest for digest, name in (line.split(maxsplit=1) for line in path.read_text().splitlines())}


def _checked(path: Path, data: Path) -> Path:
    """Return `path` if its content is the one whose hash was recorded."""
    name = path.relative_to(data).as_posix()
    recorded = _checksums(data).get(name)
    if recorded is not None and sha256(path) != recorded:
        raise ValueError(
            f"data/{name} is damaged or was altered: restore it with `git checkout data/{name}`, "
            "or record a change you made with `python -m clothlab checksums`"
        )
    return path


def _find(pattern: str, kind: str, name: str, data: Path) -> Path:
    """The file in `data/` that matches the pattern `FOLDER/PREFIX*SUFFIX` with `name` in place of the star."""
    prefix, suffix = pattern.split("/")[-1].split("*")
    choices = {path.name.removeprefix(prefix).removesuffix(suffix): path for path in sorted(data.glob(pattern))}
    return _checked(choose(kind, name, choices, "(none yet: run `make data train`)"), data)


def _save_tensors(path: Path, model: torch.nn.Module, about: dict[str, Any], **extra: torch.Tensor) -> None:
    tensors = {name: tensor.contiguous() for name, tensor in model.state_dict().items()} | extra
    with atomic_write(path) as temporary:
        save_file(tensors, temporary, metadata={"clothlab": json.dumps(about)})


def _load_tensors(kind: str, name: str, data: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    path = _find(f"weights/{kind}-*.safetensors", f"{kind} weights", name, data)
    try:
        with safe_open(path, "pt") as file:
            return json.loads(file.metadata()["clothlab"]), {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is damaged or holds no {kind} weights: {error}") from error
