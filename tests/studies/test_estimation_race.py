"""Both rules of the race are the package's own; the chosen settings won the tuning."""

import numpy as np
import pytest

from clothlab import load, load_trials, tables
from clothlab.method.estimation import EstimationSettings
from clothlab.method.gauss_newton import estimate_bias
from studies import estimation_race


def test_many_settings_at_once_go_the_way_of_each_alone():
    learned = load("torque-0")
    run = learned.to_run(load_trials("evaluation")[0])[:30]
    several = [EstimationSettings(), EstimationSettings(rate=1.0, warmup=0)]
    for settings, path in zip(
        several, estimation_race.descend(learned.model, run, several), strict=True
    ):
        _, alone = estimate_bias(learned.model, run, settings=settings)
        assert path == pytest.approx(alone, abs=2e-5)


@pytest.mark.parametrize(
    ("rule", "warmup"),
    [
        ("sgd, tuned", 0),
        ("sgd, tuned, warm-up 10", 10),
        ("newton", 0),
        ("newton, warm-up 10", 10),
    ],
)
def test_the_race_has_the_settings_that_won_the_tuning(rule, warmup):
    tuning = tables.load("estimation_tuning")
    head = "" if rule.startswith("sgd") else "newton_"
    medians = np.median([*tuning[f"{head}distance"]], axis=0).sum(axis=1)
    warmups = tuning[f"{head}warmup"][0]
    best = np.flatnonzero(warmups == warmup)[medians[warmups == warmup].argmin()]
    for key, value in estimation_race.RULES[rule].items():
        if key != "longest":  # 0.5 and 1 are equally good
            assert tuning[head + key][0][best] == value
