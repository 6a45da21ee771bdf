"""The comparison of controllers, and what stands on it: ablations, other targets,
amounts of recordings.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from clothlab import data
from studies import _runs, ablations, get, iterative_control as ic

EXPERIMENT = get("iterative_control")
TASK = {
    "arm": "torque",
    "target": "target-2",
    "cloth": ic.LIGHT,
    "model": 0,
    "repeat": 0,
    "steps": 24,
}


@pytest.fixture(autouse=True)
def short_trials(monkeypatch):
    """The first steps of the recorded trials, also in place of those that are left to
    `make data`.
    """
    whole = data.load_trials

    def short(name, **options):
        return [trial[:40] for trial in whole(name.removesuffix("-more"), **options)]

    monkeypatch.setattr(data, "load_trials", short)
    _runs._encoded.cache_clear()
    yield
    _runs._encoded.cache_clear()


@pytest.fixture
def one_epoch(monkeypatch):
    whole = ablations.train_dpmpb
    monkeypatch.setattr(
        ablations,
        "train_dpmpb",
        lambda runs, recipe, **options: whole(
            runs, replace(recipe, epochs=1), **options
        ),
    )


@pytest.mark.slow
@pytest.mark.parametrize("controller", ic.CONTROLLERS)
def test_every_controller_runs_and_counts_all_periods_but_the_first(controller):
    row = EXPERIMENT.run_one(controller, "right", "all", **TASK)
    assert row["best"].shape == (2,)


@pytest.mark.slow
def test_models_know_nothing_of_the_material_or_its_standardised_constants(one_epoch):
    blind, known = (ablations.train(kind, "torque", 0) for kind in ablations.KINDS)
    assert blind.model.bias_size == 0
    p = np.array(list(known.biases.values()))
    assert np.allclose([p.mean(0), p.std(0)], [[0, 0], [1, 1]], atol=1e-6)
    assert known.biases["damp0.03-mass0.05"][0] == known.biases["damp0.03-mass0.15"][0]


def a_table(offset):
    """Two methods on one task: random commands at 2, the paper's controller nearer by
    `offset` in each run.
    """
    rows = []
    for controller, value in ((ic.RANDOM, 2.0), (ic.PAPERS, 2.0 - offset)):
        for case in ic.grid(model=range(2), repeat=range(3)):
            best = np.full(12, value + 0.1 * case["model"])
            rows.append(
                {
                    "controller": controller,
                    "p": "right",
                    "recordings": "all",
                    "arm": "torque",
                }
                | {"target": "t", "cloth": "c", "best": best}
                | case
            )
    return ic.over_random(pd.DataFrame(rows))


def test_paired_differences_know_the_offset_and_are_over_random():
    table = a_table(0.5)
    differences = ic.paired(
        ic.select(table, ic.PAPERS), ic.select(table, ic.RANDOM), ic.late_difference
    )
    assert differences.shape == (2, 3)
    assert np.allclose(differences, -0.5 / 2.05)
