"""The benchmark: all methods get the same runs without the cloth's name; errors are of
logarithms.
"""

import mujoco.sysid
import numpy as np
import pandas as pd
import pytest

from clothlab.simulation.cloth import CLOTHS
from studies import get, sysid_benchmark
from studies.sysid import logs
from studies.sysid_benchmark import _ALL, _METHODS, error_gaps, over_bound

MIDDLE = CLOTHS["damp0.05-mass0.10"]


@pytest.mark.slow
def test_methods_get_the_same_run_and_not_the_name_of_its_cloth(monkeypatch):
    given = []

    def make(model):
        return lambda run: given.append(run) or logs(MIDDLE) + 1 / len(run)

    monkeypatch.setitem(_METHODS, "guess", make)
    run_one = get("sysid_benchmark").run_one
    row = run_one("guess", "damp0.03-mass0.15", 1, steps=16)
    run_one("guess", "damp0.03-mass0.15", 1, steps=16)
    assert [len(run) for run in given] == [2, 4, 8, 16] * 2
    assert np.array_equal(given[3].s, given[7].s)
    assert {run.material for run in given} == {"unknown"}
    cloth = _ALL["damp0.03-mass0.15"]
    expected = np.log(MIDDLE.damping / cloth.damping) + 1 / np.array([2, 4, 8, 16])
    assert row["error"][:, 0] == pytest.approx(expected, abs=1e-4)
    assert row["time"] == pytest.approx([0.4, 0.8, 1.6, 3.2])
    assert row["group"] == "trained"


@pytest.mark.slow
@pytest.mark.skipif(
    not hasattr(mujoco.sysid, "optimize"), reason="packages of mujoco.sysid are missing"
)
def test_the_simulation_is_fitted_with_the_springs_that_it_has(monkeypatch):
    fit = sysid_benchmark.fit_simulation
    monkeypatch.setattr(
        sysid_benchmark, "fit_simulation", lambda *run: fit(*run, cells=1, max_iters=1)
    )
    run = sysid_benchmark._sensed("between-light", 0, 4)
    right, again, rough = (
        _METHODS[name](0)(run) for name in ("sysid", "sysid", "sysid-rough")
    )
    assert np.array_equal(right, again)
    assert not np.array_equal(right, rough)


def test_errors_are_compared_with_the_bound_of_the_same_cloth():
    f, time = np.stack([np.eye(2)] * 2), np.array([2.0, 4.0])
    known = [
        {
            "cloth": cloth,
            "motion": motion,
            "seed": 1,
            "time": time,
            "z": size * f / 2,
            "joints": size * f / 2,
        }
        for cloth, motion, size in (
            ("a", "random", 200),
            ("b", "random", 800),
            ("b", "operator", 1),
        )
    ]
    last = {"a": (0.3, 0.1), "b": (0.0, 0.1), "without a bound": (9.0, 0.0)}
    runs = [
        {"cloth": cloth, "time": time, "error": np.array([(5.0, 5.0), e])}
        for cloth, e in last.items()
    ]
    over = over_bound(
        pd.DataFrame(runs), pd.DataFrame(known), "z + joints", "C_damp / C_mass"
    )
    assert over == pytest.approx([0.2 / 0.1, 0.1 / 0.05])


def test_errors_are_compared_on_the_cloths_that_both_methods_have():
    rows = []
    for cloth, worse in (("a", 0.2), ("b", 0.4)):
        for model in range(2):
            error = np.array([[0.1 + worse, 0.0], [-0.1, 0.0]])
            rows.append({"method": "p", "cloth": cloth, "model": model, "error": error})
        fitted = np.array([[0.1, 0.0], [0.1, 0.0]])
        rows.append({"method": "sysid", "cloth": cloth, "model": 0, "error": fitted})
    lone = {"method": "sysid", "cloth": "c", "model": 0, "error": fitted + 9}
    table = pd.DataFrame([*rows, lone])
    gaps = error_gaps(table, ("p", 0), ("sysid", 1), "C_damp")
    assert gaps == pytest.approx(np.array([[0.2, 0.2], [0.4, 0.4]]))
    gaps = error_gaps(table, ("p", 1), ("p", 0), "C_damp")
    assert gaps == pytest.approx(np.array([[-0.2, -0.2], [-0.4, -0.4]]))
