"""The results as pages: the paper's claims with their verdicts, then this project's.

Both pages, README and `docs/results.md`, are written from the stored tables alone.
"""

import contextlib
import re
import textwrap
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path

from clothlab.data import Folder, data_folder
from studies import EXPERIMENTS, PAPER, Row, _pages, claims, figures, load
from studies._grid import Tables
from studies.claims import Claim, Evidence, Judged

# Marks in a page, between which results stand
_BEGIN = "<!-- results -->"
_END = "<!-- /results -->"
# Of the README: claims by which the paper stands, and rows of this project's own
CLAIMS = (
    "pc1_damping_not_ratio",
    "damping_in_p",
    "mass_in_p",
    "estimate_approaches",
    "control_1_light",
    "control_1_light_all",
    "nearer_than_still_1",
    "control_2_light",
    "nearer_than_still_2",
    "found_in_control",
    "improves_by_p",
    "chamfer_target_2",
    "ellipse",
    "stiffness_speed",
    "foam_random",
    "foam_random_as_published",
    "foam_random_as_published_all",
    "foam_wrong_p",
    "foam_no_stiffness",
    "table_set",
)
Questions = dict[str, list[Row]]  # rows by what is said about them
_PAGE_WIDTH = 120  # [columns] of the pages
# Tables of this project's own are all made on the recordings in `data/`
_HERE = {
    PAPER: "world 0, the paper's recordings",
    claims.TWENTY: "world 0, twenty times as many",
}


def stored(ending: str = "", *, data: Folder = None) -> Tables:
    """The stored tables of one amount of recordings, by their experiments' names.

    The ending is that of the tables' names: `PAPER` for the paper's amount.
    """
    return {name: load(name + ending, data=data) for name in names(ending, data=data)}


def names(ending: str = "", *, data: Folder = None) -> list[str]:
    """Experiments whose table of one amount of recordings is stored."""
    folder = data_folder(data) / "results"
    there = {path.stem for path in folder.glob("*.csv")}
    return [name for name in EXPERIMENTS if name + ending in there]


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


Verdicts = dict[str, dict[str, Judged]]  # by amount of recordings, then by claim


def verdicts(*, data: Folder = None) -> Verdicts:
    """All claims that were measured, by amount of recordings and name."""
    found = {}
    for amount in claims.AMOUNTS:
        judged = claims.judged(amount, data=data)
        found[amount] = {each.claim.name: each for each in judged}
    return found


def claims_table(chosen: Iterable[Claim], judged: Verdicts) -> str:
    """Claims as Markdown: a number and a verdict for each amount of recordings."""
    head = ["what the paper says, and what is measured"]
    for amount in claims.AMOUNTS:
        head += [claims.AMOUNTS_IN_WORDS[amount], "verdict"]
    lines = [tuple(head)]
    for claim in chosen:
        line = [_in_words(claim)]
        for amount in claims.AMOUNTS:
            line += _number_and_verdict(judged[amount].get(claim.name))
        lines.append(tuple(line))
    return _pages.table(lines)


def _in_words(claim: Claim) -> str:
    """The claim, who is judged, and the measure."""
    by = {"method": "", "ours": " (by our method)", "assumption": " (by assumption)"}
    mark = " †" if claim.afterwards else ""
    return f"**{claim.short}**{by[claim.by]}{mark}: {claim.measured}"


def _number_and_verdict(judged: Judged | None) -> tuple[str, str]:
    if judged is None:
        return "", ""
    return judged.short, judged.verdict


def of_part(part: str, judged: Verdicts) -> dict[str, list[Judged]]:
    """Judged claims of one part of the paper, by the amount of recordings in words."""
    found = {}
    for amount, label in claims.AMOUNTS_IN_WORDS.items():
        every = judged[amount].values()
        found[label] = [each for each in every if each.claim.part == part]
    return found


def _parts() -> dict[str, list[Claim]]:
    """Claims by the part of the paper."""
    parts: dict[str, list[Claim]] = {}
    for claim in claims.all_claims().values():
        parts.setdefault(claim.part, []).append(claim)
    return parts


def claims_in_docs(judged: Verdicts) -> str:
    """All claims under the parts of the paper, each part with its figures."""
    written = [f"![{_COUNTS}](results/verdicts.png)"]
    for k, (part, those) in enumerate(_parts().items()):
        written.append(f"### {part[0].upper()}{part[1:]}")
        for label in dict.fromkeys(claim.figure for claim in those):
            if label in figures.FIGURES:
                about = figures.FIGURES[label].__doc__ or ""
                written.append(f"![{about.splitlines()[0]}](results/{label}.png)")
        written.append(f"![Numbers over their margins: {part}](results/part-{k}.png)")
        written.append(claims_table(those, judged))
    return "\n\n".join(written)


_COUNTS = "How many claims of each part of the paper have which verdict"


def draw(
    folder: Path,
    judged: Verdicts,
    asked: Questions,
    beside: Mapping[str, Row],
    *,
    data: Folder = None,
) -> None:
    """Draw all figures of the page.

    Args:
        folder: where they go.
        judged: the paper's claims.
        asked: rows of this project's own, by their questions.
        beside: those of the paper's amount of recordings, by key.
        data: folder of the tables; by default that of `clothlab.data`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # The paper's claims, in all and by part
    drawn = {}
    if any(judged.values()):
        drawn["verdicts"] = figures.verdict_counts(by_label(judged))
    for k, part in enumerate(_parts()):
        found = of_part(part, judged)
        if any(found.values()):
            drawn[f"part-{k}"] = figures.verdicts(found)

    # The paper's figures, and those of this project's own
    evidences = [Evidence(amount, data) for amount in claims.AMOUNTS]
    for label, function in figures.FIGURES.items():
        with contextlib.suppress(claims.NotMeasured):
            drawn[label] = function(*evidences)
    for about, rows in asked.items():
        question = about.strip().splitlines()[0]
        drawn[_named(question)] = figures.own_rows(rows, beside)

    for name, figure in drawn.items():
        figure.savefig(folder / f"{name}.png", dpi=100)


def by_label(judged: Verdicts) -> dict[str, list[Judged]]:
    """All judged claims, by the amount of recordings in words."""
    return {
        label: [*judged[amount].values()]
        for amount, label in claims.AMOUNTS_IN_WORDS.items()
    }


def in_docs(asked: Questions, beside: Mapping[str, Row]) -> str:
    """The tables of `docs/results.md`, each under its question."""
    parts = []
    for about, rows in asked.items():
        question, paragraph = about.strip().split("\n\n")[:2]
        parts.append(f"## {question}")
        parts.append(textwrap.fill(" ".join(paragraph.split()), _PAGE_WIDTH))
        parts.append(f"![The rows below, with aims](results/{_named(question)}.png)")
        parts.append(table(rows, beside))
    return "\n\n".join(parts)


def _named(question: str) -> str:
    """Name of the figure above a table, from its question."""
    words = re.findall(r"[a-z]+", question.lower().replace("_", ""))
    return "-".join(["own", *words[:8]])


def table(rows: Iterable[Row], beside: Mapping[str, Row]) -> str:
    """Rows as Markdown.

    Beside them stand those of the paper's amount of recordings, by key.
    """
    marks = {True: "met", False: "not met"}
    lines = [("", *_HERE.values(), "aim")]
    for row in rows:
        papers = beside[row.key].figure if row.key in beside else ""
        more = "" if row.of_paper else row.figure
        papers = row.figure if row.of_paper else papers
        aim = "" if row.met is None else f"{row.aim}: {marks[row.met]}"
        lines.append((row.label, papers, more, aim))
    return _pages.table(lines)


def publish(folder: Path, *, data: Folder = None) -> list[Row]:
    """Write the stored results into `README.md` and `docs/results.md` of a folder.

    They go between the marks of these pages; a ValueError where there are none. Figures
    go into `docs/results`. Returned are all rows of this project's own experiments.
    """
    judged = verdicts(data=data)
    asked = questions(stored(data=data))
    beside = by_key(questions(stored(PAPER, data=data)))
    chosen = [claims.all_claims()[name] for name in CLAIMS]
    texts = {
        "README.md": f"{claims_table(chosen, judged)}\n\n{_counts(judged)}",
        "docs/results.md": page(judged, asked, beside),
    }
    for name, text in texts.items():
        _pages.put_between(folder / name, text, _BEGIN, _END)
    draw(folder / "docs" / "results", judged, asked, beside, data=data)
    return [*chain(*asked.values())]


def _counts(judged: Verdicts) -> str:
    """Over how many worlds and trainings the numbers are, and what chance does."""
    said = []
    for amount, label in claims.AMOUNTS_IN_WORDS.items():
        found = [*judged[amount].values()]
        if not found:
            continue

        # Of worlds or of trainings, if most claims have so many
        of: dict[str, int] = {}
        for each in found:
            of[each.of] = max(each.count, of.get(each.of, 0))
        counts = [f"{count} {name}{'s' * (count > 1)}" for name, count in of.items()]

        # What is left where all claims are tested at once
        firm = [each for each in found if each.verdict in ("holds", "contradicted")]
        said.append(
            f"With {label}, {' and '.join(counts)}: of {len(firm)} claims that hold or "
            f"are contradicted, {len(claims.lasting(found))} are so by Bonferroni's "
            "rule for all claims at once."
        )
    words = " ".join([*_BY_CHANCE.split(), "Numbers are means over units.", *said])
    return textwrap.fill(words, _PAGE_WIDTH)


_BY_CHANCE = """
Of twenty claims with nothing behind them, one would hold or be contradicted by chance.
The column of twenty times as many is exploratory: its trainings share recordings and an
autoencoder, and they are those on which measures and margins were chosen. † is a claim
whose measure or margin was set when some numbers were known.
"""


def page(judged: Verdicts, asked: Questions, beside: Mapping[str, Row]) -> str:
    """What stands between the marks of `docs/results.md`."""
    return "\n\n".join(
        [
            "## What does the paper claim?",
            textwrap.fill(" ".join(_CLAIMED.split()), _PAGE_WIDTH),
            _counts(judged),
            claims_in_docs(judged),
            in_docs(asked, beside),
        ]
    )


_CLAIMED = """
A number above zero is as the paper says; **verdict** goes by its 95 % interval, which
the figures with numbers over their margins show: *holds* (all of it above zero),
*contradicted* (all of it below), *equal* (all of it nearer to zero than a margin), or
*inconclusive*. Where the paper prints a number, that is subtracted, and *holds* is: all
of it nearer to zero than the margin. "By our method" is said where the paper's alone
was not enough, "by assumption" where a result follows from what we had to assume.
"""
