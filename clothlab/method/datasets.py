"""Runs of datasets that others have recorded, in the formats of Minari and LeRobot.

Neither library is imported: an episode of Minari has arrays, and LeRobot's files are
Parquet and JSON.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_number
from clothlab.method._inputs import SHORTEST, long_enough
from clothlab.method._log_files import read_parquet
from clothlab.method._table import stretches
from clothlab.method.data import Run


def runs_from_minari(
    dataset: Iterable[Any],
    material: str | Callable[[Any], str],
    *,
    observe: Callable[[Any], ArrayLike] | None = None,
    step: float | None = None,
    shortest: int = SHORTEST,
) -> list[Run]:
    """Make a run of each episode of a Minari dataset.

    An episode has one observation more than it has actions. It is kept, since it is
    what the last action led to: the run has as many states as there are observations,
    and its last command repeats the one before. Nothing is ever predicted from that
    one, in training and estimation alike.

    Args:
        dataset: `minari.load_dataset(name)`, or some of its episodes.
        material: Name of what stays the same in all episodes, or a function of an
            episode that says it.
        observe: Makes the state `[D_s]` of one observation. Without it, the observation
            is the state, and has to be a vector.
        step: Between two states [s], for runs that are to know it.
        shortest: Runs of fewer steps are left out, and a warning counts them.

    Raises:
        ValueError: An observation is no vector, actions are discrete, or no run is long
            enough.
    """
    check_number("shortest", shortest, int, at_least=1)
    runs: list[Run] = []
    for episode in dataset:
        # What was observed, and what was done
        name = f"episode {getattr(episode, 'id', len(runs))}"
        s = _states_of(episode.observations, observe, name)
        u = _commands_of(episode.actions, name)
        if len(s) != len(u) + 1 or not len(u):
            raise ValueError(
                f"{name} has {len(s)} observations and {len(u)} actions: one "
                "observation more than actions, and some, are needed"
            )

        # One command more, for the last state
        u = np.concatenate([u, u[-1:]])
        told = material if isinstance(material, str) else material(episode)
        runs.append(Run(s, u, told, step=step))
    return long_enough(_some(runs), shortest)


def _states_of(
    observations: Any, observe: Callable[[Any], ArrayLike] | None, name: str
) -> np.ndarray:
    """The states `[T + 1, D_s]` of an episode's observations."""
    if observe is not None:
        every = [observe(each) for each in _one_by_one(observations)]
        return np.stack([np.array(each, ndmin=1) for each in every])
    if isinstance(observations, dict | tuple):
        parts = ", ".join(observations) if isinstance(observations, dict) else "a tuple"
        raise ValueError(
            f"observations of {name} have several parts, {parts}: say which are the "
            "state, such as with observe=lambda seen: seen['observation']"
        )
    s = np.asarray(observations)
    if s.ndim != 2 or s.dtype.kind not in "fiu":
        raise ValueError(
            f"observations of {name} are {s.dtype} of shape {list(s.shape)}, and "
            "states are vectors of numbers: make one with `observe`. A picture needs "
            "an autoencoder first"
        )
    return s


def _one_by_one(observations: Any) -> list[Any]:
    """Observations of several parts, in each of which time comes first."""
    if isinstance(observations, dict):
        parts = [_one_by_one(each) for each in observations.values()]
        pairs = zip(*parts, strict=True)
        return [dict(zip(observations, each, strict=True)) for each in pairs]
    if isinstance(observations, tuple):
        return list(zip(*map(_one_by_one, observations), strict=True))
    return list(observations)


def _commands_of(actions: Any, name: str) -> np.ndarray:
    """The commands `[T, D_u]` of an episode."""
    if isinstance(actions, dict | tuple):
        raise ValueError(
            f"actions of {name} have several parts, and a command is one vector of "
            "real numbers"
        )
    u = np.asarray(actions)
    if u.dtype.kind != "f":
        raise ValueError(
            f"actions of {name} are discrete ({u.dtype}): the model needs commands "
            "that are real numbers, which can follow a gradient"
        )
    return u


def runs_from_lerobot(
    dataset: Any,
    material: str | Callable[[int, str], str] | None = None,
    *,
    states: Sequence[str] = ("observation.state",),
    commands: Sequence[str] = ("action",),
    shortest: int = SHORTEST,
) -> list[Run]:
    """Make a run of each episode of a LeRobot dataset, format 2 or 3.

    A frame has an observation and the action that was sent then, so that a run has a
    step for each frame. It knows its step, and the names that the dataset has.

    Args:
        dataset: The folder in which `meta` and `data` lie, or a `LeRobotDataset`.
        material: Name of what stays the same in all episodes; a function of an
            episode's number and of its task that says it; by default its task.
        states: Features that make the state `[D_s]`, one after the other.
        commands: Features that make the command `[D_u]`.
        shortest: Runs of fewer steps are left out, and a warning counts them.

    Raises:
        KeyError: The dataset has no such feature.
        ValueError: It is of another format, a feature is a picture, or no run is long
            enough.
    """
    check_number("shortest", shortest, int, at_least=1)
    folder = dataset if isinstance(dataset, str | Path) else dataset.root
    root = Path(folder)
    about = _about_lerobot(root)
    names = {
        "state_names": _feature_names(about, states),
        "command_names": _feature_names(about, commands),
    }
    tasks = _tasks_of(root)

    # A file holds many episodes, or one; none lies in two files.
    columns = [*states, *commands, "episode_index", "task_index"]
    runs = []
    for path in sorted((root / "data").rglob("*.parquet")):
        table = read_parquet(path, columns)
        s = _features(table, states)
        u = _features(table, commands)
        numbers = table["episode_index"].to_numpy()
        which = table["task_index"].to_numpy()
        for rows in stretches(numbers):
            task = tasks.get(int(which[rows][0]), "")
            told = _material_of(int(numbers[rows][0]), task, material)
            run = Run(s[rows], u[rows], told, step=1 / about["fps"], **names)
            runs.append(run)
    return long_enough(_some(runs), shortest)


def _material_of(
    episode: int, task: str, material: str | Callable[[int, str], str] | None
) -> str:
    if material is None:
        return task
    return material if isinstance(material, str) else material(episode, task)


def _about_lerobot(root: Path) -> dict[str, Any]:
    """What a dataset says of itself; a ValueError for another format."""
    path = root / "meta" / "info.json"
    if not path.exists():
        raise FileNotFoundError(f"{root} is no LeRobot dataset: it has no {path}")
    about = json.loads(path.read_text("utf-8"))
    version = str(about.get("codebase_version", "?"))
    if not version.startswith(("v2.", "v3.")):
        raise ValueError(
            f"{root} has LeRobot's format {version}, and v2 and v3 are known"
        )
    return about


def _feature_names(about: dict[str, Any], features: Sequence[str]) -> tuple[str, ...]:
    """The names of their numbers, or those of the features, counted."""
    names: list[str] = []
    known = about["features"]
    for feature in features:
        if feature not in known:
            listed = ", ".join(known)
            raise KeyError(f"no feature {feature!r}; choose from {listed}")
        shape = known[feature]["shape"]
        if len(shape) != 1:
            raise ValueError(
                f"{feature} has the shape {list(shape)}, and a state is made of "
                "vectors. A picture needs an autoencoder first"
            )
        names += _names_of_one(feature, known[feature].get("names"), shape[0])
    return tuple(names)


def _names_of_one(feature: str, names: Any, size: int) -> list[str]:
    # Some datasets have them by group, such as {"motors": [...]}.
    if isinstance(names, dict):
        groups = [each for each in names.values() if isinstance(each, list)]
        names = [name for group in groups for name in group]
    if names and len(names) == size:
        return [str(name) for name in names]
    return [f"{feature}[{k}]" for k in range(size)]


def _tasks_of(root: Path) -> dict[int, str]:
    """What each task is, in words; of format 3 in Parquet, of format 2 in JSON."""
    path = root / "meta" / "tasks.parquet"
    if path.exists():
        columns = read_parquet(path).to_pydict()
        numbers = columns.pop("task_index")
        (words,) = columns.values()
        return dict(zip(numbers, words, strict=True))
    path = path.with_suffix(".jsonl")
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    tasks = [json.loads(line) for line in lines]
    return {task["task_index"]: task["task"] for task in tasks}


def _features(table: Any, features: Sequence[str]) -> np.ndarray:
    """Numbers of some features, one after the other, `[R, D]`."""
    parts = []
    for feature in features:
        # Of a single number, the column holds no lists.
        values = np.array(table[feature].to_pylist(), np.float32)
        parts.append(values.reshape(len(values), -1))
    return np.concatenate(parts, axis=1)


def _some(runs: list[Run]) -> list[Run]:
    if not runs:
        raise ValueError("the dataset has no episodes")
    return runs
