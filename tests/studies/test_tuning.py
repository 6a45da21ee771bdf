"""Moved settings are compared with the chosen ones in the same runs."""

import numpy as np
import pandas as pd
import pytest

from clothlab.method.iterative import IterativeLearningSettings
from clothlab.simulation.cloth import CLOTHS
from studies import get, tuning
from studies._runs import NEW

EXPERIMENT = get("tuning")


def test_each_setting_is_moved_alone_and_away_from_what_was_chosen():
    cases = pd.DataFrame(EXPERIMENT.cases())
    assert not cases.duplicated().any()
    chosen = IterativeLearningSettings()
    for setting, values in tuning.MOVED.items():
        assert getattr(chosen, setting) not in values
        assert min(values) < getattr(chosen, setting) < max(values)
    every = cases.groupby(["setting", "value"]).size()
    assert every.nunique() == 1, "all have the same cloths, targets and trainings"


def test_development_cloths_are_in_no_other_table():
    known = [*CLOTHS.values(), *NEW["torque"]]
    others = {(cloth.damping, cloth.mass) for cloth in known}
    for cloth in tuning._CLOTHS.values():
        assert (cloth.damping, cloth.mass) not in others


def test_effects_are_paired_differences_over_random_commands():
    rows = []
    for case in EXPERIMENT.cases():
        worse = 0.2 if (case["setting"], case["value"]) == ("aim", 0.3) else 0.0
        hard = 1.0 if case["cloth"].endswith("fast") else 0.5
        best = np.full(case.get("periods", 8), hard)
        best[2:] += worse
        rows.append({"periods": len(best)} | case | {"best": best, "random": 2.0})
    found = tuning.effects(pd.DataFrame(rows)).set_index(["setting", "value", "when"])
    assert found.loc["aim", 0.3, "late"]["mean"] == pytest.approx(0.1)
    assert found.loc["aim", 0.03, "late"]["mean"] == 0
    whens = found.reset_index().groupby("setting")["when"].unique()
    assert whens["difference"] == ["first"], "its runs end with the first throw"
    assert whens["caution"] == ["late"]
