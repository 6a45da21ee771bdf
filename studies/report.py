"""The results as Markdown: all rows in `docs/results.md`, by question, and the chosen
ones in the README.
"""

import inspect
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path

from clothlab.data import Folder, data_folder
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
_HERE, _BESIDE = "here", "here, from the paper's amount of recordings"


def stored(ending: str = "", *, data: Folder = None) -> Tables:
    """The stored tables of one amount of recordings, by their experiments' names:
    `PAPER` for the paper's.
    """
    there = {path.stem for path in (data_folder(data) / "results").glob("*.csv")}
    return {
        name: load(name + ending, data=data)
        for name in EXPERIMENTS
        if name + ending in there
    }


def questions(tables: Tables) -> dict[str, list[Row]]:
    """Rows of the results, by the docstring of the module that has them: a question,
    then a paragraph.
    """
    found: dict[str, list[Row]] = {}
    for name in tables:
        if rows := EXPERIMENTS[name].rows:
            about = inspect.getdoc(inspect.getmodule(rows)) or ""
            found.setdefault(about, []).extend(rows(tables))
    return found


def results(*, data: Folder = None) -> tuple[list[Row], dict[str, Row]]:
    """All rows, and those from the paper's amount of recordings by key."""
    here, papers = (
        [*chain(*questions(stored(ending, data=data)).values())]
        for ending in ("", PAPER)
    )
    return here, {row.key: row for row in papers}


def _in_readme(rows: Iterable[Row], beside: Mapping[str, Row]) -> str:
    """The README's table, with a verdict on what the paper says."""
    by_key, lines = (
        {row.key: row for row in rows},
        [("", "paper", _BESIDE, _HERE, "what the paper says")],
    )
    for row in (by_key[key] for key in README if key in by_key):
        papers = beside[row.key].figure if row.key in beside else ""
        lines.append((row.label, row.paper, papers, row.figure, row.verdict))
    return _markdown(lines)


def in_docs(asked: Mapping[str, Iterable[Row]], beside: Mapping[str, Row]) -> str:
    """The tables of `docs/results.md`."""
    parts = []
    for about, rows in asked.items():
        question, paragraph = about.split("\n\n")[:2]
        parts += [f"## {question}", paragraph, table(rows, beside)]
    return "\n\n".join(parts)


def table(rows: Iterable[Row], beside: Mapping[str, Row]) -> str:
    """Rows as Markdown, with those of the paper's amount of recordings, by key, beside
    them.
    """
    lines = [("", "paper", _BESIDE, _HERE, "aim", "")]
    for row in rows:
        met = {True: "✓", False: "not met", None: ""}[row.met]
        lines.append(
            (
                row.label,
                row.paper,
                beside[row.key].here if row.key in beside else "",
                row.here,
                row.aim,
                met,
            )
        )
    return _markdown(lines)


def publish(folder: Path, *, data: Folder = None) -> list[Row]:
    """Write the stored results into `README.md` and `docs/results.md` of a folder,
    between their marks.
    """
    asked, (rows, beside) = questions(stored(data=data)), results(data=data)
    texts = {
        "README.md": _in_readme(rows, beside),
        "docs/results.md": in_docs(asked, beside),
    }
    for name, text in texts.items():
        path = folder / name
        before, mark, rest = path.read_text().partition("<!-- results -->")
        _, end, after = rest.partition("<!-- /results -->")
        if not mark or not end:
            raise ValueError(
                f"{name} has no place for the results: <!-- results --> and <!-- /results -->"
            )
        path.write_text(f"{before}{mark}\n{text}\n{end}{after}")
    return rows


def _markdown(lines: Iterable[tuple[str, ...]]) -> str:
    head, *body = lines
    return "\n".join(
        f"| {' | '.join(line)} |" for line in [head, ("---",) * len(head), *body]
    )
