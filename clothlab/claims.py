"""A claim is a condition on a figure: so a notebook's last cell states its Findings.

A condition is a number made of arrays, and its bounds. It is checked on what is stored
from a full-size run, and on the live run where that has the full size. To show that it
can fail, it is fed noise, most of which it must refuse.
"""

import contextlib
import html
import inspect
import json
import os
import re
import warnings
from collections.abc import Callable
from operator import ge, gt, le, lt
from typing import Any

import IPython
import numpy as np
from IPython.display import DisplayHandle, display

from clothlab._files import reading, write_bytes
from clothlab.data import Folder, data_folder

_DRAWS = 40  # of noise
_REFUSED = 0.25  # the smallest share of them that a condition must refuse
_SYMBOLS = {
    "at_least": ("≥", ge),
    "above": (">", gt),
    "at_most": ("≤", le),
    "below": ("<", lt),
}
_Figure = Callable[..., Any]


class ClaimError(AssertionError):
    """A claim that does not hold, or cannot fail.

    The text says which, with its figure and its bounds.
    """


class Findings:
    """The claims of one notebook, and the figures stored of a full-size run.

    Args:
        notebook: its file's name without the ending.
        data: folder of the stored figures; by default that of `clothlab.data`.
        parameters: those of the notebook that say how large its live runs are: live
            claims are checked on the live run where these are as stored.
    """

    # Environment variable: live figures are stored, as `make findings` does
    RECORD = "CLOTHLAB_RECORD_FINDINGS"

    def __init__(self, notebook: str, *, data: Folder = None, **parameters: Any):
        self.name = f"findings-{notebook}"
        self._path = data_folder(data) / "results" / f"{self.name}.json"
        self.parameters = _plain(parameters)
        self.recording = bool(os.environ.get(self.RECORD))
        self._held = _Held()
        self._shown: DisplayHandle | None = None

        stored: dict[str, Any] = {"parameters": None, "figures": {}}
        if not self.recording:
            # Where nothing was recorded yet, claims about stored tables need nothing
            with contextlib.suppress(FileNotFoundError):
                stored = self._load()
        self._figures: dict[str, dict[str, Any]] = stored["figures"]
        self.full_size = self.recording or stored["parameters"] == self.parameters

    def stored(self, claim: str, figure: _Figure, /, **given: Any) -> None:
        """Check a claim about a stored table, such as that of an experiment.

        Args:
            claim: what is claimed, a sentence.
            figure: a function of the arrays, which returns a number.
            given: the bounds, `at_least`, `above`, `at_most`, `below`, one or two of
                them; all others are arrays, by the names that the figure has for them.
        """
        bounds, arrays = _sorted_out(claim, figure, given)
        _must_refuse_noise(claim, figure, bounds, arrays)
        self._tell(_must_hold(claim, "stored", figure, bounds, arrays))

    def live(self, claim: str, figure: _Figure, /, **given: Any) -> None:
        """Check a claim about what was measured in this notebook.

        It is checked on the stored figures, and here at full size. The arguments are
        those of `stored`.
        """
        bounds, arrays = _sorted_out(claim, figure, given)
        if self.recording:
            figures = {name: _plain(array) for name, array in arrays.items()}
            self._figures[claim] = figures
            self._save()
        if claim not in self._figures:
            raise ClaimError(
                f"nothing is stored for the claim {claim!r}: "
                "run `make findings RECORD=1`"
            )

        # Once as recorded, and once as measured now
        recorded = self._figures[claim].items()
        before = {name: np.asarray(array) for name, array in recorded}
        _must_refuse_noise(claim, figure, bounds, before)
        self._tell(_must_hold(claim, "stored", figure, bounds, before))
        if self.full_size:
            self._tell(_must_hold(claim, "here", figure, bounds, arrays))

    def _tell(self, line: str) -> None:
        """Show one more condition that holds: in a notebook, all of them in one box."""
        self._held.lines.append(line)
        if not hasattr(IPython.get_ipython(), "kernel"):
            print(line)
        elif self._shown is None:
            self._shown = display(self._held, display_id=True)
        else:
            self._shown.update(self._held)

    def _load(self) -> dict[str, Any]:
        kind = "findings; record them with `make findings RECORD=1`"
        with reading(self._path, kind):
            stored = json.loads(self._path.read_bytes())
            return {name: stored[name] for name in ("parameters", "figures")}

    def _save(self) -> None:
        stored = {"format": 1, "parameters": self.parameters, "figures": self._figures}
        text = json.dumps(stored, indent=1, allow_nan=False)
        # A row of numbers on one line
        text = re.sub(r'\[[^][{}"]*\]', lambda row: " ".join(row[0].split()), text)
        write_bytes(self._path, text.encode() + b"\n")


class _Held:
    """The conditions that hold: in a notebook how many, and folded which."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __repr__(self) -> str:
        return "\n".join(self.lines)

    def _repr_html_(self) -> str:
        summary = f"✓ {len(self.lines)} conditions of the Findings hold"
        lines = html.escape(repr(self))
        return f"<details><summary>{summary}</summary><pre>{lines}</pre></details>"


def _sorted_out(
    claim: str, figure: _Figure, given: dict[str, Any]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """The bounds and the arrays among the arguments of a claim.

    An array can't have the name of a bound: it would be taken for one.
    """
    # By the names that bounds have
    bounds = {}
    arrays = {}
    for name, value in given.items():
        if name in _SYMBOLS:
            bounds[name] = value
        else:
            arrays[name] = np.asarray(value)

    # Neither may pass for the other, and both are needed
    for name in _SYMBOLS:
        if name in _parameters(figure) or np.ndim(bounds.get(name, 0)):
            raise ValueError(
                f"the claim {claim!r}: {name} is a bound, one number, so that an array "
                "needs another name"
            )
    if not bounds or not arrays:
        raise ValueError(
            f"the claim {claim!r} needs a bound ({', '.join(_SYMBOLS)}) "
            "and arrays by name"
        )
    return bounds, arrays


def _parameters(figure: _Figure) -> list[str]:
    """Names of what a figure is made of, where they are known."""
    try:
        return list(inspect.signature(figure).parameters)
    except ValueError:  # a built-in
        return []


def _holds(value: float, bounds: dict[str, float]) -> bool:
    for name, bound in bounds.items():
        _, compare = _SYMBOLS[name]
        if not compare(value, bound):
            return False
    return True


def _must_hold(
    claim: str,
    where: str,
    figure: _Figure,
    bounds: dict[str, float],
    arrays: dict[str, np.ndarray],
) -> str:
    """What is said of a condition that holds; else raise."""
    value = float(figure(**arrays))
    wanted = " and ".join(
        f"{_SYMBOLS[name][0]} {bound:.4g}" for name, bound in bounds.items()
    )
    if not _holds(value, bounds):
        raise ClaimError(
            f"this does not hold: {claim}\n  {where}: {value:.4g}, claimed: {wanted}"
        )
    return f"✓ {claim}: {value:.3g} {where} ({wanted})"


def _must_refuse_noise(
    claim: str, figure: _Figure, bounds: dict[str, float], arrays: dict[str, np.ndarray]
) -> None:
    """Raise unless the claim fails where its arrays know nothing."""
    rng = np.random.default_rng(0)
    passed = 0
    for _ in range(_DRAWS):
        noise = {name: _noise(rng, array) for name, array in arrays.items()}
        passed += _passes(figure, bounds, noise)
    if passed > (1 - _REFUSED) * _DRAWS:
        raise ClaimError(
            f"this condition can hardly fail: {claim}\n"
            f"  noise passes it in {passed} of {_DRAWS} draws"
        )


def _passes(
    figure: _Figure, bounds: dict[str, float], noise: dict[str, np.ndarray]
) -> bool:
    """Whether noise fulfils the condition.

    It may make anything fail; a figure that cannot be computed supports no claim.
    """
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        try:
            return _holds(float(figure(**noise)), bounds)
        except Exception:
            return False


def _noise(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """An array of the same shape and kind that knows nothing.

    It has another size, another offset, or the order lost.
    """
    # Names, and what is true or false
    if array.dtype.kind not in "iuf":
        choices = [False, True] if array.dtype.kind == "b" else np.unique(array)
        return rng.choice(choices, array.shape)

    # Numbers: the same in another order
    if rng.random() < 0.1 and array.size > 1:
        return rng.permutation(array.ravel()).reshape(array.shape)

    # Or others, up to thirty times as large, around zero or away from it
    size = float(np.sqrt(np.mean(np.square(array, dtype=float)))) or 1.0
    scale = size * 10 ** rng.uniform(-0.5, 1.5)
    scatter = rng.normal(size=array.shape)
    offset = rng.choice([-1, 0, 1])
    return scale * (scatter + offset)


def _plain(value: Any) -> Any:
    """As JSON has it."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return np.asarray(value).tolist()
