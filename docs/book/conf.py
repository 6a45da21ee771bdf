"""How Sphinx makes the site.

`make book` lays out the pages by `course/book.py`, then runs Sphinx.
"""

import html
import logging
import os
import re
import shutil
from importlib.resources import files
from pathlib import Path

import clothlab
from course.repository import START, address, doors

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
exclude_patterns = ["downloads", "templates", "docs/course/measured.md"]
templates_path = ["templates"]
# Types of other packages are named in signatures, and nothing offline could be linked
# to
nitpicky = False

# Pages: what ran is laid out already, and every link is checked (warnings end the
# build).
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
html_title = "clothlab" + (
    " · student edition" if os.environ.get("CLOTHLAB_BOOK") == "student" else ""
)
html_static_path = ["static"]
html_css_files = ["book.css"]
html_js_files = ["book.js"]
html_copy_source = False  # the student edition would give away its solutions there
html_show_sourcelink = False
html_show_search_summary = (
    False  # it fetches pages, which a browser refuses for files in a folder
)
html_show_sphinx = False
html_domain_indices = (
    False  # the reference lists the modules already, by what they are for
)

# Formulas: one file with every extension, whose SVG output needs no fonts. The menu
# would fetch more.
mathjax_path = "mathjax/tex-svg-full.js"
mathjax3_config = {"options": {"enableMenu": False}, "startup": {"typeset": True}}


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


def bundle_mathjax(app, _) -> None:
    """Put MathJax beside the pages, out of the package that brings it."""
    there = Path(app.outdir) / "_static" / mathjax_path
    there.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(
        str(files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg-full.js"), there
    )


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
    """Begin each page with links to the live lab and to where its notebook runs without
    an installation; other pages lead to the first notebook.
    """
    if doctree is None:  # the search page and the index have no text of their own
        return
    notebook = f"{pagename}.ipynb" if pagename.startswith("notebooks/") else START
    places = doors(notebook) | {"repository": address()}
    links = " · ".join(
        f'<a href="{html.escape(link)}">{name}</a>' for name, link in places.items()
    )
    throw = f'<a href="{context["pathto"]("throw")}">Throw a cloth now</a>'
    context["body"] = (
        f'<p class="open-elsewhere">{throw}, or run this without an installation: '
        f"{links}</p>" + context["body"]
    )


def setup(app) -> None:
    """Called by Sphinx."""
    app.connect("html-page-context", level_captions, priority=900)
    app.connect("html-page-context", open_elsewhere, priority=901)
    # Before Napoleon
    app.connect("autodoc-process-docstring", read_docstring, priority=400)
    app.connect("build-finished", bundle_mathjax)
