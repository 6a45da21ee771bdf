"""Recorded runs: their files, and what a model is trained on and plans with."""

import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from clothlab._files import reading, write_bytes
from clothlab._validation import check_number
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.data import Run
from clothlab.method.rollout import rollout
from clothlab.simulation.arm import arm_data, arm_from_data
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.trial import CONTROL_PERIOD, Trial

__all__ = ["Trial", "load_trial", "recorded_plans", "rollout", "save_trial", "to_run"]

_FORMAT = 1


def recorded_plans(
    recordings: Sequence[Trial] | Sequence[Run],
    horizon: int = 8,
    count: int = 200,
    *,
    seed: int = 0,
) -> np.ndarray:
    """Stretches of recorded commands, `[count, horizon, D_u]`, drawn at random."""
    check_number("count", count, int, at_least=1)
    check_number("horizon", horizon, int, at_least=1)
    commands = [_commands(each) for each in recordings]
    if not commands or min(map(len, commands)) < horizon:
        raise ValueError(
            f"plans of {horizon} steps need recordings that are at least as long"
        )

    # Every stretch of every recording, [N, D_u, horizon]
    stretches = np.concatenate(
        [sliding_window_view(each, horizon, axis=0) for each in commands]
    )

    # Each at most once, unless there are too few
    rng = np.random.default_rng(seed)
    too_few = len(stretches) < count
    chosen = rng.choice(len(stretches), count, replace=too_few)
    return stretches[chosen].transpose(0, 2, 1)


def _commands(recording: Trial | Run) -> np.ndarray:
    if isinstance(recording, Trial):
        return recording.commands
    if isinstance(recording, Run):
        return recording.u
    kind = type(recording).__name__
    raise ValueError(f"each of recordings is a Trial or a Run, got {kind}")


def to_run(autoencoder: Autoencoder, trial: Trial) -> Run:
    """States and commands of a recorded trial, encoded with this autoencoder."""
    z = encode(autoencoder, trial.images)
    return Run(
        np.concatenate([z, trial.robot], axis=1),
        trial.commands,
        trial.cloth.name,
        step=CONTROL_PERIOD,
        state_names=trial.arm.layout(autoencoder.latent_size).names,
        command_names=trial.arm.command_names,
    )


def save_trial(trial: Trial, path: str | Path, *, new: bool = False) -> None:
    """Write a trial as `.npz`, images as packed bits.

    An interrupted write leaves an existing file as it was. A `new` one is a
    FileExistsError where there is a file of this name.
    """
    if Path(path).suffix != ".npz":
        raise ValueError(f"a trial's file ends in .npz, got {str(path)!r}")

    # All but the arrays, as JSON
    about = {
        "format": _FORMAT,
        "cloth": asdict(trial.cloth),
        "arm": arm_data(trial.arm),
        "policy": trial.policy,
        "seed": trial.seed,
    }
    if trial.outcome:
        about["outcome"] = trial.outcome

    # The arrays, images eight pixels to a byte
    content = io.BytesIO()
    np.savez_compressed(
        content,
        images=np.packbits(trial.images, axis=-1),
        robot=trial.robot,
        commands=trial.commands,
        about=np.array(json.dumps(about)),
    )
    write_bytes(path, content.getvalue(), new=new)


def load_trial(path: str | Path) -> Trial:
    """Read a trial.

    A ValueError names the file if it is damaged, is no trial, or of another version.
    """
    with reading(path, "trial"):
        content = io.BytesIO(Path(path).read_bytes())
        with np.load(content, allow_pickle=False) as file:
            arrays = dict(file)
        about = json.loads(str(arrays["about"]))
        found = about.pop("format")
        if found != _FORMAT:
            raise ValueError(f"its format is {found}, this version reads {_FORMAT}")
        about["cloth"] = Cloth(**about["cloth"])
        about["arm"] = arm_from_data(about["arm"])
        images = np.unpackbits(arrays["images"], axis=-1).view(bool)
        return Trial(images, arrays["robot"], arrays["commands"], **about)
