"""Figures that a `Control` draws beforehand, for pages on which no kernel answers.

The site is made of notebooks that were executed. Where the environment asks for it, a
`Control` that is shown draws, by the notebook's own function, a grid of what its
controls can choose, and the page shows the figure that belongs to where they stand.
"""

import base64
import os
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from math import isqrt, prod
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from clothlab._alt_text import describe
from clothlab.lab._map import PBMap
from clothlab.lab._pictures import compact, encoded

# In the environment of a kernel: how many figures a Control draws, at most. Where menus
# and the fewest stops of the others are more, it draws none.
MOST = "CLOTHLAB_FIGURES"
MIME = "application/vnd.clothlab.figures+json"
_LEAST = 3  # stops of a slider: both ends, and its start
_SIDE = 41  # places along a side of a map, one for each press of an arrow key


class Axis(NamedTuple):
    """The choices of a control for which figures are drawn."""

    values: list[Any]  # what `draw` takes
    about: dict[str, Any]  # what the page shows
    thinned: bool  # whether the notebook's control has more choices


def asked_for() -> int:
    """How many figures this kernel is to draw for each Control, at most."""
    return int(os.environ.get(MOST, "0"))


def drawn(draw: Callable[..., Figure], axes: Mapping[str, Axis]) -> dict[str, Any]:
    """All figures of a grid with their words, in the order of `product`; plain data."""
    figures = []
    for values in product(*(axis.values for axis in axes.values())):
        figure = draw(**dict(zip(axes, values, strict=True)))
        words = describe(figure)
        picture = base64.b64encode(compact(encoded(figure))).decode()
        plt.close(figure)
        about = {"alt": words.summary, "details": list(words.details)}
        figures.append({"picture": picture, **about})
    return {
        "controls": [axis.about for axis in axes.values()],
        "sizes": [len(axis.values) for axis in axes.values()],
        "thinned": any(axis.thinned for axis in axes.values()),
        "figures": figures,
    }


def grid(
    controls: Mapping[str, Any],
    starts: Mapping[str, Any],
    labels: Mapping[str, str],
    most: int,
) -> dict[str, Axis]:
    """What each control can choose, thinned to `most` figures; empty if it can't be.

    A menu keeps all of its choices, and each slider and map the same share of its own.

    Args:
        controls: choices of each control, as `Control` takes them.
        starts: where each begins.
        labels: what stands beside it.
        most: figures to draw, at most.
    """
    for share in np.linspace(1, 0, 101):
        axes = {}
        for name, choices in controls.items():
            if isinstance(choices, PBMap):
                axes[name] = _map(choices, _stops(_SIDE, share) ** 2)
            elif isinstance(choices, tuple):
                every = slider_choices(choices, starts[name])
                axes[name] = _slider(labels[name], every, starts[name], share)
            else:
                axes[name] = _menu(labels[name], choices, starts[name])
        if prod(len(axis.values) for axis in axes.values()) <= most:
            return axes
    return {}


def slider_choices(choices: tuple[Any, Any, Any], start: Any) -> list[Any]:
    """All that a slider can choose, in order; its start is one of them."""
    low, high, step = choices
    count = int((high - low) / step + 1e-9)
    steps = [round(low + k * step, 9) for k in range(count + 1)]
    return sorted({*steps, high, start})


def thinned(count: int, stops: int, start: int) -> list[int]:
    """Which of so many choices a slider with fewer stops keeps, by their indices.

    They are evenly spread, but both ends and the start are among them.
    """
    kept = np.linspace(0, count - 1, stops).round().astype(int)
    inner = kept[1:-1]
    if start not in kept:
        inner[np.abs(inner - start).argmin()] = start
    return sorted({*kept.tolist()})


def places(
    about: Mapping[str, Any], start: Sequence[float], most: int
) -> list[list[float]]:
    """About so many places of a map: its start, its dots, and a lattice between them.

    Args:
        about: what the map shows.
        start: where it begins.
        most: places, unless the dots are more.
    """
    kept = [list(start)]
    kept += [dot["at"] for dot in about["dots"] if not np.allclose(dot["at"], start)]
    rows = isqrt(max(0, most - len(kept)))
    if rows < 2:
        return kept

    # Centres of squares, where no dot is near
    half = about["reach"] / rows
    along = half * (2 * np.arange(rows) + 1 - rows)
    lattice = np.array([*product(along, repeat=2)])
    away = np.linalg.norm(lattice[:, None] - np.array(kept), axis=-1).min(axis=1)
    return kept + lattice[away > half].tolist()


def _stops(count: int, share: float) -> int:
    return max(round(share * count), min(count, _LEAST))


def _slider(label: str, choices: Sequence[Any], start: Any, share: float) -> Axis:
    first = choices.index(start)
    kept = thinned(len(choices), _stops(len(choices), share), first)
    values = [choices[k] for k in kept]
    names = [str(x) if isinstance(x, int) else f"{x:.2f}" for x in values]
    about = {"kind": "slider", "label": label, "names": names}
    return Axis(values, about | {"start": kept.index(first)}, len(kept) < len(choices))


def _menu(label: str, choices: Sequence[Any], start: Any) -> Axis:
    pairs = [each if isinstance(each, tuple) else (each, each) for each in choices]
    values = [value for _, value in pairs]
    names = [str(name) for name, _ in pairs]
    about = {"kind": "menu", "label": label, "names": names}
    return Axis(values, about | {"start": values.index(start)}, thinned=False)


def _map(pb_map: PBMap, most: int) -> Axis:
    found = places(pb_map.about, pb_map.chosen, most)
    about = {"kind": "map", "map": pb_map.about, "places": found, "start": 0}
    return Axis([*pb_map.at(found)], about, thinned=True)
