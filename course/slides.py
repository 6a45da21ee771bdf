"""`make slides`: decks as notebooks in `build/slides`.

Nbconvert makes pages for a projector of them. A heading begins a slide, text goes on
where it does not fit, each figure has a slide of its own without its code, and
exercises, things to change, code and checked claims are left to the notebook. So are
cells about code, which JupyterLab marks under "Slide Type" as "Skip". The last slide
leads to the live lab in a web page, by a code for the telephones in the room.
"""

import argparse
import copy
import re
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell

from clothlab._files import write_bytes
from course.book import BUILD, executed, web_output
from course.editions import ROOT
from course.repository import throw_page
from course.solutions import tags

DECKS = ("03", "04", "05", "06", "07", "07b", "11")
LETTERS = 900  # of text on a slide
DETAILS = re.compile(r"<details>.*?</details>", re.DOTALL)
LEFT_OUT = re.compile(r"#+ (Exercise|References)")
# a paragraph that asks for the notebook
ALONE = re.compile(r"\*\*(Exercise|Change this)|<details>")


def deck_of(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A notebook with outputs as slides: text in pieces, figures without code.

    Each cell's metadata has a `slide_type`.
    """
    deck = copy.deepcopy(notebook)
    deck.metadata.pop("widgets", None)
    deck.cells = []
    left_out = False
    for cell in notebook.cells:
        if cell.metadata.get("slideshow", {}).get("slide_type") == "skip":
            continue

        # Text: a heading says whether what follows is left out
        if cell.cell_type == "markdown":
            for piece in pieces(cell.source):
                heading = piece.startswith("#")
                if heading:
                    left_out = bool(LEFT_OUT.match(piece))
                if not left_out:
                    kind = _slide("slide" if heading else "subslide")
                    deck.cells.append(new_markdown_cell(piece, metadata=kind))

        # Code: only what it shows
        elif not left_out and {"stub", "solution"}.isdisjoint(tags(cell)):
            deck.cells += figures(cell)
    return deck


def throw_slide() -> nbformat.NotebookNode:
    """A slide with the address of the live lab in a web page, for telephones, too."""
    import segno  # comes with what makes the site

    page = throw_page()
    picture = segno.make(page, error="m").svg_data_uri(scale=10)
    code = f'<img alt="QR code of {page}" width="370" src="{picture}">'
    text = f"## Throw a cloth yourself\n\n{code}\n\n<{page}>"
    return new_markdown_cell(text, metadata=_slide("slide"))


def _slide(kind: str) -> dict:
    return {"slideshow": {"slide_type": kind}}


def figures(cell: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    """A slide of what a code cell shows, without the code; none if it shows nothing."""
    outputs = [each for output in cell.outputs for each in web_output(output)]
    shown = [output for output in outputs if is_picture(output)]
    if not shown:
        return []
    return [new_code_cell(metadata=_slide("subslide"), outputs=shown)]


def is_picture(output: nbformat.NotebookNode) -> bool:
    """Whether an output is a figure or a video, and no words."""
    data = output.get("data", {})
    return "image/png" in data or "<video" in data.get("text/html", "")


def pieces(text: str) -> list[str]:
    """Markdown in pieces that fit a slide.

    Each heading begins one; paragraphs, lists and tables stay whole.
    """
    found = [""]
    whole = DETAILS.sub("<details>", text.strip())
    paragraphs = [each for each in re.split(r"\n\s*\n", whole) if not ALONE.match(each)]
    for paragraph in paragraphs:
        heading = paragraph.startswith("#")
        full = len(found[-1]) + len(paragraph) > LETTERS
        if found[-1] and (heading or full):
            found.append("")
        # a heading right above its text
        found[-1] += re.sub(r"^(#.*)\n(?=.)", r"\1\n\n", paragraph) + "\n\n"
    return [piece.strip() for piece in found if piece.strip()]


def lay_out(folder: Path) -> None:
    """Put reveal.js and MathJax into `folder/reveal`.

    They come out of packages that bring them.
    """
    target = folder / "reveal"
    revealjs = files("sphinx_revealjs") / "_static" / "revealjs"
    for part in ("dist", "plugin/notes"):
        shutil.copytree(str(revealjs / part), target / part, dirs_exist_ok=True)
    mathjax = files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg-full.js"
    write_bytes(target / "mathjax" / mathjax.name, mathjax.read_bytes())


def main() -> None:
    """Write the chosen decks as notebooks, and what their pages need."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=DECKS, help="numbers of notebooks")
    parser.add_argument(
        "--small", action="store_true", help="take the run of `make notebooks`"
    )
    arguments = parser.parse_args()
    folder = BUILD / "slides"
    shutil.rmtree(folder, ignore_errors=True)
    for number in arguments.only:
        (path,) = (ROOT / "notebooks").glob(f"{number}_*.ipynb")
        deck = deck_of(executed(path, small=arguments.small))
        deck.cells.append(throw_slide())
        write_bytes(folder / path.name, nbformat.writes(deck).encode())
    lay_out(folder)


if __name__ == "__main__":
    main()
