"""What you make in one notebook and take up in the next, in the folder `mine/`.

`mine.autoencoder()` is the one that you trained in 03, `mine.checkpoint()` your model
of 04 with it, `mine.functions("controller")` what you wrote in 07. Where nothing of
yours is there, the stored one takes its place, and a printed line says so.

The folder lies beside `notebooks/`; the environment variable `CLOTHLAB_MINE` names
another one. Where it is empty, nothing is kept: so notebooks run in tests. Where the
folder cannot be written, a printed line says so, and the notebook goes on.
"""

import ast
import inspect
import json
import linecache
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

from clothlab import data, weights
from clothlab._files import write_bytes
from clothlab.method.autoencoder import Autoencoder
from clothlab.weights import ClothCheckpoint

# The paper's amount of recordings, as a reader's own have
STORED = "torque-paper-0"


def folder() -> Path | None:
    """The folder, or None where nothing is kept."""
    named = os.environ.get("CLOTHLAB_MINE")
    if named == "":
        return None
    own = named or Path(__file__).resolve().parents[1] / "mine"
    return Path(own).expanduser()


def keep_checkpoint(checkpoint: ClothCheckpoint) -> None:
    """Keep your model, with p of each cloth and the autoencoder that it goes with."""
    _keep("checkpoint.safetensors", checkpoint.save)


def checkpoint() -> ClothCheckpoint:
    """Your model of 04, or the stored one."""
    path = _found("checkpoint.safetensors", "model (04)", f"the stored {STORED}")
    return data.load(STORED if path is None else path)


def keep_autoencoder(autoencoder: Autoencoder) -> None:
    """Keep your autoencoder."""
    _keep(
        "autoencoder.safetensors",
        lambda path: weights.save_autoencoder(autoencoder, [], path),
    )


def autoencoder() -> Autoencoder:
    """Your autoencoder of 03, in evaluation mode, or the stored one."""
    path = _found("autoencoder.safetensors", "autoencoder (03)", f"that of {STORED}")
    if path is None:
        return data.load(STORED).autoencoder
    own, _ = weights.load_autoencoder(path)
    return own


def keep_functions(name: str, *made: Callable, imports: str) -> None:
    """Keep functions and classes of yours as a file of Python.

    Args:
        name: of the file, without `.py`.
        made: in the order in which they are defined.
        imports: the lines of import that they need.
    """
    parts = [imports.strip(), *(_source(each).strip() for each in made)]
    content = "\n\n\n".join(parts) + "\n"
    _keep(f"{name}.py", lambda path: write_bytes(path, content.encode()))


def functions(name: str) -> SimpleNamespace | None:
    """What you kept with `keep_functions`, by its names; None if there is nothing."""
    path = _found(f"{name}.py", name, "the package's")
    if path is None:
        return None
    namespace: dict[str, object] = {"__name__": f"mine.{name}"}
    exec(compile(path.read_text("utf-8"), str(path), "exec"), namespace)
    return SimpleNamespace(**namespace)


def note(what: str, **numbers: float) -> None:
    """Add a line to your log, or change the one that is there."""
    plain = {name: float(number) for name, number in numbers.items()}
    content = json.dumps(log() | {what: plain}, indent=1)
    _keep("log.json", lambda path: write_bytes(path, content.encode()))


def log() -> dict[str, dict[str, float]]:
    """Your log: `{what: {name: number}}`, in the order in which it was noted."""
    path = _place("log.json")
    if path is None or not path.exists():
        return {}
    return json.loads(path.read_text("utf-8"))


def _source(made: Callable) -> str:
    """The code of a function, or of a class with methods, also of a notebook's cell."""
    if not inspect.isclass(made):
        return inspect.getsource(made)

    # Python looks for a class in a file of its module: a notebook has none
    method = next(filter(inspect.isfunction, vars(made).values()))
    cell = "".join(linecache.getlines(method.__code__.co_filename))
    for node in ast.parse(cell).body:
        if isinstance(node, ast.ClassDef) and node.name == made.__name__:
            return ast.get_source_segment(cell, node) or ""
    raise ValueError(f"the code of {made.__name__} is not there: run its cell again")


def _keep(name: str, write: Callable[[Path], object]) -> None:
    """Write a file, or print a line where none can be written."""
    path = _place(name)
    if path is None:
        return
    try:
        write(path)
    except OSError as error:
        print(
            f"not kept, {error.strerror}: {error.filename}. Set CLOTHLAB_MINE to a "
            "folder where you may write, as in `CLOTHLAB_MINE=~/mine make lab`"
        )


def _place(name: str) -> Path | None:
    """Where a file goes; None where nothing is kept."""
    own = folder()
    return None if own is None else own / name


def _found(name: str, what: str, stored: str) -> Path | None:
    """A file of yours, or None with a printed line."""
    path = _place(name)
    if path is not None and path.exists():
        print(f"your own {what}, from {path.parent.name}/{name}")
        return path
    print(f"no {what} of your own in mine/: {stored} takes its place")
    return None
