"""The tables say what the records say, in the README too."""

from pathlib import Path

import pytest

import clothlab
from clothlab import artifacts, experiments
from clothlab.experiments import tables
from clothlab.experiments.tables import row

README = Path(clothlab.__file__).parents[1] / "README.md"


@pytest.fixture(scope="module")
def records():
    return experiments.load_all()


def test_the_readme_shows_the_stored_records(records):
    readme = README.read_text()
    assert tables.in_readme(readme, records) == readme


def test_the_stored_tables_are_those_of_the_stored_records(records):
    assert artifacts.load_results("table")["tables"] == tables.as_json(records)


def test_a_readme_without_a_place_for_a_table_is_refused(records):
    with pytest.raises(ValueError, match="no place for the table 'simulation'"):
        tables.in_readme("# clothlab\n", records)


@pytest.mark.parametrize(
    ("bounds", "aim", "held"),
    [
        ({"at_least": 0.5}, "≥ 0.5", True),
        ({"at_most": 0.5}, "≤ 0.5", False),
        ({"at_least": 0.7, "at_most": 0.8}, "0.7 to 0.8", True),
        ({"at_least": 0.8}, "≥ 0.8", False),
        ({}, "–", None),
    ],
)
def test_a_row_says_whether_its_aim_is_met(bounds, aim, held):
    made = row("what", "paper", 0.75, **bounds)
    assert (made.here, made.aim, made.held) == ("0.75", aim, held)


def test_markdown_has_a_line_for_each_row():
    text = tables.markdown([row("a", "1", 2.0), row("b", "–", 3.0, at_least=4, unit=" %")])
    assert text.splitlines()[2:] == ["| a | 1 |  | 2.00 | – |  |", "| b | – |  | 3.00 % | ≥ 4 % | short of it |"]
