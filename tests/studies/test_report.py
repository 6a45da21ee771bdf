"""The results pages show the stored tables: numbers with keys, paper beside here."""

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

import clothlab
from studies import PAPER, Experiment, Row, figures, report, save
from studies._grid import over

ROOT = Path(clothlab.__file__).parents[1]


@pytest.fixture(scope="module")
def rows():
    """Of both amounts of recordings, by key; no key is used twice."""
    found = []
    for ending in ("", PAPER):
        each = [
            row
            for rows in report.questions(report.stored(ending)).values()
            for row in rows
        ]
        assert len({row.key for row in each}) == len(each)
        found.append({row.key: row for row in each})
    return found


@pytest.mark.slow
def test_the_pages_show_the_stored_tables(tmp_path):
    pages = ("README.md", "docs/results.md")
    (tmp_path / "docs").mkdir()
    for page in pages:
        (tmp_path / page).write_text(
            "before <!-- results -->old<!-- /results --> after"
        )
    report.publish(tmp_path)
    for page in pages:
        new, shown = ((folder / page).read_text() for folder in (tmp_path, ROOT))
        tables_of = [
            text.split("<!-- results -->")[1].split("<!-- /results -->")[0]
            for text in (new, shown)
        ]
        assert tables_of[0] == tables_of[1]
        assert new.startswith("before")
        assert new.endswith("after")


def test_rows_are_computed_once_for_each_amount_of_recordings(tmp_path, monkeypatch):
    computed = []

    def rows(tables):
        computed.append(list(tables))
        return [Row("counted", "what", float(tables["counted"]["x"].iloc[0]))]

    counted = Experiment("counted", lambda x: {}, over(x=(1,)), rows=rows)
    about = replace(counted, about="A question?\n\nA paragraph.")
    monkeypatch.setattr(report, "EXPERIMENTS", {"counted": about})
    for ending, x in (("", 2), (PAPER, 3)):
        save(pd.DataFrame([{"x": x}]), f"counted{ending}", data=tmp_path)
    (tmp_path / "docs").mkdir()
    for page in ("README.md", "docs/results.md"):
        (tmp_path / page).write_text("<!-- results --><!-- /results -->")
    (row,) = report.publish(tmp_path, data=tmp_path)
    assert (row.value, computed) == (2.0, [["counted"]] * 2)
    written = (tmp_path / "docs" / "results.md").read_text()
    assert "## A question?\n\nA paragraph.\n\n![" in written
    assert (tmp_path / "docs" / "results" / "own-a-question.png").exists()
    assert "| what | 3.00 | 2.00 |  |" in written


@pytest.mark.slow
def test_the_pages_are_short_and_rows_from_the_papers_amount_stand_beside_others(rows):
    here, papers = rows
    assert len(here) <= 95
    assert papers.keys() <= here.keys()


@pytest.mark.parametrize(
    ("bounds", "aim", "met"),
    [
        ({"at_least": 0.5}, "≥ 0.5", True),
        ({"at_most": 0.5}, "≤ 0.5", False),
        ({"at_least": 0.7, "at_most": 0.8}, "0.7 to 0.8", True),
        ({"at_least": 0.8}, "≥ 0.8", False),
        ({}, "–", None),
    ],
)
def test_a_row_says_whether_its_aim_is_met(bounds, aim, met):
    row = Row("k", "what", 0.75, **bounds)
    assert (row.figure, row.aim, row.met) == ("0.75", aim, met)


def test_rows_of_very_different_size_are_all_seen():
    values = (0.05, -0.04, 0.06, 3.0)
    rows = [Row(str(value), "what", value, at_most=2.0) for value in values]
    (ax,) = figures.own_rows(rows, {}).axes
    low, high = ax.get_xlim()
    assert low < -0.04
    assert high > 3
    assert [label.get_text() for label in ax.get_xticklabels()] == [
        *("-0.05", "0", "0.05", "0.1", "0.3", "1", "3")
    ]
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend == ["aim met", "aim not met", "aim: this or less"]


def test_markdown_has_a_line_for_each_row():
    few = Row("b", "b", 2.0, " %")
    rows = [
        Row("a", "a", 2.0),
        Row("b", "b", 3.0, " %", at_least=4, interval=(1.2, 4.8)),
    ]
    assert report.table(rows, {"b": few}).splitlines()[2:] == [
        "| a |  | 2.00 |  |",
        "| b | 2.00 % | 3.00 % (1 to 5 %) | ≥ 4 %: not met |",
    ]
