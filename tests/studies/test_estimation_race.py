"""The race of two rules: its rows are those of the package's own estimators."""

import pytest

import studies
from studies import estimation_race


@pytest.mark.slow
def test_a_row_of_the_race_is_made_anew():
    case = {"cloth": "damp0.03-mass0.10", "model": 1, "repeat": 0}
    stored, here = studies.recompute("estimation_race", **case).to_dict("records")
    for rule in estimation_race.RULES:
        # Other graphics may draw an outline a little differently
        assert here[rule] == pytest.approx(stored[rule], abs=0.05)
