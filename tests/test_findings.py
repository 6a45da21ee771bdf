"""A finding that does not hold stops the notebook, and says with which number."""

import numpy as np
import pytest

from clothlab.findings import FindingError, finding


def test_a_condition_that_holds_is_printed(capsys):
    finding("three of four", 0.75, at_least=0.75, below=1)
    finding("all of them", [1.0, 3.0], above=0)
    assert capsys.readouterr().out == (
        "✓ three of four: 0.75 (≥ 0.75 and < 1)\n✓ all of them: 1 to 3 (> 0)\n"
    )


@pytest.mark.parametrize(
    ("value", "bounds", "shown"),
    [
        (0.75, {"above": 0.75}, r"0\.75 \(> 0\.75\)"),
        (0.75, {"at_most": 0.7}, r"0\.75 \(≤ 0\.7\)"),
        ([0.1, 0.9], {"below": 0.9}, r"0\.1 to 0\.9 \(< 0\.9\)"),
        (np.nan, {"at_least": 0}, "nan"),
        ([], {"at_least": 0}, "nothing"),
    ],
)
def test_one_that_does_not_hold_is_an_error(value, bounds, shown, capsys):
    with pytest.raises(FindingError, match=f"^this does not hold: so much: {shown}"):
        finding("so much", value, **bounds)
    assert capsys.readouterr().out == ""


def test_small_runs_judge_only_what_is_stored(monkeypatch, capsys):
    monkeypatch.setenv("CLOTHLAB_SMALL", "1")
    finding("measured here", 0.0, live=True, above=1)
    assert "not judged" in capsys.readouterr().out
    with pytest.raises(FindingError):
        finding("stored", 0.0, above=1)


@pytest.mark.parametrize("bounds", [{}, {"atleast": 1}])
def test_a_finding_without_a_bound_is_refused(bounds):
    with pytest.raises(TypeError, match="at_least, above, at_most, below"):
        finding("anything", 1.0, **bounds)
