"""Identifiability: the noise that is measured, the scenes that are compared, and bounds
from the table.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from clothlab import data
from clothlab.simulation.arm import TorqueArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv
from studies import get, identifiability
from studies.identifiability import PREDICTED, QUANTITIES, bounds

CLOTH = get_cloth("damp0.05-mass0.10")


@pytest.mark.slow
def test_a_camera_turned_by_pixels_moves_its_image_by_them():
    centres = []
    for across, up in ((0, 0), (5, 3)):
        arm = TorqueArm()
        env = ClothEnv(
            replace(arm, camera=identifiability._turned(arm.camera, across, up)), CLOTH
        )
        centres.append(np.argwhere(env.observe()["image"]).mean(axis=0))
        env.close()
    # Pixels away from the middle are wider
    assert centres[1] - centres[0] == pytest.approx([3, -5], rel=0.2)


def test_what_moves_with_the_camera_is_no_noise_and_what_scatters_is_measured_in_full():
    rng = np.random.default_rng(0)
    turns, slopes = rng.uniform(-0.5, 0.5, (4, 2)), rng.normal(size=(2, 4, 50, 3))
    level = rng.normal(size=(4, 1, 50, 3))
    # Steeper in one scene than in another
    smooth = level + np.tensordot(turns, slopes, axes=1).swapaxes(0, 1)
    assert identifiability._residuals(smooth, turns) == pytest.approx(
        np.zeros((16, 50, 3)), abs=1e-12
    )
    noisy = smooth + rng.normal(0, 0.3, smooth.shape)
    assert identifiability._residuals(noisy, turns).std() == pytest.approx(0.3, rel=0.1)


@pytest.mark.slow
def test_a_motion_says_more_in_a_longer_run_and_to_an_observer_with_more_sensors(
    monkeypatch,
):
    whole = data.load_trials
    monkeypatch.setattr(
        data, "load_trials", lambda name: [trial[:60] for trial in whole(name)[:3]]
    )
    identifiability._prediction_noise.cache_clear()
    row = get("identifiability").run_one(CLOTH.name, "random", 3, steps=10)
    table = pd.DataFrame([{"cloth": CLOTH.name, "motion": "random", "seed": 3, **row}])
    z, more, as_network = (
        bounds(table, sensors) for sensors in ("z", "z + joints", PREDICTED)
    )
    assert z.time.tolist() == [1, 2]
    for quantity in QUANTITIES:
        assert z[quantity][1] < z[quantity][0]
        assert more[quantity][1] < z[quantity][1] < as_network[quantity][1]
    assert (row["noise"] > 1e-3).all()
    identifiability._prediction_noise.cache_clear()


def test_bounds_follow_from_the_information_of_the_sensors_together():
    f = np.array([[[2.0, -1.0], [-1.0, 2.0]]])
    keys = {
        "cloth": ["a", "b"],
        "motion": "random",
        "seed": 1,
        "time": [np.array([1.0])] * 2,
    }
    table = pd.DataFrame(keys | {"z": [f, 4 * f], "joints": [f, 4 * f]})
    z, both = bounds(table, "z"), bounds(table, "z + joints")
    ratio = np.sqrt([1, -1] @ np.linalg.inv(f[0]) @ [1, -1])
    assert z["C_damp / C_mass"].tolist() == pytest.approx([ratio, ratio / 2])
    assert both["C_mass"].to_numpy() == pytest.approx(
        z["C_mass"].to_numpy() / np.sqrt(2)
    )
