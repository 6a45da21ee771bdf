"""The experiment on moved cameras: what did not move changes nothing, what moved is
mended.
"""

import numpy as np
import pandas as pd
import pytest

from clothlab.simulation._arm_data import get_arm
from clothlab.simulation.cloth import CLOTHS
from studies import camera_recalibration, get
from studies.camera_recalibration import _moved
from studies.recalibration import Recalibration

CLOTH = "damp0.03-mass0.05"
ARM = get_arm("torque")
EXPERIMENT = get("camera_estimation")


@pytest.mark.parametrize(
    ("draw", "shift", "turn"), [(1, 0.05, 3), (2, 0.05, 3), (None, 0, 0)]
)
def test_poses_are_displacements_of_their_sizes(draw, shift, turn):
    camera, old = _moved(ARM.camera, draw), ARM.camera
    moved = np.linalg.norm(np.subtract(camera.position, old.position))
    turned = np.rad2deg(
        np.arccos(np.clip((np.trace(camera.axes @ old.axes.T) - 1) / 2, -1, 1))
    )
    assert (moved, turned) == pytest.approx((shift, turn), abs=1e-5)


@pytest.mark.slow
def test_p_is_estimated_from_what_the_camera_sees(monkeypatch):
    seen = []
    monkeypatch.setattr(  # the right camera: a recalibration has tests of its own
        camera_recalibration,
        "_recalibration",
        lambda draw: Recalibration(ARM, _moved(ARM.camera, draw)),
    )
    monkeypatch.setattr(
        camera_recalibration,
        "estimate_bias",
        lambda model, run, *, method: seen.append(run.s) or (np.zeros(2), None),
    )
    for draw, recalibrated in ((None, False), (None, True), (0, False), (0, True)):
        row = EXPERIMENT.run_one(draw, recalibrated, 0, CLOTH, steps=12)
        assert row["nearest"] in CLOTHS
    unmoved, same, moved_away, back = seen
    assert np.array_equal(unmoved, same)
    assert np.abs(moved_away - unmoved).mean() > 2 * np.abs(back - unmoved).mean() > 0


def test_rows_compare_with_the_unmoved_camera():
    estimates = [
        (None, False, CLOTH),
        (None, False, "other"),
        (0, True, CLOTH),
        (0, False, "other"),
    ]
    table = pd.DataFrame(estimates, columns=["draw", "recalibrated", "nearest"]).assign(
        cloth=CLOTH
    )
    rows = EXPERIMENT.rows({"camera_estimation": table})
    assert [row.value for row in rows] == [2.0, 0.0]
