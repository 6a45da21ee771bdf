"""Widgets of notebooks on the web site, with figures that were drawn beforehand.

An executed notebook carries them as outputs (`clothlab/lab/_drawn.py`). On the site,
they lie beside the pages as scripts (`lab_page.py` says why), each loaded when a reader
touches its widget, whose controls `docs/book/lab/drawn.js` makes.
"""

import hashlib
import html
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import nbformat

from clothlab._files import write_bytes
from clothlab.lab._drawn import MIME
from clothlab.lab._widget import javascript
from course.lab_page import sources, write_packed

PLACE = '<div class="drawn"'


def drawn_here(figures: Mapping[str, Any]) -> nbformat.NotebookNode:
    """The output behind a picture in whose place figures show where controls stand.

    It carries the figures on, for `write_figures`.
    """
    about = {name: value for name, value in figures.items() if name != "figures"}
    about["file"] = _name(figures)
    text = html.escape(json.dumps(about))
    data = {"text/html": f'{PLACE} data-figure="{text}"></div>', MIME: figures}
    return nbformat.v4.new_output("display_data", data)


def write_figures(page: nbformat.NotebookNode, folder: Path) -> None:
    """Take figures out of the outputs that carry them, and write them into a folder."""
    for cell in page.cells:
        for output in cell.get("outputs", []):
            if figures := output.get("data", {}).pop(MIME, None):
                name = _name(figures)
                content = json.dumps(figures["figures"]).encode()
                write_packed(folder / f"{name}.js", {name: content})


def write_controls(folder: Path) -> None:
    """Write the script of the controls into a folder."""
    script = "\n".join([javascript("text", "map"), sources("files", "drawn")])
    write_bytes(folder / "drawn.js", f"(() => {{\n{script}}})();\n".encode())


def _name(figures: Mapping[str, Any]) -> str:
    """A name that no other figures have."""
    return hashlib.sha256(json.dumps(figures).encode()).hexdigest()[:16]
