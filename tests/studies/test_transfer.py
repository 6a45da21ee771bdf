"""What p is worth: first throws with new cloths, by each method, compared over random
commands.
"""

import numpy as np
import pandas as pd

from clothlab.simulation.cloth import CLOTHS, FOAMS
from studies import transfer
from studies._runs import NEW


def test_new_cloths_were_never_recorded_and_differ_from_all_that_were():
    for arm, known in {"torque": CLOTHS, "muscle": FOAMS}.items():
        assert (
            len({cloth.name for cloth in NEW[arm]} - set(known)) == len(NEW[arm]) >= 8
        )
        materials = {(each.mass, each.damping, each.bending) for each in known.values()}
        assert not materials & {
            (each.mass, each.damping, each.bending) for each in NEW[arm]
        }


def test_wrong_p_are_of_other_cloths_and_the_right_one_is_the_trained_one():
    name = "damp0.03-mass0.05"
    biases = transfer.trained("torque-0").biases
    near, far, right = (
        transfer.bias(p, "torque", name, 0, 0) for p in ("nearest", "farthest", "right")
    )
    assert np.array_equal(right, biases[name])
    others = [np.linalg.norm(p - right) for other, p in biases.items() if other != name]
    assert [np.linalg.norm(near - right), np.linalg.norm(far - right)] == [
        min(others),
        max(others),
    ]


def test_distances_are_over_random_commands():
    rows = [
        {
            "target": "target-1",
            "cloth": cloth,
            "model": model,
            "repeat": repeat,
            "random": 2.0,
            "periods": periods,
        }
        | {"best": np.array([1.0 + model, 9.0])}
        for model in range(2)
        for repeat in range(2)
        for cloth in "ab"
        for periods in (2, 31)
    ]
    table = pd.DataFrame(rows)
    assert transfer.over_random(table).tolist()[:8] == [0.5] * 8
    assert transfer.over_random(table, period=1).tolist() == [4.5] * 16


def test_cloths_and_new_targets_take_turns():
    table = pd.DataFrame(transfer._cases())
    long = table.query("periods == 11")
    assert {len(runs) for _, runs in long.groupby(["model", "repeat"])} == {2}
    assert long["cloth"].nunique() == 8
    assert long["target"].nunique() == 30
    assert not table.duplicated().any()
