"""What the tables of README and the teacher's page say of the notebooks.

Titles and minutes are those of their first cells, exercises those of their stubs.
`make format` copies them from there, with the hours of each week.
"""

import re
import tomllib
from pathlib import Path

import nbformat
from grade import POINTS, exercises
from repository import ROOT, number_of

from clothlab._files import write_bytes

PAGES = (ROOT / "README.md", ROOT / "docs" / "course" / "README.md")
TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
MINUTES = re.compile(r"\*\*Working time\*\*: about (\d+) minutes")
# A row of a notebook: its title, its address, what stands between, minutes
ROW = re.compile(
    r"^\| \[[^\]]*\]\((?P<address>(?:\.\./)*notebooks/(?P<name>[^)]+))\) "
    r"(?P<between>(?:\|[^|\n]*)?)\| \d+ \|",
    re.MULTILINE,
)
# On the teacher's page, what follows: exercises
EXERCISES = re.compile(
    r"(?P<row>^\| \[[^|]*notebooks/(?P<name>[^)]+)\) \| \d+ \| )(?:`[^|]*|–) \|$",
    re.MULTILINE,
)
# Notebooks of a week by their numbers, and its hours
HOURS = re.compile(r"Part I is about \d+ hours, Part II \d+\.")
WEEK = re.compile(r"\| (?P<numbers>\d\w+(?:, \d\w+)+) \| \d+\.\d \|")


def first_cells() -> dict[str, str]:
    """The text with which each notebook begins, by the name of its file."""
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    return {
        path.name: nbformat.read(path, as_version=4).cells[0].source for path in paths
    }


def with_times(text: str, begins: dict[str, str]) -> str:
    """A page whose tables agree with the first cells of the notebooks.

    Args:
        text: of the page.
        begins: the first cell of each notebook, by the name of its file.
    """
    titles = {name: TITLE.findall(begin)[0] for name, begin in begins.items()}
    minutes = {name: int(MINUTES.findall(begin)[0]) for name, begin in begins.items()}
    by_number = {number_of(Path(name)): time for name, time in minutes.items()}

    def row(found: re.Match[str]) -> str:
        link = f"[{titles[found['name']]}]({found['address']})"
        return f"| {link} {found['between']}| {minutes[found['name']]} |"

    def week(found: re.Match[str]) -> str:
        hours = sum(by_number[each] for each in found["numbers"].split(", ")) / 60
        return f"| {found['numbers']} | {hours:.1f} |"

    def parts(found: re.Match[str]) -> str:
        first = sum(time for number, time in by_number.items() if number < "10")
        both = sum(time for number, time in by_number.items() if number < "A")
        return (
            f"Part I is about {first / 60:.0f} hours, "
            f"Part II {(both - first) / 60:.0f}."
        )

    return HOURS.sub(parts, WEEK.sub(week, ROW.sub(row, text)))


def asked() -> dict[str, str]:
    """The exercises of each notebook with their points, by the name of its file."""
    points = tomllib.loads(POINTS.read_text("utf-8"))
    found = {}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        names = exercises(nbformat.read(path, as_version=4))
        worth = {name: points.get(name, 1) for name in names}
        words = [f"`{name}`" + f" ({n})" * (n != 1) for name, n in worth.items()]
        found[path.name] = " · ".join(words) or "–"
    return found


def with_exercises(text: str, named: dict[str, str]) -> str:
    """A page whose table names the exercises of the notebooks."""
    return EXERCISES.sub(lambda found: f"{found['row']}{named[found['name']]} |", text)


if __name__ == "__main__":
    cells = first_cells()
    for page in PAGES:
        before = page.read_text("utf-8")
        after = with_exercises(with_times(before, cells), asked())
        if after != before:
            write_bytes(page, after.encode())
