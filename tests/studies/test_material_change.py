"""A material that changes in mid-run: what changes, and how recovery is counted."""

import numpy as np
import pandas as pd
import pytest

from clothlab.policies import ReplayPolicy
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies import _runs, get, material_change
from studies.material_change import recovery

LIGHT, HEAVY = "damp0.03-mass0.05", "damp0.07-mass0.15"


@pytest.mark.parametrize(
    ("after", "periods"),
    [([3.0, 0.1, 0.9, 0.14, 0.1], 2), ([3.0, 2.0, 0.1, 0.2, 0.2], 6)],
)
def test_recovery_counts_periods_until_the_old_distance_times_one_and_a_half(
    after, periods
):
    assert (
        recovery(np.array([2.0, 0.1, 0.1, 0.1, 0.1, 0.1, *after]), before=6) == periods
    )


def test_a_changed_material_goes_on_where_the_other_one_was_and_then_moves_otherwise():
    commands = np.tile([[0.5, -0.5], [-0.5, -1.0]], (6, 1))
    env = ClothEnv("torque", LIGHT)
    alone = rollout(env, ReplayPolicy(commands), 12)
    changed = rollout(
        env,
        material_change._Change(ReplayPolicy(commands), env, get_cloth(HEAVY), 6),
        12,
    )
    env.close()
    assert np.array_equal(changed.images[:7], alone.images[:7])
    assert (changed.images[9:] != alone.images[9:]).any()


def test_cloths_take_turns_and_both_kinds_of_run_have_the_same():
    table = pd.DataFrame(get("material_change").cases())
    assert table.groupby("arm")["second"].nunique().tolist() == [8, 8]
    assert (
        table.groupby(["arm", "target", "model", "repeat"])["estimated"].nunique() == 2
    ).all()


@pytest.mark.slow
def test_a_row_is_estimated_or_not(monkeypatch):
    monkeypatch.setattr(
        material_change,
        "recorded_runs",
        lambda learned: _runs._encoded(learned.autoencoder_name, "train"),
    )
    for estimated in (True, False):
        row = get("material_change").run_one(
            estimated, "torque", "target-1", LIGHT, "damp0.06-mass0.13", 0, 0, 3, 4
        )
        assert row["best"].shape == (6,)
        assert 1 <= row["recovery"] <= 4
