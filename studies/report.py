"""The results as Markdown: all rows by question, and the chosen ones for the README."""

import textwrap
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path

from clothlab._store import Folder, data_folder
from studies import EXPERIMENTS, PAPER, Row, load
from studies._grid import Tables

README = (  # keys of the README's rows
    "chamfer",
    "self_organisation/C_damp",
    "estimation/accuracy",
    "control/target-1/damp0.03-mass0.05",
    "joint_estimation_control",
    "stiffness_ellipse",
    "foam_control/hard-1/distance",
    "iterative_control/paper's controller minus the same with a wrong p/torque",
    "iterative_control/speed",
    "iterative_control/iterative learning control",
    "transfer/torque/first",
    "transfer/torque/farthest",
    "transfer/muscle/farthest",
    "material_change/torque",
    "table_setting/success",
)
Questions = dict[str, list[Row]]  # rows by what is said about them
_PAGE_WIDTH = 120  # [columns] of the pages
# Heads of columns
_HERE = "here"
_BESIDE = "here, from the paper's amount of recordings"


def stored(ending: str = "", *, data: Folder = None) -> Tables:
    """The stored tables of one amount of recordings, by their experiments' names.

    The ending is that of the tables' names: `PAPER` for the paper's amount.
    """
    folder = data_folder(data) / "results"
    there = {path.stem for path in folder.glob("*.csv")}
    names = [name for name in EXPERIMENTS if name + ending in there]
    return {name: load(name + ending, data=data) for name in names}


def questions(tables: Tables) -> Questions:
    """Rows of the results, by what is said about them: a question, then a paragraph."""
    found: Questions = {}
    for name in tables:
        experiment = EXPERIMENTS[name]
        if experiment.rows is not None:
            rows = experiment.rows(tables)
            found.setdefault(experiment.about, []).extend(rows)
    return found


def by_key(asked: Questions) -> dict[str, Row]:
    """All rows by their keys, by which both amounts of recordings are joined."""
    return {row.key: row for row in chain(*asked.values())}


def _in_readme(rows: Mapping[str, Row], beside: Mapping[str, Row]) -> str:
    """The README's table, with a verdict on what the paper says."""
    lines = [("", "paper", _BESIDE, _HERE, "what the paper says")]
    for key in README:
        if key in rows:
            row = rows[key]
            papers = beside[key].figure if key in beside else ""
            lines.append((row.label, row.paper, papers, row.figure, row.verdict))
    return _markdown(lines)


def in_docs(asked: Questions, beside: Mapping[str, Row]) -> str:
    """The tables of `docs/results.md`, each under its question."""
    parts = []
    for about, rows in asked.items():
        question, paragraph = about.strip().split("\n\n")[:2]
        parts.append(f"## {question}")
        parts.append(textwrap.fill(" ".join(paragraph.split()), _PAGE_WIDTH))
        parts.append(table(rows, beside))
    return "\n\n".join(parts)


def table(rows: Iterable[Row], beside: Mapping[str, Row]) -> str:
    """Rows as Markdown.

    Beside them stand those of the paper's amount of recordings, by key.
    """
    marks = {True: "✓", False: "not met", None: ""}
    lines = [("", "paper", _BESIDE, _HERE, "aim", "")]
    for row in rows:
        papers = beside[row.key].here if row.key in beside else ""
        mark = marks[row.met]
        lines.append((row.label, row.paper, papers, row.here, row.aim, mark))
    return _markdown(lines)


def publish(folder: Path, *, data: Folder = None) -> list[Row]:
    """Write the stored results into `README.md` and `docs/results.md` of a folder.

    They go between the marks of these pages; a ValueError where there are none.
    Returned are all rows.
    """
    asked = questions(stored(data=data))
    rows = by_key(asked)
    beside = by_key(questions(stored(PAPER, data=data)))
    _write(folder, "README.md", _in_readme(rows, beside))
    _write(folder, "docs/results.md", in_docs(asked, beside))
    return [*chain(*asked.values())]


def _write(folder: Path, name: str, text: str) -> None:
    """Put a text between the marks of a page."""
    path = folder / name
    before, mark, rest = path.read_text().partition("<!-- results -->")
    _, end, after = rest.partition("<!-- /results -->")
    if not mark or not end:
        raise ValueError(
            f"{name} has no place for the results: "
            "<!-- results --> and <!-- /results -->"
        )
    path.write_text(f"{before}{mark}\n{text}\n{end}{after}")


def _markdown(lines: Iterable[tuple[str, ...]]) -> str:
    head, *body = lines
    rule = ("---",) * len(head)
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, rule, *body])
