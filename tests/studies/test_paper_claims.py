"""Verdicts say no more and no less than their numbers."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

import clothlab
from studies import PAPER, claims, figures, report, save
from studies.claims import AMOUNTS, TWENTY, Evidence, NotMeasured, nearness

ROOT = Path(clothlab.__file__).parents[1]
CLAIMS = claims.all_claims()


def test_every_claim_has_its_numbers_and_all_numbers_a_claim():
    assert CLAIMS.keys() == claims._NUMBERS.keys()
    assert {claim.kind for claim in CLAIMS.values()} == {"more", "value"}
    assert {claim.by for claim in CLAIMS.values()} == {"method", "ours", "assumption"}
    assert {claim.figure for claim in CLAIMS.values()} > figures.FIGURES.keys()
    assert all(claim.margin > 0 for claim in CLAIMS.values())
    assert set(report.CLAIMS) <= CLAIMS.keys()


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.2, 0.4, "holds"),
        (0.05, 0.4, "holds"),
        (-0.4, -0.05, "contradicted"),
        (-0.4, 0.05, "inconclusive"),
        (-0.05, 0.2, "inconclusive"),
        (-0.05, 0.08, "equal"),
        (0.02, 0.08, "equal"),  # less than matters
        (-np.inf, np.inf, "inconclusive"),
    ],
)
def test_a_verdict_goes_by_the_whole_interval_and_the_margin(low, high, verdict):
    claim = CLAIMS["mass_in_p"]
    assert (claim.margin, claim.kind) == (0.1, "more")
    assert claim.verdict(low, high) == verdict


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (-0.09, 0.09, "holds"),
        (0.11, 0.3, "contradicted"),
        (-0.3, -0.11, "contradicted"),
        (0.05, 0.15, "inconclusive"),
    ],
)
def test_a_number_of_the_paper_is_met_within_the_margin(low, high, verdict):
    claim = CLAIMS["pca_share"]
    assert (claim.margin, claim.kind) == (0.1, "value")
    assert claim.verdict(low, high) == verdict


def test_nearness_is_the_area_under_the_curve_up_to_half_the_hanging_cloth():
    distance = np.array([4.0, 1.0, 3.0, 0.0, 2.0])
    assert nearness(distance) == pytest.approx((0.5 + 0 + 1 + 0) / 4)
    assert nearness(np.array([2.0, 2.0, 1.1])) == 0  # hanging, or hardly nearer
    thresholds = np.linspace(0, 2, 20_001)
    below = (distance[1:, None] < thresholds).mean(axis=0)
    assert nearness(distance) == pytest.approx(below.mean(), abs=1e-3)


def maps_of(folder, arm, maps):
    """A table of trained p, in which each training has one of these maps."""
    rows = []
    for model, p in enumerate(maps):
        of = {"weights": f"{arm}-paper", "model": model, "materials": " ".join(p)}
        rows.append(of | {"p": np.array([*p.values()], dtype=float)})
    save(pd.DataFrame(rows), "trained_p-paper", data=folder)


SQUARE = {"soft-1": (0, 0), "soft-2": (1, 0), "hard-3": (1, 1), "hard-1": (0, 1)}
CROSSED = SQUARE | {"hard-3": (0, 1), "hard-1": (1, 1)}  # neighbours in the wrong order
LINE = {"soft-1": (0, 0), "soft-2": (1, 0.01), "hard-3": (3, 0), "hard-1": (2, 0.01)}


@pytest.mark.parametrize(("p", "corners"), [(SQUARE, 1), (CROSSED, 0)])
def test_foams_lie_at_the_corners_if_the_diagonals_cross(p, corners, tmp_path):
    # However p is turned, stretched and moved
    turned = {name: (2 * x + y + 3, 5 * y - x) for name, (x, y) in p.items()}
    maps_of(tmp_path, "muscle", [p, turned])
    found = claims.numbers("foam_corners", data=tmp_path)
    assert list(found) == [corners] * 2


def test_foams_on_a_line_are_told(tmp_path):
    maps_of(tmp_path, "muscle", [SQUARE, LINE])
    square, line = claims.numbers("foam_not_a_line", data=tmp_path)
    assert square == pytest.approx(0.35)
    assert line < -0.14


def test_pc1_is_told_from_the_ratio(tmp_path):
    names = [
        f"damp{c}-mass{m}"
        for c in ("0.03", "0.05", "0.07")
        for m in ("0.05", "0.10", "0.15")
    ]
    logs = claims._logs(names)
    by_damping = np.stack([logs["damping"], 0.1 * logs["mass"]], axis=1)
    by_ratio = np.stack([logs["ratio"], 0.1 * logs["mass"]], axis=1)
    maps = [dict(zip(names, p, strict=True)) for p in (by_damping, by_ratio)]
    maps_of(tmp_path, "torque", maps)
    damping, ratio = claims.numbers("pc1_damping_not_ratio", data=tmp_path)
    assert damping > 0.2
    assert ratio < -0.2


def test_worlds_go_before_trainings_of_one_world(tmp_path):
    few = {"weights": "torque-paper", "r2": np.array([0.5, 0.1])}
    table = pd.DataFrame([few | {"model": k} for k in range(3)])
    save(table, "self_organisation-paper", data=tmp_path)
    assert claims.judge("mass_in_p", data=tmp_path).of == "training"
    worlds = pd.DataFrame([few | {"world": k, "model": 0} for k in range(4)])
    save(worlds, "worlds-self_organisation-paper", data=tmp_path)
    judged = claims.judge("mass_in_p", data=tmp_path)
    assert (judged.of, judged.count) == ("world", 4)
    with pytest.raises(NotMeasured, match="run `make results`"):
        claims.judge("mass_in_p", TWENTY, data=tmp_path)


def test_a_folder_with_one_table_has_the_claims_of_that_table(tmp_path):
    table = pd.DataFrame([{"model": 0, "r2": np.array([0.9, 0.9])}])
    save(table.assign(weights="torque-paper"), "self_organisation-paper", data=tmp_path)
    names = {each.claim.name for each in claims.judged(data=tmp_path)}
    assert names == {"damping_in_p", "mass_in_p", "mass_less_ordered"}
    assert claims.judged(TWENTY, data=tmp_path) == []


def test_one_number_decides_nothing(tmp_path):
    table = pd.DataFrame([{"model": 0, "r2": np.array([0.9, 0.9])}])
    save(table, "self_organisation-paper", data=tmp_path)
    assert claims.judge("mass_in_p", data=tmp_path).verdict == "inconclusive"


# Sceptics: what rests on a thing must fall without it


@pytest.fixture
def altered(monkeypatch):
    """Stored tables, of which some are changed."""

    def alter(name, change):
        stored = Evidence.__getitem__

        def changed(self, asked):
            table = stored(self, asked)
            return change(table.copy()) if asked == name else table

        monkeypatch.setattr(Evidence, "__getitem__", changed)

    return alter


def permuted_labels(table):
    """Names of the cloths, dealt out anew in each world."""
    rng = np.random.default_rng(0)
    names = [" ".join(rng.permutation(each.split())) for each in table["materials"]]
    return table.assign(materials=names)


@pytest.mark.parametrize("name", ["foam_corners", "pc1_damping_not_mass"])
def test_with_permuted_labels_nothing_holds(name, altered):
    altered("trained_p", permuted_labels)
    assert claims.judge(name).verdict != "holds"


def test_estimates_of_another_cloth_find_nothing(altered):
    def shuffled(table):
        rng = np.random.default_rng(0)
        return table.assign(nearest=rng.permutation(table["nearest"]))

    altered("estimation", shuffled)
    assert claims.judge("estimate_finds").verdict != "holds"


def test_time_reversed_runs_improve_the_other_way(altered):
    before = claims.numbers("improves_by_p", TWENTY)

    def reversed_(table):
        return table.assign(distance=[d[::-1] for d in table["distance"]])

    altered("joint_arms", reversed_)
    after = claims.numbers("improves_by_p", TWENTY)
    assert np.corrcoef(before, after)[0, 1] < -0.5


def test_random_commands_in_place_of_control_are_no_better_than_random(altered):
    altered("control", lambda table: table.assign(control=table["random"]))
    for name in ("control_1_light", "control_2_heavy", "nearer_than_still_1"):
        assert claims.judge(name, TWENTY).verdict in ("equal", "contradicted")


def test_conditions_that_change_places_change_the_verdict(altered):
    names = {"Correct": "Random", "Random": "Correct"}
    altered("foam_control", lambda t: t.assign(condition=t["condition"].replace(names)))
    assert claims.judge("foam_random").verdict == "contradicted"


# The pages


def verdicts_in(text):
    """Verdicts of a page's tables in Markdown, by the claim in bold."""
    found = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        _, mark, rest = cells[0].partition("**")
        claim, end, _ = rest.partition("**")
        verdicts = tuple(cell for cell in cells[1:] if cell in claims.VERDICTS)
        if mark and end and verdicts:
            found[claim] = verdicts
    return found


def test_readme_and_results_have_the_verdicts_that_are_computed():
    judged = report.verdicts()
    expected = {}
    for claim in CLAIMS.values():
        of = [judged[amount].get(claim.name) for amount in AMOUNTS]
        said = [each.verdict for each in of if each is not None]
        expected[claim.short] = tuple(said)
    results = verdicts_in((ROOT / "docs" / "results.md").read_text())
    assert results == expected
    readme = verdicts_in((ROOT / "README.md").read_text())
    assert readme.keys() == {CLAIMS[name].short for name in report.CLAIMS}
    assert readme.items() <= expected.items()


def words_of(figure):
    return " ".join(text.get_text().replace("\n", " ") for text in figure.findobj(Text))


@pytest.mark.parametrize("amounts", [(PAPER,), (TWENTY,), AMOUNTS])
def test_a_figure_says_of_which_amounts_and_how_many_units_it_is(amounts):
    figure = figures.integrated(*map(Evidence, amounts))
    words = words_of(figure)
    count = Evidence(PAPER)["joint_arms"]["unit"].nunique()
    assert (f"the paper's recordings {count} worlds" in words) == (PAPER in amounts)
    assert ("twenty times as many 5 trainings" in words) == (TWENTY in amounts)
    assert len(figure.axes) == 2 * len(amounts)


@pytest.mark.slow
@pytest.mark.parametrize("name", figures.FIGURES)
def test_each_figure_is_drawn_and_stands_on_the_page(name):
    figure = figures.FIGURES[name](*map(Evidence, AMOUNTS))
    last = figure.axes[-1]
    named = [label.get_text() for label in last.get_xticklabels()]
    assert last.get_xlabel() or "Random" in named or not last.axison
    assert f"(results/{name}.png)" in (ROOT / "docs" / "results.md").read_text()
    assert (ROOT / "docs" / "results" / f"{name}.png").stat().st_size > 5_000


def test_half_of_the_hanging_distance_is_nothing_near_and_something_by_all_thresholds():
    hovering = np.array([2.0, 1.5, 1.5])  # the hanging cloth first
    assert nearness(hovering) == 0
    assert nearness(hovering, within=1.0) == pytest.approx(0.25)


def test_what_the_autoencoder_decides_is_one_number_for_all_trainings():
    judged = claims.judge("start_target_1", TWENTY)
    assert (judged.count, judged.verdict) == (1, "inconclusive")
    assert claims.judge("control_1_light", TWENTY).count == 5


def test_few_verdicts_last_where_many_claims_are_tested():
    claim = claims.all_claims()["right_p_nearer"]
    marginal = claims.Judged(claim, 0.5, 0.01, 0.99, 5, "world")
    sure = claims.Judged(claim, 0.5, 0.49, 0.51, 5, "world")
    one = claims.Judged(claim, 0.5, -np.inf, np.inf, 1, "world")
    assert claims.lasting([sure, marginal, one]) == [sure]
    assert claims.lasting([marginal]) == [marginal]
