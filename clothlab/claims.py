"""A claim is a condition on a figure. The last cell of a notebook states its
**Findings** as such.

A condition is a number made of arrays, and its bounds. It is checked on what is stored
from a full-size run, and on the live run where that has the full size. To show that it
can fail, it is fed noise, most of which it must refuse.
"""

import contextlib
import json
import os
import re
import warnings
from collections.abc import Callable
from operator import ge, gt, le, lt
from typing import Any

import numpy as np

from clothlab._files import reading
from clothlab._store import Folder, load_results, save_results

# Environment variable: live figures are stored, as `make findings` does
RECORD = "CLOTHLAB_RECORD_FINDINGS"
# Of noise, and the smallest share of them that a condition must refuse
_DRAWS, _REFUSED = (40, 0.25)
_SYMBOLS = {
    "at_least": ("≥", ge),
    "above": (">", gt),
    "at_most": ("≤", le),
    "below": ("<", lt),
}
_Figure = Callable[..., Any]


class ClaimError(AssertionError):
    """A claim that does not hold, or cannot fail; the text says which, with its figure
    and its bounds.
    """


class Findings:
    """The claims of one notebook, by its file's name without the ending, and the
    figures stored of a full-size run.

    `parameters` are those of the notebook that say how large its live runs are: live
    claims are checked on the live run where these are as stored.
    """

    def __init__(self, notebook: str, *, data: Folder = None, **parameters: Any):
        self.name, self._data = f"findings-{notebook}", data
        self.parameters = _plain(parameters)
        self.recording = bool(os.environ.get(RECORD))
        stored: dict[str, Any] = {"parameters": None, "figures": {}}
        if not self.recording:
            with contextlib.suppress(
                KeyError
            ):  # nothing was recorded yet; claims about stored tables need nothing
                stored = self._load()
        self._figures: dict[str, dict[str, Any]] = stored["figures"]
        self.full_size = self.recording or stored["parameters"] == self.parameters

    def stored(self, claim: str, figure: _Figure, /, **given: Any) -> None:
        """Check a claim about a stored table, such as that of an experiment.

        Args:
            claim: what is claimed, a sentence.
            figure: a function of the arrays, which returns a number.
            given: the bounds, `at_least`, `above`, `at_most`, `below`, one or two of
                them; all others are arrays.
        """
        bounds, arrays = _sorted_out(claim, given)
        _must_refuse_noise(claim, figure, bounds, arrays)
        _must_hold(claim, "stored", figure, bounds, arrays)

    def live(self, claim: str, figure: _Figure, /, **given: Any) -> None:
        """Check a claim about what was measured in this notebook: on the stored
        figures, and here at full size.
        """
        bounds, arrays = _sorted_out(claim, given)
        if self.recording:
            self._figures[claim] = {
                name: _plain(array) for name, array in arrays.items()
            }
            self._save()
        if claim not in self._figures:
            raise ClaimError(
                f"nothing is stored for the claim {claim!r}: run `make findings RECORD=1`"
            )
        before = {
            name: np.asarray(array) for name, array in self._figures[claim].items()
        }
        _must_refuse_noise(claim, figure, bounds, before)
        _must_hold(claim, "stored", figure, bounds, before)
        if self.full_size:
            _must_hold(claim, "here", figure, bounds, arrays)

    def _load(self) -> dict[str, Any]:
        content = load_results(self.name, ".json", data=self._data)
        with reading(
            f"data/results/{self.name}.json",
            "findings; record them with `make findings RECORD=1`",
        ):
            stored = json.loads(content)
            return {name: stored[name] for name in ("parameters", "figures")}

    def _save(self) -> None:
        stored = {"format": 1, "parameters": self.parameters, "figures": self._figures}
        text = json.dumps(stored, indent=1, allow_nan=False)
        # a row of numbers on one line
        text = re.sub(r'\[[^][{}"]*\]', lambda row: " ".join(row[0].split()), text)
        save_results(text.encode() + b"\n", self.name, ".json", data=self._data)


def _sorted_out(
    claim: str, given: dict[str, Any]
) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    bounds = {name: value for name, value in given.items() if name in _SYMBOLS}
    arrays = {
        name: np.asarray(value) for name, value in given.items() if name not in _SYMBOLS
    }
    if not bounds or not arrays:
        raise ValueError(
            f"the claim {claim!r} needs a bound ({', '.join(_SYMBOLS)}) and arrays by name"
        )
    return bounds, arrays


def _holds(value: float, bounds: dict[str, float]) -> bool:
    return all(_SYMBOLS[name][1](value, bound) for name, bound in bounds.items())


def _must_hold(
    claim: str,
    where: str,
    figure: _Figure,
    bounds: dict[str, float],
    arrays: dict[str, np.ndarray],
) -> None:
    value = float(figure(**arrays))
    wanted = " and ".join(
        f"{_SYMBOLS[name][0]} {bound:.4g}" for name, bound in bounds.items()
    )
    if not _holds(value, bounds):
        raise ClaimError(
            f"this does not hold: {claim}\n  {where}: {value:.4g}, claimed: {wanted}"
        )
    print(f"✓ {claim}: {value:.3g} {where} ({wanted})")


def _must_refuse_noise(
    claim: str, figure: _Figure, bounds: dict[str, float], arrays: dict[str, np.ndarray]
) -> None:
    rng, passed = np.random.default_rng(0), 0
    for _ in range(_DRAWS):
        noise = {name: _noise(rng, array) for name, array in arrays.items()}
        # Noise may make anything fail; a figure that cannot be computed supports no
        # claim.
        with (
            np.errstate(all="ignore"),
            warnings.catch_warnings(action="ignore"),
            contextlib.suppress(Exception),
        ):
            passed += _holds(float(figure(**noise)), bounds)
    if passed > (1 - _REFUSED) * _DRAWS:
        raise ClaimError(
            f"this condition can hardly fail: {claim}\n  noise passes it in {passed} of {_DRAWS} draws"
        )


def _noise(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    """An array of the same shape and kind that knows nothing: another size, another
    offset, or the order lost.
    """
    if array.dtype.kind not in "iuf":
        return rng.choice(
            np.unique(array) if array.dtype.kind != "b" else [False, True], array.shape
        )
    if rng.random() < 0.1 and array.size > 1:
        return rng.permutation(array.ravel()).reshape(array.shape)
    size = float(np.sqrt(np.mean(np.square(array, dtype=float)))) or 1.0
    return (
        size
        * 10 ** rng.uniform(-0.5, 1.5)
        * (rng.normal(size=array.shape) + rng.choice([-1, 0, 1]))
    )


def _plain(value: Any) -> Any:
    """As JSON has it."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return np.asarray(value).tolist()
