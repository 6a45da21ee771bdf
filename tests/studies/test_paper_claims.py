"""Verdicts say no more and no less than their numbers."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from studies import PAPER, claims, figures, save
from studies.claims import AMOUNTS, TWENTY, Evidence, NotMeasured, nearness

CLAIMS = claims.all_claims()


def test_every_claim_has_its_numbers_and_all_numbers_a_claim():
    assert CLAIMS.keys() == claims._NUMBERS.keys()
    assert {claim.kind for claim in CLAIMS.values()} == {"more", "value"}
    assert {claim.by for claim in CLAIMS.values()} == {"method", "ours", "assumption"}
    assert {claim.figure for claim in CLAIMS.values()} > figures.FIGURES.keys()
    assert all(claim.margin > 0 for claim in CLAIMS.values())
    assert len({claim.short for claim in CLAIMS.values()}) == len(CLAIMS)


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
    claim = CLAIMS["found_in_control"]
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
    claim = CLAIMS["chamfer_target_2"]
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
LINE = {"soft-1": (0, 0), "soft-2": (1, 0.01), "hard-3": (3, 0), "hard-1": (2, 0.01)}


def test_foams_at_corners_are_told_from_foams_on_a_line(tmp_path):
    maps_of(tmp_path, "muscle", [SQUARE, LINE])
    square, line = claims.numbers("foam_corners", data=tmp_path)
    assert square == pytest.approx(0.35)
    assert line < -0.14


@pytest.mark.parametrize(
    ("end", "number"), [((0.5, 1.0), 0.25), ((0.5, 1.5), -0.25), ((1.0, 1.0), -0.25)]
)
def test_midway_is_along_the_line_and_beside_it(end, number, tmp_path):
    maps_of(tmp_path, "muscle", [SQUARE])  # hard-1 at (0, 1), hard-3 at (1, 1)
    run = {"cloth": "hard-2", "model": 0, "place": 0.5}
    table = pd.DataFrame([run | {"trace": [[0.0, 0.0], list(end)]}])
    save(table, "foam_estimation-paper", data=tmp_path)
    (found,) = claims.numbers("hard_2_midway", data=tmp_path)
    assert found == pytest.approx(number)


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
    damping, ratio = claims.numbers("pc1_is_damping", data=tmp_path)
    assert damping > 0.2
    assert ratio < -0.2


def test_an_arm_without_worlds_has_its_trainings(tmp_path):
    both = pd.DataFrame(
        [
            {"weights": arm, "model": 0, "materials": " ".join(SQUARE)}
            | {"p": np.array([*SQUARE.values()], dtype=float)}
            for arm in ("torque", "muscle")
        ]
    )
    save(both, "trained_p", data=tmp_path)
    worlds = [both[:1].assign(world=k) for k in range(4, 9)]
    save(pd.concat(worlds), "worlds-trained_p", data=tmp_path)
    evidence = Evidence(TWENTY, tmp_path)
    assert list(claims.biases_of(evidence, "torque")) == [4, 5, 6, 7, 8]
    assert evidence.of == "world"
    assert list(claims.biases_of(evidence, "muscle")) == [0]
    assert evidence.of == "training"


def correlations(*values):
    """Rows of `chamfer`."""
    rows = [{"target": "target-2", "correlation": each} for each in values]
    return pd.DataFrame(rows)


def test_five_worlds_go_before_trainings_of_one_world(tmp_path):
    table = correlations(0.8, 0.7, 0.9).assign(model=range(3))
    save(table, "chamfer-paper", data=tmp_path)
    judged = claims.judge("chamfer_target_2", data=tmp_path)
    assert judged.repeated == "3 trainings"
    worlds = correlations(0.8, 0.7, 0.9, 0.6, 0.8).assign(world=range(5), model=0)
    for count, repeated in ((4, "3 trainings"), (5, "5 worlds")):
        save(worlds[:count], "worlds-chamfer-paper", data=tmp_path)
        judged = claims.judge("chamfer_target_2", data=tmp_path)
        assert judged.repeated == repeated
    with pytest.raises(NotMeasured, match="run `make results`"):
        claims.judge("chamfer_target_2", TWENTY, data=tmp_path)


def test_a_folder_with_one_table_has_the_claims_of_that_table(tmp_path):
    save(correlations(0.8), "chamfer-paper", data=tmp_path)
    names = {each.claim.name for each in claims.judged(data=tmp_path)}
    assert names == {"chamfer_target_2"}
    assert claims.judged(TWENTY, data=tmp_path) == []


def test_one_number_decides_nothing(tmp_path):
    save(correlations(0.811), "chamfer-paper", data=tmp_path)
    judged = claims.judge("chamfer_target_2", data=tmp_path)
    assert (judged.verdict, judged.figure) == ("inconclusive", "0.00")


def test_an_episode_and_a_target_are_repetitions_of_their_own():
    assert claims.judge("table_set", TWENTY).repeated == "50 episodes"
    assert claims.judge("held_out_targets", TWENTY).repeated == "20 targets"
    assert claims.judge("drawn_targets", TWENTY).repeated == "10 targets"
    assert claims.judge("ellipse").repeated == "nothing varies"


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


def test_with_permuted_labels_p_follows_neither_constant(altered):
    before = claims.pc1_correlations(Evidence())["ratio"].mean()
    altered("trained_p", permuted_labels)
    after = claims.pc1_correlations(Evidence())["ratio"].mean()
    assert before > 0.9
    assert after < 0.5


def shuffled(label, within):
    """Deal a label out anew among the rows that have all else in common."""

    def change(table):
        rng = np.random.default_rng(0)
        dealt = table.groupby(within)[label].transform(rng.permutation)
        return table.assign(**{label: dealt})

    return change


# Tables, and labels of theirs on which verdicts stand
RUN = ["unit", "cloth"]
LABELS = [
    ("estimation", shuffled("nearest", "unit"), "estimate_finds", "holds"),
    ("estimation", shuffled("nearest", "unit"), "constants_in_p", "holds"),
    ("control", shuffled("target", RUN), "target_1_harder", "holds"),
    ("foam_control", shuffled("condition", RUN), "foam_random", "holds"),
    ("foam_control", shuffled("condition", RUN), "foam_rate_as_published", "holds"),
    ("foam_control", shuffled("condition", RUN), "foam_farthest", "contradicted"),
    ("trained_p", permuted_labels, "pc1_is_damping", "contradicted"),
]


@pytest.mark.parametrize(("table", "change", "name", "verdict"), LABELS)
def test_permuted_labels_change_a_verdict(table, change, name, verdict, altered):
    assert claims.judge(name).verdict == verdict
    altered(table, change)
    assert claims.judge(name).verdict != verdict


def test_time_reversed_runs_improve_the_other_way(altered):
    before = claims.numbers("improves_by_p", TWENTY)

    def reversed_(table):
        return table.assign(distance=[d[::-1] for d in table["distance"]])

    altered("joint_arms", reversed_)
    after = claims.numbers("improves_by_p", TWENTY)
    assert np.corrcoef(before, after)[0, 1] < -0.5


def test_random_commands_in_place_of_control_are_no_better_than_random(altered):
    altered("control", lambda table: table.assign(control=table["random"]))
    for name in ("control_1", "control_2", "nearer_than_still_1"):
        assert claims.judge(name, TWENTY).verdict in ("equal", "contradicted")


def test_conditions_that_change_places_change_the_verdict(altered):
    names = {"Correct": "Random", "Random": "Correct"}
    altered("foam_control", lambda t: t.assign(condition=t["condition"].replace(names)))
    assert claims.judge("foam_random").verdict == "contradicted"


# Figures


def words_of(figure):
    return " ".join(text.get_text().replace("\n", " ") for text in figure.findobj(Text))


@pytest.mark.parametrize("amounts", [(PAPER,), (TWENTY,), AMOUNTS])
def test_a_figure_says_of_which_amounts_and_how_many_units_it_is(amounts):
    figure = figures.integrated(*map(Evidence, amounts))
    words = words_of(figure)
    for amount, label in claims.AMOUNTS_IN_WORDS.items():
        evidence = Evidence(amount)
        count = evidence["joint_arms"]["unit"].nunique()
        said = f"{label} {count} {evidence.of}s"
        assert (said in words) == (amount in amounts)
    assert len(figure.axes) == 2 * len(amounts)


@pytest.mark.slow
@pytest.mark.parametrize("name", figures.FIGURES)
def test_each_figure_is_drawn_with_labels(name):
    figure = figures.FIGURES[name](*map(Evidence, AMOUNTS))
    last = figure.axes[-1]
    named = [label.get_text() for label in last.get_xticklabels()]
    assert last.get_xlabel() or "Random" in named or not last.axison


def test_who_hovers_beyond_half_of_the_hanging_distance_has_no_nearness():
    hovering = np.array([2.0, 1.5, 1.5])  # the hanging cloth first
    assert nearness(hovering) == 0
    assert claims.rate(hovering, 0.8) == 1


def test_few_verdicts_last_where_many_claims_are_tested():
    claim = claims.all_claims()["right_p_nearer"]
    marginal = claims.Judged(claim, 0.5, 0.01, 0.99, 5, "world")
    sure = claims.Judged(claim, 0.5, 0.49, 0.51, 5, "world")
    one = claims.Judged(claim, 0.5, -np.inf, np.inf, 1, "world")
    assert claims.lasting([sure, marginal, one]) == [sure]
    assert claims.lasting([marginal]) == [marginal]
