"""Claims: what holds passes, what does not hold and what cannot fail goes red."""

import json

import numpy as np
import pytest

from clothlab.claims import ClaimError, Findings

DISTANCES = np.array([0.2, 0.3, 0.25, 0.4])


@pytest.fixture
def findings(tmp_path):
    return Findings("08_control", data=tmp_path, steps=250)


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """The findings of a notebook whose one claim was stored by a full-size run."""
    monkeypatch.setenv(Findings.RECORD, "1")
    Findings("08_control", data=tmp_path, steps=250).live(
        "near", np.max, below=0.5, a=DISTANCES
    )
    monkeypatch.delenv(Findings.RECORD)
    return lambda **parameters: Findings("08_control", data=tmp_path, **parameters)


def mean(distances):
    return distances.mean()


def test_a_claim_that_holds_is_printed_with_its_figure_and_bound(findings, capsys):
    findings.stored(
        "Control comes near", mean, below=0.5, at_least=0.1, distances=DISTANCES
    )
    printed = capsys.readouterr().out
    assert printed == "✓ Control comes near: 0.287 stored (< 0.5 and ≥ 0.1)\n"


def test_a_notebook_shows_how_many_hold_and_folds_which(findings, monkeypatch):
    shown = []

    class Shell:
        kernel = None

    class Handle:
        def update(self, held):
            shown.append(held._repr_html_())

    def display(held, display_id):
        shown.append(held._repr_html_())
        return Handle()

    monkeypatch.setattr("IPython.get_ipython", Shell)
    monkeypatch.setattr("clothlab.claims.display", display)
    for claim in ("Control comes near", "and nearer"):
        findings.stored(claim, mean, below=0.5, at_least=0.1, distances=DISTANCES)
    summary = "<details><summary>✓ 2 conditions of the Findings hold</summary>"
    line = "✓ and nearer: 0.287 stored (&lt; 0.5 and ≥ 0.1)"
    assert len(shown) == 2
    assert shown[1].startswith(summary)
    assert line in shown[1]


@pytest.mark.parametrize(
    "bounds", [{"below": 0.2}, {"at_most": 0.28}, {"above": 0.3}, {"at_least": 0.29}]
)
def test_a_claim_that_does_not_hold_names_claim_figure_and_bound(findings, bounds):
    with pytest.raises(
        ClaimError,
        match=r"(?s)Control comes near.*stored: 0.2875, claimed: [<≤>≥] 0.[23]",
    ):
        findings.stored("Control comes near", mean, distances=DISTANCES, **bounds)


@pytest.mark.parametrize(
    ("figure", "bounds"),
    [
        (lambda distances: 1.0, {"above": 0.0}),
        (lambda distances: len(distances), {"at_least": 1}),
        (lambda distances: np.square(distances).mean(), {"at_least": 0}),
        (lambda distances: distances.max() - distances.min(), {"at_least": 0}),
        (lambda distances: np.mean(np.abs(distances) < 1e9), {"at_least": 0.5}),
    ],
)
def test_a_condition_that_cannot_fail_is_refused(findings, figure, bounds):
    with pytest.raises(ClaimError, match="can hardly fail"):
        findings.stored("anything", figure, distances=DISTANCES, **bounds)


def test_a_claim_needs_bounds_and_arrays(findings):
    with pytest.raises(ValueError, match="needs a bound"):
        findings.stored("near", mean, distances=DISTANCES)
    with pytest.raises(ValueError, match="needs a bound"):
        findings.stored("near", mean, below=1)


@pytest.mark.parametrize(
    ("figure", "given"),
    [
        (lambda below: below.mean(), {"below": DISTANCES, "at_most": 1}),
        (lambda below: float(below), {"below": 0.2, "at_most": 1}),
        (lambda **arrays: 0.3, {"below": DISTANCES, "a": DISTANCES}),
        (mean, {"below": [0.5], "distances": DISTANCES}),
    ],
)
def test_an_array_with_the_name_of_a_bound_is_refused(findings, figure, given):
    with pytest.raises(ValueError, match="'near': below is a bound, one number") as no:
        findings.stored("near", figure, **given)
    assert "\n" not in str(no.value)


def test_a_small_run_is_judged_by_the_stored_figures_and_a_full_one_by_its_own_too(
    recorded, capsys
):
    recorded(steps=16).live("near", np.max, below=0.5, a=[9.0])
    assert capsys.readouterr().out.count("\n") == 1  # stored, not here
    with pytest.raises(ClaimError, match=r"here: 9, claimed: < 0\.5"):
        recorded(steps=250).live("near", np.max, below=0.5, a=[9.0])


def test_a_claim_without_stored_figures_says_how_to_get_them(recorded):
    with pytest.raises(ClaimError, match="run `make findings RECORD=1`"):
        recorded(steps=16).live("new", np.max, below=0.5, a=DISTANCES)


def test_a_stored_figure_that_was_changed_beyond_its_claim_goes_red(recorded, tmp_path):
    path = tmp_path / "results" / "findings-08_control.json"
    stored = json.loads(path.read_text())
    stored["figures"]["near"]["a"][1] = 0.7
    path.write_text(json.dumps(stored))
    with pytest.raises(ClaimError, match=r"stored: 0\.7"):
        recorded(steps=16).live("near", np.max, below=0.5, a=DISTANCES)
