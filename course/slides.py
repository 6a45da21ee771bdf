"""The decks of `make slides` as notebooks in `build/slides`, of which nbconvert makes
pages for a projector.

A heading begins a slide, text goes on where it does not fit, each figure has a slide of
its own without its code, and exercises, things to change, code and checked claims are
left to the notebook. So are cells about code, which JupyterLab marks under "Slide Type"
as "Skip".
"""

import argparse
import copy
import re
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
from nbformat.v4 import new_markdown_cell

from clothlab._files import write_bytes
from course.book import BUILD, executed, web_output
from course.editions import ROOT

DECKS = ("03", "04", "05", "06", "07", "11")
LETTERS = 900  # of text on a slide
LEFT_OUT = re.compile(r"#+ (Exercise|References)")
# a paragraph that asks for the notebook
ALONE = re.compile(r"\*\*(Exercise|Change this)|<details>")


def deck_of(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A notebook with outputs as slides: text in pieces, figures without code,
    `slide_type` in each cell's metadata.
    """
    deck = copy.deepcopy(notebook)
    deck.metadata.pop("widgets", None)
    deck.cells, left_out = [], False
    for cell in notebook.cells:
        if cell.metadata.get("slideshow", {}).get("slide_type") == "skip":
            continue
        if cell.cell_type == "markdown":
            for piece in pieces(cell.source):
                heading = piece.startswith("#")
                left_out = bool(LEFT_OUT.match(piece)) if heading else left_out
                text = new_markdown_cell(
                    piece, metadata=_slide("slide" if heading else "subslide")
                )
                deck.cells += [] if left_out else [text]
        elif not left_out and {"stub", "solution"}.isdisjoint(
            cell.metadata.get("tags", [])
        ):
            outputs = [
                each
                for output in cell.outputs
                for each in web_output(output)
                if is_picture(each)
            ]
            figure = nbformat.v4.new_code_cell(
                metadata=_slide("subslide"), outputs=outputs
            )
            deck.cells += [figure] if outputs else []
    return deck


def _slide(kind: str) -> dict:
    return {"slideshow": {"slide_type": kind}}


def is_picture(output: nbformat.NotebookNode) -> bool:
    """Whether an output is a figure or a video, and no words."""
    data = output.get("data", {})
    return "image/png" in data or "<video" in data.get("text/html", "")


def pieces(text: str) -> list[str]:
    """Markdown in pieces that fit a slide: each heading begins one, paragraphs, lists
    and tables stay whole.
    """
    found = [""]
    whole = re.sub(
        r"<details>.*?</details>", "<details>", text.strip(), flags=re.DOTALL
    )
    paragraphs = [each for each in re.split(r"\n\s*\n", whole) if not ALONE.match(each)]
    for paragraph in paragraphs:
        if found[-1] and (
            paragraph.startswith("#") or len(found[-1]) + len(paragraph) > LETTERS
        ):
            found.append("")
        # a heading right above its text
        found[-1] += re.sub(r"^(#.*)\n(?=.)", r"\1\n\n", paragraph) + "\n\n"
    return [piece.strip() for piece in found if piece.strip()]


def lay_out(folder: Path) -> None:
    """Put reveal.js and MathJax into `folder/reveal`, out of the packages that bring
    them.
    """
    revealjs = files("sphinx_revealjs") / "_static" / "revealjs"
    for part in ("dist", "plugin/notes"):
        shutil.copytree(
            str(revealjs / part), folder / "reveal" / part, dirs_exist_ok=True
        )
    mathjax = files("mathjax") / "static" / "mathjax" / "es5" / "tex-svg-full.js"
    write_bytes(folder / "reveal" / "mathjax" / mathjax.name, mathjax.read_bytes())


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
        write_bytes(folder / path.name, nbformat.writes(deck).encode())
    lay_out(folder)


if __name__ == "__main__":
    main()
