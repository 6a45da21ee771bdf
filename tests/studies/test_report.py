"""README and notebook 15 show the stored tables."""

from pathlib import Path

import pandas as pd
import pytest

import clothlab
import studies
from clothlab.data import data_folder
from studies import PAPER, claims, headline, report, save
from studies.claims import TWENTY, Evidence, NotMeasured

ROOT = Path(clothlab.__file__).parents[1]


def between_marks(page):
    return page.split("<!-- results -->")[1].split("<!-- /results -->")[0]


def test_the_readme_shows_the_stored_tables(tmp_path):
    page = tmp_path / "README.md"
    page.write_text("before <!-- results -->old<!-- /results --> after")
    report.publish(tmp_path)
    new = page.read_text()
    assert between_marks(new) == between_marks((ROOT / "README.md").read_text())
    assert new.startswith("before")
    assert new.endswith("after")


def test_seven_rows_have_words_that_need_no_paper():
    lines = report.results().split("\n\n")[0].splitlines()
    assert len(lines) == 2 + 7
    jargon = [
        "PC1",
        "C_damp",
        "C_mass",
        "f_const",
        "chamfer",
        "Correct",
        "Random",
        "warm",
        "R²",
        "s.d.",
        "†",
    ]
    assert not [word for line in lines for word in jargon if word in line]


def test_a_page_without_marks_is_refused(tmp_path):
    (tmp_path / "README.md").write_text("no place")
    with pytest.raises(ValueError, match="has no place for this text"):
        report.publish(tmp_path)


def test_every_claim_has_its_row_with_margin_notebook_and_numbers():
    text = report.claims_table()
    rows = [line for line in text.splitlines() if line.startswith("| **")]
    found = claims.all_claims()
    assert len(rows) == len(found)
    for row, claim in zip(rows, found.values(), strict=True):
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert claim.says in cells[0]
        assert claim.measured in cells[1]
        assert cells[-2:] == [f"{claim.margin:g}", claim.notebook]
        for amount, cell in zip(claims.AMOUNTS, cells[2:4], strict=True):
            try:
                judged = claims.judge(claim.name, amount)
            except NotMeasured:
                assert cell == "not measured"
            else:
                assert cell.startswith(f"**{judged.verdict}**: {judged.short}")
                assert cell.endswith(judged.repeated)


def test_a_measure_at_its_floor_is_called_so():
    for name, claim in claims.all_claims().items():
        if claim.floor:
            target = int(name[-1])
            runs = Evidence()["control"].query(f"target == 'target-{target}'")
            for kind in ("control", "random"):
                assert runs[kind].map(claims.nearness).mean() < claim.margin


def test_one_world_alone_has_no_verdicts(tmp_path):
    stored = pd.read_csv(data_folder() / "results" / "worlds-estimation-paper.csv")
    one = stored[stored["world"] == 3].drop(columns="world")
    (tmp_path / "results").mkdir()
    one.to_csv(tmp_path / "results" / "estimation-paper.csv", index=False)
    text = report.of_one(data=tmp_path)
    of_world = claims.named_right(Evidence())["cloth"].loc[3]
    assert f"right in {100 * of_world:.0f} % of runs" in text
    assert text.count("not measured") == len(headline.QUESTIONS) - 1


def late_runs(late):
    """A run for each controller with this distance to the end, over 2 when still."""
    rows = []
    for controller, distance in late.items():
        of = {"controller": controller, "model": 0, "still": 2.0}
        rows.append(of | {"best": [distance] * 31})
    return pd.DataFrame(rows)


def test_rivals_of_worlds_go_before_those_of_one_set_of_recordings(tmp_path):
    assert set(headline.rivals(Evidence(TWENTY))) > {"replay", "paper's controller"}
    with pytest.raises(NotMeasured):
        headline.rivals(Evidence(PAPER, tmp_path))
    save(late_runs({"replay": 0.4}), "control_rivals", data=tmp_path)
    worlds = [late_runs({"replay": 0.5}).assign(world=k) for k in range(5)]
    for count, expected in ((4, [0.2]), (5, [0.25] * 5)):
        save(pd.concat(worlds[:count]), "worlds-control_rivals", data=tmp_path)
        found = headline.rivals(Evidence(TWENTY, tmp_path))
        assert list(found["replay"]) == expected


def test_the_head_says_how_many_repetitions_there_are(tmp_path):
    table = pd.DataFrame({"model": [0, 1], "cloth": "a"})
    save(table, "estimation", data=tmp_path)
    assert headline.amount(Evidence(TWENTY, tmp_path)) == (
        "twenty times as many: 2 trainings, on one set"
    )
    worlds = pd.DataFrame({"world": range(1, 6), "cloth": "a"})
    save(worlds, "worlds-estimation", data=tmp_path)
    assert headline.amount(Evidence(TWENTY, tmp_path)) == (
        "twenty times as many: 5 worlds, each made from nothing"
    )


def test_where_foams_have_other_repetitions_their_row_says_so(tmp_path):
    save(studies.load("foam_control"), "foam_control", data=tmp_path)
    estimates = studies.load("estimation")
    save(estimates, "estimation", data=tmp_path)
    faster = headline.QUESTIONS["Does a variable stiffness make the hand 12 % faster?"]
    assert "(5 trainings)" not in faster(Evidence(TWENTY, tmp_path))
    worlds = estimates.assign(world=estimates["model"], model=0)
    save(worlds, "worlds-estimation", data=tmp_path)
    assert faster(Evidence(TWENTY, tmp_path)).endswith("(5 trainings)")
