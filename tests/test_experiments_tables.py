"""The tables say what the records say, in the README too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import clothlab
from clothlab import artifacts, experiments
from clothlab.experiments import practice, table_setting, tables
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


def test_methods_that_ran_side_by_side_have_a_row_with_an_interval():
    def made(method, model, seed, distance, speed):
        runs = np.full(12, distance), np.full(12, speed), np.empty(0)
        return practice.Run(method, "foam hard-1", model, seed, 1.0, *runs, None)

    runs = [made("random", model, seed, 2.0, 1.0) for model in range(2) for seed in range(2)]
    runs += [made("gradient", model, seed, 1.0 + 0.2 * model, 3.0) for model in range(2) for seed in range(2)]
    runs += [made("gradient, without stiffness", model, seed, 1.5, 2.0) for model in range(2) for seed in range(2)]
    settings = practice.Settings(
        methods=("random", "gradient", "gradient, without stiffness"), cases=("foam hard-1",), models=(0, 1), repeats=2
    )
    rows = {row.what: row for row in tables._pairs(practice.Record(settings, tuple(runs)))}
    assert len(rows) == 3
    chance, stiffness, speed = rows.values()
    assert chance.here == "-0.45 (-0.50 to -0.40)"
    assert stiffness.here == "-0.20 (-0.25 to -0.15)"
    assert (speed.here, speed.paper) == ("50.00 % (50 to 50 %)", "+12 %")


def test_a_table_that_was_set_has_its_rates_and_the_difference_to_the_rival():
    def made(method, seed, spread, placed, foam="hard-1"):
        lies = {"flat": 1.0, "area": 1.0, "angle": 0.0, "tilt": 1.0, "off_centre": 0.01, "dragged": 0.001}
        noted = {"foam": foam, "bias": np.zeros(2), "expected": np.ones(1), "before_release": np.ones(1), "steps": 200}
        failed = "" if spread else "look"
        found = {"failed": failed, "cause": "", "grasped": True, "seen": spread, "spread": spread, "placed": placed}
        return table_setting.Run(method=method, model=0, seed=seed, **found, **lies, **noted)

    dynamic = [made("dynamic", k, k != 0, k > 1, "hard-1" if k else "soft-1") for k in range(4)]
    slow = [made("slow", k, k > 1, k > 1) for k in range(4)]
    settings = table_setting.Settings(models=(0,), episodes=4, methods=("dynamic", "slow"))
    guesses = [table_setting.Guess("soft-1", 0, k, "soft-1" if k else "hard-1", np.zeros(2)) for k in range(4)]
    record = table_setting.Record(settings, (*dynamic, *slow), tuple(guesses), ())
    rows = tables.table("table", {"table_setting": record})
    here = [each.here.split(" (")[0] for each in rows]
    assert here == ["100.00 %", "75.00 %", "66.67 %", "50.00 %", "50.00 %", "25.00 %", "75.00 %"]
    assert [each.held for each in rows] == [True, False, False, False, None, None, True]
    assert rows[2].what.endswith("of 3"), "a basket counts only where the cloth lies spread"
    assert "to" in rows[5].here.partition("(")[2]


def test_a_table_that_nobody_set_has_no_rows():
    assert tables.table("table", {}) == []


def test_rows_say_how_many_trainings_they_stand_on():
    records = {name: experiments.load(name) for name in ("integrated", "stiffness")}
    few = tuple(range(3))
    integrated = replace(records["integrated"], runs=records["integrated"].runs[:3])
    stiffness = records["stiffness"]
    stiffness = replace(stiffness, settings=replace(stiffness.settings, models=few))
    stiffness = replace(stiffness, estimation=tuple(each for each in stiffness.estimation if each.model in few))
    for record, number in ((records["integrated"], "five"), (integrated, "3")):
        assert tables._integrated(record)[0].what.endswith(f"mean of {number}")
    for record, number, aim in ((records["stiffness"], "five", "≥ 4"), (stiffness, "3", "≥ 2.4")):
        (found,) = [each for each in tables.muscle_arm({"stiffness": record}) if each.what.startswith("hard-2")]
        assert found.what.endswith(f"hard-1 and hard-3: trainings of {number}")
        assert found.aim == aim
