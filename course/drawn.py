"""Widgets of notebooks on the web site, with figures that were drawn beforehand.

An executed notebook carries them as outputs (`clothlab/lab/_drawn.py`). On the site,
they lie beside the pages as scripts (`lab_page.py` says why), each loaded when a reader
touches its widget. Its controls are written here, as a template, which a page without
JavaScript does not show; `docs/book/lab/drawn.js` makes them move.
"""

import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import nbformat
import numpy as np

from clothlab._files import write_bytes
from clothlab.lab._drawn import MIME
from clothlab.lab._widget import javascript
from course.lab_page import sources, write_packed

PLACE = '<div class="drawn"'
_THINNED = (
    "These figures were drawn beforehand, so the controls have fewer stops here than "
    "in a running notebook."
)
# Where the arrow keys lead on a map
_ARROWS = {
    "ArrowLeft": (-1, 0),
    "ArrowRight": (1, 0),
    "ArrowUp": (0, 1),
    "ArrowDown": (0, -1),
}


def drawn_here(figures: Mapping[str, Any]) -> nbformat.NotebookNode:
    """The output behind a picture in whose place figures show where controls stand.

    It carries the figures on, for `write_figures`.
    """
    controls = [_known(control) for control in figures["controls"]]
    about = {"controls": controls, "sizes": figures["sizes"], "file": _name(figures)}
    named = 'role="group" aria-label="a figure with its controls"'
    place = f'{PLACE} {named} data-figure="{html.escape(json.dumps(about))}">'
    note = _THINNED if figures["thinned"] else ""
    text = f"{place}<template>{_layout(controls, note)}</template></div>"
    data = {"text/html": text, MIME: figures}
    return nbformat.v4.new_output("display_data", data)


def _known(control: Mapping[str, Any]) -> dict[str, Any]:
    """A control with what a page would else compute: of a map, names and ways."""
    if control["kind"] != "map":
        return dict(control)
    places = np.array(control["places"])
    ways = {key: _next(places, np.array(way)) for key, way in _ARROWS.items()}
    names = [_place_name(place, control["map"]) for place in control["places"]]
    return {**control, "names": names, "next": ways}


def _place_name(place: Sequence[float], shown: Mapping[str, Any]) -> str:
    """What is said of a place of a map: its dot, or where it lies."""
    for dot in shown["dots"]:
        if np.allclose(dot["at"], place, rtol=0, atol=1e-6) and dot["label"]:
            return str(dot["label"])
    pairs = zip(shown["axes"], place, strict=True)
    return ", ".join(f"{axis}: {value:.2f}" for axis, value in pairs)


def _next(places: np.ndarray, way: np.ndarray) -> list[int]:
    """For each place, the nearest one that lies at least as far along as beside.

    A place without one stays.
    """
    found = []
    for k, place in enumerate(places):
        gaps = places - place
        along = gaps @ way
        beside = np.abs(gaps @ way[::-1])
        far = np.where((along > 0) & (beside <= along), np.hypot(*gaps.T), np.inf)
        found.append(int(far.argmin()) if np.isfinite(far.min()) else k)
    return found


def _layout(controls: Sequence[Mapping[str, Any]], note: str) -> str:
    """The controls around the picture, which `drawn.js` puts beside the maps."""
    rows = [_row(control, k) for k, control in enumerate(controls)]
    kinds = [control["kind"] for control in controls]
    above = [row for row, kind in zip(rows, kinds, strict=True) if kind != "map"]
    beside = [row for row, kind in zip(rows, kinds, strict=True) if kind == "map"]
    lines = [*above, '<div class="beside">', *beside, "</div>"]
    lines += ['<p class="note" role="status"></p>', f'<p class="note">{note}</p>']
    return "".join(lines)


def _row(control: Mapping[str, Any], k: int) -> str:
    """A control as it stands at first."""
    at = f'data-control="{k}"'
    start = control["start"]
    names = [html.escape(name) for name in control["names"]]
    if control["kind"] == "map":
        return f'<div class="place" {at}><output></output></div>'
    label = html.escape(control["label"])
    if control["kind"] == "menu":
        options = "".join(
            f'<option value="{i}"{" selected" * (i == start)}>{name}</option>'
            for i, name in enumerate(names)
        )
        return f"<label {at}><span>{label}</span><select>{options}</select></label>"
    # Its name is without the value, which the label around both would have in it
    said = f'aria-label="{label}" aria-valuetext="{names[start]}"'
    ends = f'min="0" max="{len(names) - 1}" value="{start}"'
    slider = f'<input type="range" {ends} {said}>'
    value = f"<output>{names[start]}</output>"
    return f"<label {at}><span>{label}</span>{slider}{value}</label>"


def write_figures(page: nbformat.NotebookNode, folder: Path) -> None:
    """Take figures out of the outputs that carry them, and write them into a folder."""
    for cell in page.cells:
        for output in cell.get("outputs", []):
            if figures := output.get("data", {}).pop(MIME, None):
                name = _name(figures)
                content = json.dumps([*map(_shown, figures["figures"])]).encode()
                write_packed(folder / f"{name}.js", {name: content})


def _shown(figure: Mapping[str, Any]) -> dict[str, Any]:
    """A figure, and HTML for what is said of it beyond a sentence."""
    details = "".join(f"<p>{html.escape(text)}</p>" for text in figure["details"])
    return {**figure, "details": details}


def write_controls(folder: Path) -> None:
    """Write the script of the controls into a folder."""
    script = "\n".join([javascript("text", "map"), sources("files", "drawn")])
    write_bytes(folder / "drawn.js", f"(() => {{\n{script}}})();\n".encode())


def _name(figures: Mapping[str, Any]) -> str:
    """A name that no other figures have."""
    return hashlib.sha256(json.dumps(figures).encode()).hexdigest()[:16]
