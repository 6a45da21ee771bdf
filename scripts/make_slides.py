"""`make slides`: decks of notebooks for a projector, in `build/slides`, which open from there without a network.

One rule says what is on a slide: a heading begins one, text goes on where it does not fit, each figure has one of its
own without its code, and exercises, code and checked claims are left to the notebook. The notebooks of the decks lie
beside them, with that as their slide metadata, so that `jupyter nbconvert --to slides` takes them, too.
"""

import argparse
import copy
import re
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
from make_book import BUILD, ran, web_output
from make_editions import ROOT
from nbconvert import SlidesExporter
from nbformat.v4 import new_markdown_cell
from traitlets.config import Config

from clothlab._files import write_bytes

DECKS = ("06", "08", "10", "11")
LETTERS = 1000  # of text on a slide
LINE = 80  # letters of a line, about
ROWS = 9  # of a table


def deck_of(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A notebook as slides: its text in pieces, its figures without code, and `slide_type` in each cell's metadata.

    Args:
        notebook: with its outputs.
    """
    deck = copy.deepcopy(notebook)
    deck.metadata.pop("widgets", None)
    deck.cells, solving = [], False
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            for piece in pieces(cell.source):
                solving = solving if not piece.startswith("#") else bool(re.match("#+ Exercise", piece))
                if not solving and not piece.startswith("## References"):
                    slide = new_markdown_cell(
                        piece, metadata=slideshow("slide" if piece.startswith("#") else "subslide")
                    )
                    deck.cells.append(slide)
        elif not solving and {"stub", "solution"}.isdisjoint(cell.metadata.get("tags", [])):
            outputs = [each for output in cell.outputs for each in web_output(output) if is_picture(each)]
            if outputs:
                shown = copy.deepcopy(cell)
                shown.metadata, shown.outputs = nbformat.from_dict(slideshow("subslide")), outputs
                deck.cells.append(shown)
    return deck


def slideshow(kind: str) -> dict:
    """Metadata of a cell on a slide of this kind."""
    return {"slideshow": {"slide_type": kind}}


def is_picture(output: nbformat.NotebookNode) -> bool:
    """Whether an output is a figure or a video, and no words."""
    data = output.get("data", {})
    return "image/png" in data or "<video" in data.get("text/html", "")


def pieces(text: str) -> list[str]:
    """Markdown in pieces that fit a slide: each heading begins one, paragraphs and lists stay whole."""
    found, room = [""], LETTERS
    for paragraph in [part for each in re.split(r"\n\s*\n", text.strip()) for part in tables(each)]:
        lines = paragraph.splitlines()
        if len(lines) > 1 and lines[0].startswith("#"):  # a heading right above its text
            lines = [lines[0], "", *lines[1:]]
        size = sum(max(LINE, len(line) * (2 if line.startswith("|") else 1)) for line in lines)
        if "$$" in paragraph:
            size += 2 * LINE
        if found[-1] and (paragraph.startswith("#") or size > room):
            found.append("")
            room = LETTERS
        found[-1] += "\n".join(lines) + "\n\n"
        room -= size
    return [piece.strip() for piece in found if piece.strip()]


def tables(paragraph: str) -> list[str]:
    """A long table as several with the same head; anything else as it is."""
    head, rows = paragraph.splitlines()[:2], paragraph.splitlines()[2:]
    if not paragraph.startswith("|") or len(rows) <= ROWS:
        return [paragraph]
    return ["\n".join([*head, *rows[k : k + ROWS]]) for k in range(0, len(rows), ROWS)]


def export(deck: nbformat.NotebookNode, name: str) -> str:
    """The deck as a page, which expects reveal.js and MathJax in a folder `reveal` beside it."""
    settings = Config(
        {"SlidesExporter": {"exclude_input": True, "reveal_url_prefix": "reveal", "reveal_theme": "white"}}
    )
    settings.TemplateExporter.extra_template_basedirs = [str(ROOT / "docs")]
    page, _ = SlidesExporter(config=settings, template_name="slides").from_notebook_node(
        deck, {"metadata": {"name": name}}
    )
    return page


def lay_out(folder: Path) -> None:
    """Put reveal.js and MathJax into `folder/reveal`, out of the packages that bring them."""
    revealjs = files("sphinx_revealjs") / "_static" / "revealjs"
    for part in ("dist/theme/fonts", "plugin/notes", "mathjax"):
        (folder / "reveal" / part).mkdir(parents=True, exist_ok=True)
    for part in ("dist/reveal.js", "dist/reveal.css", "dist/theme/white.css", "plugin/notes/notes.js"):
        shutil.copy(str(revealjs / part), folder / "reveal" / part)
    fonts = "dist/theme/fonts"
    shutil.copytree(str(revealjs / fonts), folder / "reveal" / fonts, dirs_exist_ok=True)
    shutil.copy(str(files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg-full.js"), folder / "reveal" / "mathjax")


def main() -> None:
    """Make the chosen decks."""
    notebooks = {path.stem[:2]: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=notebooks, default=DECKS, help="numbers of notebooks")
    parser.add_argument("--small", action="store_true", help="take the run of `make notebooks`")
    parser.add_argument("--old", action="store_true", help="take earlier runs although something changed since")
    arguments = parser.parse_args()
    folder = BUILD / "slides"
    for number in arguments.only:
        path = notebooks[number]
        deck = deck_of(ran(path, small=arguments.small, old=arguments.old))
        write_bytes(folder / path.name, nbformat.writes(deck).encode())
        write_bytes(folder / f"{path.stem}.slides.html", export(deck, path.stem).encode())
    lay_out(folder)
    print(f"{folder}: open the pages in a browser; the arrow keys lead on")


if __name__ == "__main__":
    main()
