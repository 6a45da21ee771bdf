"""What the table of the calibration's test counts, of runs that are known."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from clothlab.simulation.cloth import CLOTHS
from studies import calibration_test, get, load
from studies._runs import trained
from studies.calibration_test import coverage
from studies.uncertainty import Calibration

NAME = "damp0.03-mass0.15"


@pytest.fixture(scope="module")
def table():
    right = trained("torque-0").biases[NAME]

    def row(off, wide, unfamiliar, cloth=NAME, kind="trained"):
        return {
            "cloth": cloth,
            "model": 0,
            "kind": kind,
            "nearest": NAME if off == 0 else "another",
            "estimate": right[None] + (off, 0.0),
            "bare": np.array([0.01 * np.eye(2)]),
            "covariance": np.array([wide * np.eye(2)]),
            "out_of_distribution": np.array([unfamiliar]),
            "outside_hull": np.array([True]),
        }

    return pd.DataFrame(
        [
            row(0.0, 0.01, False),
            row(0.5, 1.0, True),
            row(0.0, 1.0, False, "light", "beyond"),
        ]
    )


def test_regions_cover_what_they_hold(table):
    assert coverage(table) == pytest.approx([1.0])
    # Half a unit off, with a deviation of 0.1
    assert coverage(table, "bare") == pytest.approx([0.5])


@pytest.mark.slow
def test_a_run_is_looked_at_after_each_length(monkeypatch):
    stored = load("calibration").iloc[0][
        [field.name for field in dataclasses.fields(Calibration)]
    ]
    monkeypatch.setattr(
        calibration_test, "_calibration", lambda model: Calibration(**stored)
    )
    row = get("calibration_test").run_one(NAME, 0, 0, steps=50)
    assert row["nearest"] in CLOTHS
    assert row["bare"].shape == row["covariance"].shape == (1, 2, 2)
    assert np.linalg.det(row["covariance"][0]) > np.linalg.det(row["bare"][0])
