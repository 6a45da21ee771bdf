"""The results as text, from the stored tables alone.

from studies import report

report.claims_table()  # every claim with its numbers and verdicts, as Markdown
report.publish(folder)  # the seven rows of the README
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path

from clothlab.data import Folder
from studies import _pages, claims, headline
from studies.claims import Claim, Evidence, Judged

# Marks in a page, between which results stand
_BEGIN = "<!-- results -->"
_END = "<!-- /results -->"
_PAGE_WIDTH = 120  # [columns] of the pages
_PURPOSE = "What p, the parametric bias, and the network are for:"

Verdicts = dict[str, dict[str, Judged]]  # by amount of recordings, then by claim


def verdicts(*, data: Folder = None) -> Verdicts:
    """All claims that were measured, by amount of recordings and name."""
    found = {}
    for amount in claims.AMOUNTS:
        judged = claims.judged(amount, data=data)
        found[amount] = {each.claim.name: each for each in judged}
    return found


def by_label(judged: Verdicts) -> dict[str, list[Judged]]:
    """Judged claims, by the amount of recordings in words."""
    return {
        label: [*judged[amount].values()]
        for amount, label in claims.AMOUNTS_IN_WORDS.items()
    }


def claims_table(judged: Verdicts | None = None) -> str:
    """All claims as Markdown, a table for each part of the paper.

    A claim has its sentence, what is measured, the margin and the notebook, and for
    each amount of recordings the number with its 95 % interval, how many there are of
    what, and the verdict.
    """
    judged = verdicts() if judged is None else judged
    written = []
    head = ["the paper", "measured", *claims.AMOUNTS_IN_WORDS.values()]
    for part, those in _parts().items():
        lines = [(*head, "margin", "notebook")]
        for claim in those:
            line = [_sentence(claim), _measure(claim)]
            for amount in claims.AMOUNTS:
                line.append(_number_and_verdict(judged[amount].get(claim.name)))
            lines.append((*line, f"{claim.margin:g}", claim.notebook))
        written.append(f"**{part[0].upper()}{part[1:]}**")
        written.append(_pages.table(lines))
    return "\n\n".join(written)


def _parts() -> dict[str, list[Claim]]:
    """Claims by the part of the paper."""
    parts: dict[str, list[Claim]] = {}
    for claim in claims.all_claims().values():
        parts.setdefault(claim.part, []).append(claim)
    return parts


def _sentence(claim: Claim) -> str:
    """The claim in short, and the paper's words."""
    figure = f" ({claim.figure})" if claim.figure else ""
    return f"**{claim.short}**: “{claim.says}”{figure}"


def _measure(claim: Claim) -> str:
    """What is measured, who is judged, and what a reader has to know of it."""
    by = {"method": "", "ours": "; by our method", "assumption": "; by assumption"}
    floor = "; **floor**" if claim.floor else ""
    late = " †" if claim.afterwards else ""
    return f"{claim.measured}{by[claim.by]}{floor}{late}"


def _number_and_verdict(judged: Judged | None) -> str:
    if judged is None:
        return "not measured"
    return f"**{judged.verdict}**: {judged.figure}, {judged.repeated}"


def publish(folder: Path, *, data: Folder = None) -> None:
    """Write the seven rows and what follows from them into the `README.md` of a folder.

    They go between the marks of the page; a ValueError where there are none. The page
    has the paper's amount of recordings alone, notebook 15 both.
    """
    text = results((claims.PAPER,), data=data)
    _pages.put_between(folder / "README.md", text, _BEGIN, _END)


def results(amounts: Sequence[str] = claims.AMOUNTS, *, data: Folder = None) -> str:
    """The seven rows as Markdown, and three sentences below them.

    There is a column for each of these amounts of recordings.
    """
    evidences = [Evidence(amount, data) for amount in amounts]
    head = ("", *map(headline.amount, evidences))
    lines = [head]
    for question, answer in headline.QUESTIONS.items():
        lines.append((question, *(headline.said(answer, each) for each in evidences)))
    below = [_PURPOSE, *headline.sentences(data=data)]
    wrapped = [textwrap.fill(each, _PAGE_WIDTH) for each in below]
    return "\n\n".join([_pages.table(lines), *wrapped])


def of_one(*, data: Folder = None) -> str:
    """The seven rows with the numbers of one world, as plain text."""
    evidence = Evidence(claims.PAPER, data)
    lines = []
    for question, answer in headline.QUESTIONS.items():
        said = headline.said(answer, evidence).replace("**", "")
        lines.append(f"{question}\n    {said}")
    return "\n".join(lines)
