"""How Sphinx makes the site of executed notebooks: `make docs` runs it."""

import html
import logging
import re
import sys
from pathlib import Path

import nbformat

import clothlab
from clothlab.lab.widget import REOPENED

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from repository import ROOT, START, address, without_installation

logging.getLogger("OpenGL").setLevel(logging.WARNING)  # Sphinx would print its news

project = "clothlab"
author = "The clothlab developers"
version = release = clothlab.__version__
copyright = "The clothlab developers; MIT licence"
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["docs/book"]
# Autosummary would look for them beside the pages
templates_path = [str(Path(__file__).parent / "templates")]
# Types of other packages are named in signatures, and nothing offline could be linked
# to
nitpicky = False

# Pages: notebooks have run already, and every link is checked (warnings end the build).
nb_execution_mode = "off"
nb_output_stderr = "remove"
nb_merge_streams = True
nb_mime_priority_overrides = [("html", "image/png", 0)]
nb_ipywidgets_js: dict[
    str, dict[str, str]
] = {}  # widgets are pictures: nothing is fetched for them
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
myst_heading_anchors = 3
# The exercises of some notebooks begin at the third level; a package and its module may
# both list a class.
suppress_warnings = ["myst.header", "ref.python"]

# The reference.
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "clothlab"
html_static_path = ["static"]
html_css_files = ["book.css"]
html_js_files = ["book.js"]
html_copy_source = False
html_show_sourcelink = False
html_show_search_summary = (
    False  # it fetches pages, which a browser refuses for files in a folder
)
html_show_sphinx = False
html_domain_indices = (
    False  # the reference lists the modules already, by what they are for
)

WIDGET = "application/vnd.jupyter.widget-view+json"
# What is folded in a notebook is folded on its page
FOLDED = {"solution": "a solution", "plot": "the code of this figure"}


def show_notebook(app, docname: str, source: list[str]) -> None:
    """Say in the metadata of a notebook's cells how MyST-NB shows them.

    Changes `source` in place.
    """
    if not docname.startswith("notebooks/"):
        return
    notebook = nbformat.reads(source[0], as_version=4)
    notebook.metadata.pop("widgets", None)  # or their library would be fetched
    for cell in notebook.cells:
        if cell.cell_type == "code":
            show_cell(cell)
    source[0] = nbformat.writes(notebook)


def show_cell(cell: nbformat.NotebookNode) -> None:
    """Say in a code cell's metadata how MyST-NB shows it, and choose its outputs."""
    tags = cell.metadata.setdefault("tags", [])
    shown = cell.metadata.setdefault("mystnb", {})
    if {"claim", "colab"} & set(tags):
        tags.append("remove-cell")
    if cell.metadata.get("jupyter", {}).get("source_hidden"):
        code = next((FOLDED[tag] for tag in FOLDED if tag in tags), "the code")
        tags.append("hide-input")
        shown["code_prompt_show"] = f"Show {code}"
        shown["code_prompt_hide"] = f"Hide {code}"

    # A video waits until somebody starts it
    cell.outputs = [output for output in cell.outputs if is_shown(output)]
    for output in cell.outputs:
        page = output.get("data", {}).get("text/html", "")
        if "<video" in page:
            output.data["text/html"] = re.sub(r"\s(autoplay|loop)\b", "", page)

    # What a figure shows, for those who don't see it
    words = [cell.metadata.get("alt")]
    for output in cell.outputs:
        for about in output.get("metadata", {}).values():
            words.append(about.get("alt") if isinstance(about, dict) else None)
    if any(words):
        shown["image"] = {"alt": "; ".join(filter(None, words))}


def is_shown(output: nbformat.NotebookNode) -> bool:
    """Whether an output is shown: of a widget only its picture, if it has one."""
    data = output.get("data", {})
    if data.get("text/html") == REOPENED:
        return False
    return WIDGET not in data or "image/png" in data


def read_docstring(
    app, what: str, name: str, obj: object, options, lines: list[str]
) -> None:
    """Turn the Markdown of our docstrings, code and tables, into what Sphinx reads.

    Changes `lines` in place.
    """
    text = re.sub(r"(?<!`)`([^`]+)`(?!`)", r"``\1``", "\n".join(lines))
    text = re.sub(
        r"(?:^ *\|.*\|$\n?){3,}",
        lambda table: list_table(table[0]),
        text,
        flags=re.MULTILINE,
    )
    lines[:] = text.split("\n")
    if what in ("property", "attribute", "data"):
        # An empty comment, or Napoleon takes the words before a colon for a type
        lines[:0] = ["..", ""]


def list_table(table: str) -> str:
    """A Markdown table as Sphinx reads it."""
    rows = [
        [cell.strip() for cell in row.strip().strip("|").split("|")]
        for row in table.strip().splitlines()
    ]
    body = ["   * - " + "\n     - ".join(row) for row in (rows[0], *rows[2:])]
    return "\n".join([".. list-table::", "   :header-rows: 1", "", *body, "", ""])


def level_captions(
    app, pagename: str, templatename: str, context: dict, doctree
) -> None:
    """Say on what level captions are headings, which Sphinx leaves open, and screen
    readers then guess.
    """
    for part in ("body", "furo_navigation_tree"):
        context[part] = context.get(part, "").replace(
            ' role="heading"', ' role="heading" aria-level="2"'
        )


def open_elsewhere(
    app, pagename: str, templatename: str, context: dict, doctree
) -> None:
    """Begin each page with links to the page "Throw a cloth", if that was built, and to
    where its notebook runs without an installation, if the repository is published;
    other pages lead to the first notebook.
    """
    if doctree is None:  # the search page and the index have no text of their own
        return
    places = {}
    if (ROOT / "build" / "throw" / "index.html").is_file():  # `make docs` copies it
        places["Throw a cloth now"] = context["pathto"](
            "throw/index.html", resource=True
        )
    notebook = f"{pagename}.ipynb" if pagename.startswith("notebooks/") else START
    places |= without_installation(notebook)
    if address():
        places["repository"] = address()
    links = " · ".join(
        f'<a href="{html.escape(link)}">{name}</a>' for name, link in places.items()
    )
    if links:
        context["body"] = f'<p class="open-elsewhere">{links}</p>' + context["body"]


def setup(app) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", level_captions, priority=900)
    app.connect("html-page-context", open_elsewhere, priority=901)
    app.connect("source-read", show_notebook)
    # Before Napoleon
    app.connect("autodoc-process-docstring", read_docstring, priority=400)
