"""`make format`: what every notebook shares, and what the README says of them.

Both are written out of one place. Every notebook begins, after its title, with the cell
that sets up Google Colab, its summary leads to the notebook after it, and its last
text ends with a word on its kernel. The
README's first line leads to where they run without an installation, and its tables, as
the map in notebook 00, say how long each one takes, as the notebook's own first cell
does, and how long Part I takes in all. The syllabus has the same times, the exercises
with their points, and the sums.
"""

import re
import tomllib
from itertools import pairwise
from pathlib import Path

import nbformat

from course.grades import POINTS, exercises
from course.repository import ROOT, address, doors, throw_page
from course.solutions import without

COLAB = """# @title On Google Colab only: get the repository and what Colab lacks
import os
import subprocess
import sys

if "google.colab" in sys.modules:
    os.environ["MUJOCO_GL"] = "egl"  # draws without a display
    if not os.path.exists("../environment.txt"):
        if not os.path.exists("clothlab"):
            clone = ["git", "clone", "--quiet", "--depth=1"]
            clone += ["ADDRESS", "clothlab"]
            subprocess.run(clone, check=True)
        os.chdir("clothlab/notebooks")
    sys.path[:0] = [os.path.abspath(".."), os.path.abspath("../scripts")]
    import on_colab

    on_colab.install()"""
FOLDED = {"cellView": "form", "jupyter": {"source_hidden": True}, "tags": ["colab"]}
FINISHED = "Finished? *Kernel, Shut Down Kernel* frees its memory."
TIMES = re.compile(
    r"\*\*Working time\*\*: about (?P<learning>\d+) minutes\. "
    r"\*\*Running time\*\*: about (?P<running>\d+) (?P<unit>minutes|seconds)"
)
ASIDE = "◇"  # of a section or an exercise that a hurried reader skips
HEADING = re.compile(r"(#{2,3}) [^\n]*")
EXERCISE = re.compile(rf"\*\*Exercise \w+(?P<aside> {ASIDE})?")
SIDE_ROADS = re.compile(r"\*\*Side roads\*\*: about (\d+) minutes more")
ROW = re.compile(
    r"^(?P<start>\| \[[^]]*\]\((?:notebooks/)?(?P<name>[\w.]+)\) \| [^|]* \|)"
    r" [^|]* \| [^|]* \|$",
    re.MULTILINE,
)
LESSON = re.compile(  # of the syllabus
    r"^(?P<start>\| \[[^]]*\]\(\.\./\.\./notebooks/(?P<name>[\w.]+)\) \|)"
    r" [^|]* \| [^|]* \| [^|]* \|$",
    re.MULTILINE,
)
WEEK = re.compile(
    r"^(?P<start>\| \d+\. [^|]* \| (?P<numbers>[^|]*) \|) [^|]* \|", re.MULTILINE
)
SUMS = re.compile(
    r"^About [\d.]+ hours of work(?: and [\d.]+ of side roads)?, \d+ points\.",
    re.MULTILINE,
)
PART = re.compile(
    r"(?<=\*\*Part I, the method\*\*, in )[^,]*, about \d+ hours"
    r"(?: and \d+ of side roads)?"
)
NEXT = re.compile(r"^Next: \[[^]]*\]\([^)]*\)", re.MULTILINE)
OPEN = re.compile(r"(?<=<!-- open -->\n).*?(?=\n<!-- /open -->)", re.DOTALL)


def colab_cell() -> nbformat.NotebookNode:
    """The first code cell of every notebook, folded: nothing outside of Colab."""
    code = COLAB.replace("ADDRESS", address())
    cell = nbformat.v4.new_code_cell(code, metadata=FOLDED)
    cell.id = "colab"
    return cell


def finish(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook itself, with what all of them share.

    The cell for Colab after its title, and the sentence at the end of its last text.
    """
    cells = without(notebook, "colab").cells
    texts = [cell for cell in cells if cell.cell_type == "markdown"]
    for cell in texts:
        cell.source = cell.source.removesuffix(f"\n\n{FINISHED}")
    texts[-1].source += f"\n\n{FINISHED}"
    notebook.cells = [cells[0], colab_cell(), *cells[1:]]
    return notebook


def lead_on(
    notebook: nbformat.NotebookNode, path: Path, following: nbformat.NotebookNode
) -> None:
    """Let "Next: …", where a notebook says it, name the one that follows, at `path`."""
    title = following.cells[0].source.splitlines()[0].removeprefix("# ")
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = NEXT.sub(f"Next: [{title}]({path.name})", cell.source)


def open_elsewhere() -> str:
    """The README's links to what runs without an installation."""
    links = " · ".join(f"[{name}]({link})" for name, link in doors().items())
    throw = f"**[Throw a cloth now]({throw_page()})**"
    return (
        f"{throw}: a live robot in your browser, on a telephone, too; nothing is "
        f"installed.\n\n**Without an installation**: {links} · "
        f"[repository]({address()})"
    )


def times(notebook: nbformat.NotebookNode) -> tuple[str, str]:
    """How long a notebook takes to learn and to run, such as `("90 min", "20 s")`.

    Its first cell says it; a ValueError says that the cell names none.
    """
    found = TIMES.search(notebook.cells[0].source)
    if not found:
        raise ValueError("the first cell says neither working time nor running time")
    units = {"minutes": "min", "seconds": "s"}
    return f"{found['learning']} min", f"{found['running']} {units[found['unit']]}"


def with_times(readme: str, notebooks: dict[str, nbformat.NotebookNode]) -> str:
    """The README with the times of the notebooks in the last columns of its tables.

    Notebooks are named as their files.
    """

    def row(line: re.Match[str]) -> str:
        if line["name"] not in notebooks:  # not written yet
            return line[0]
        learning, running = times(notebooks[line["name"]])
        return f"{line['start']} {learning} | {running} |"

    return ROW.sub(row, readme)


def minutes(notebook: nbformat.NotebookNode) -> int:
    """Working time."""
    learning, _ = times(notebook)
    return int(learning.removesuffix(" min"))


def side_minutes(notebook: nbformat.NotebookNode) -> int:
    """Working time of the sections that a hurried reader skips."""
    found = SIDE_ROADS.search(notebook.cells[0].source)
    return int(found[1]) if found else 0


def side_exercises(notebook: nbformat.NotebookNode) -> set[str]:
    """Exercises with a ◇, or in a section or its part that has one."""
    found: set[str] = set()
    section = part = exercise = False
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            # A section ends its parts, and either ends an exercise
            if heading := HEADING.match(cell.source):
                aside = heading[0].endswith(ASIDE)
                section = aside if heading[1] == "##" else section
                part = aside if heading[1] == "###" else False
                exercise = False
            for asked in EXERCISE.finditer(cell.source):
                exercise = bool(asked["aside"])
        elif section or part or exercise:
            found |= set(exercises([cell]))
    return found


def part_one(text: str, notebooks: dict[str, nbformat.NotebookNode]) -> str:
    """The README, or the map, with the number of notebooks of Part I and hours."""
    part = [each for name, each in notebooks.items() if name < "10"]
    hours = sum(map(minutes, part)) / 60
    besides = _besides(sum(map(side_minutes, part)) / 60, digits=0)
    sums = f"{len(part)} notebooks, about {hours:.0f} hours{besides}"
    return PART.sub(sums, text)


def _besides(hours: float, digits: int) -> str:
    """What is said of hours of side roads behind those of work; nothing of none."""
    return f" and {hours:.{digits}f} of side roads" if hours else ""


def with_exercises(
    syllabus: str, notebooks: dict[str, nbformat.NotebookNode], weights: dict[str, int]
) -> str:
    """The syllabus with times, exercises, and their sums for each plan.

    Exercises that are not in `weights` count 1. Those on side roads have a ◇.
    """
    spent = {}
    aside = {}
    worth = {}
    skipped = {}
    for name, notebook in notebooks.items():
        number, _, _ = name.partition("_")
        spent[number] = minutes(notebook)
        aside[number] = side_minutes(notebook)
        worth[number] = {
            each: weights.get(each, 1) for each in exercises(notebook.cells)
        }
        skipped[number] = side_exercises(notebook)

    def lesson(line: re.Match[str]) -> str:
        number, _, _ = line["name"].partition("_")
        if number not in spent:  # not written yet
            return line[0]
        listed = _listed(worth[number], skipped[number])
        times = f"{spent[number]} | {aside[number] or '–'}"
        return f"{line['start']} {times} | {listed} |"

    def week(line: re.Match[str]) -> str:
        hours = sum(spent.get(each, 0) for each in line["numbers"].split(", ")) / 60
        return f"{line['start']} {hours:.1f} |"

    # A plan has the weeks below its heading
    plans = LESSON.sub(lesson, syllabus).split("\n## ")
    for k, plan in enumerate(plans):
        listed = ", ".join(line["numbers"] for line in WEEK.finditer(plan))
        numbers = [each for each in listed.split(", ") if each in spent]
        hours = sum(spent[each] for each in numbers) / 60
        points = sum(sum(worth[each].values()) for each in numbers)
        besides = _besides(sum(aside[each] for each in numbers) / 60, digits=1)
        sums = f"About {hours:.1f} hours of work{besides}, {points} points."
        plans[k] = WEEK.sub(week, SUMS.sub(sums, plan))
    return "\n## ".join(plans)


def _listed(worth: dict[str, int], aside: set[str]) -> str:
    """Exercises with their points where these are not 1, and a ◇ on side roads."""
    asked = []
    for name, most in worth.items():
        mark = f" {ASIDE}" if name in aside else ""
        points = f" ({most})" if most != 1 else ""
        asked.append(f"`{name}`{mark}{points}")
    return " · ".join(asked) or "–"


def finished() -> dict[Path, str]:
    """The text of each notebook and of the README as they should be."""
    # Notebooks, in the order of their numbers: 07, 07b, 08
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    notebooks = {path: finish(nbformat.read(path, as_version=4)) for path in paths}
    for path, following in pairwise(paths):
        lead_on(notebooks[path], following, notebooks[following])
    named = {path.name: each for path, each in notebooks.items()}
    for cell in notebooks[paths[0]].cells:  # the map
        cell.source = part_one(with_times(cell.source, named), named)
    texts = {path: nbformat.writes(each) + "\n" for path, each in notebooks.items()}

    # The README and the syllabus
    readme = ROOT / "README.md"
    linked = OPEN.sub(lambda _: open_elsewhere(), readme.read_text("utf-8"))
    texts[readme] = part_one(with_times(linked, named), named)
    syllabus = ROOT / "docs" / "course" / "syllabus.md"
    weights = tomllib.loads(POINTS.read_text("utf-8"))
    texts[syllabus] = with_exercises(syllabus.read_text("utf-8"), named, weights)
    return texts


def main() -> None:
    """Write what differs from what is there."""
    for path, text in finished().items():
        if path.read_text("utf-8") != text:
            path.write_text(text, "utf-8", newline="\n")


if __name__ == "__main__":
    main()
