"""The experiment on moved cameras: what did not move changes nothing, what moved is mended."""

import numpy as np
import pandas as pd
import pytest

from clothlab.experiments import camera_recalibration
from clothlab.experiments._runs import new_trial
from clothlab.experiments.camera_recalibration import BOTH, UNMOVED, _control, _estimate, _moved, _rows
from clothlab.experiments.iterative_control import PAPERS
from clothlab.experiments.recalibration import Recalibration
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS

CLOTH = "damp0.03-mass0.05"
ARM = get_arm("torque")


@pytest.fixture
def exact(monkeypatch):
    """The right camera in place of a recalibration, which has tests of its own."""
    monkeypatch.setattr(
        camera_recalibration,
        "_recalibration",
        lambda direction, size: Recalibration(ARM, _moved(ARM.camera, direction, size)),
    )


@pytest.mark.parametrize(
    ("direction", "size", "shift", "turn"),
    [("up", 0.2, 0.2, 0), ("backward", 0.05, 0.05, 0), ("roll", 10, 0, 10), (BOTH, 1, 0.05, 3), (UNMOVED, 0, 0, 0)],
)
def test_poses_are_displacements_of_their_sizes(direction, size, shift, turn):
    camera, old = _moved(ARM.camera, direction, size), ARM.camera
    moved = np.linalg.norm(np.subtract(camera.position, old.position))
    turned = np.rad2deg(np.arccos(np.clip((np.trace(camera.axes @ old.axes.T) - 1) / 2, -1, 1)))
    assert (moved, turned) == pytest.approx((shift, turn), abs=1e-5)


@pytest.mark.slow
def test_p_is_estimated_from_what_the_camera_sees(exact, monkeypatch):
    seen = []
    monkeypatch.setattr(
        camera_recalibration, "estimate_bias", lambda model, run, settings: seen.append(run.s) or (np.zeros(2), None)
    )
    for direction, recalibrated in ((UNMOVED, False), (UNMOVED, True), (BOTH, False), (BOTH, True)):
        assert _estimate(direction, 0.0, recalibrated, 0, CLOTH, steps=12)["nearest"] in CLOTHS
    unmoved, same, moved_away, back = seen
    assert np.array_equal(unmoved, same)
    assert np.abs(moved_away - unmoved).mean() > 2 * np.abs(back - unmoved).mean() > 0


@pytest.mark.slow
def test_control_is_judged_from_the_old_pose(exact, monkeypatch):
    judged, real = [], camera_recalibration.target_distance
    monkeypatch.setattr(
        camera_recalibration, "target_distance", lambda eye, trial, mask: judged.append(trial) or real(eye, trial, mask)
    )
    assert _control(BOTH, 0.0, True, PAPERS, 0, CLOTH, steps=16)["best"].shape == (1,)
    (trial,) = judged
    again = new_trial(ReplayPolicy(trial.commands), ARM, CLOTH, 16, 0)
    assert np.array_equal(trial.images, again.images)


def test_rows_compare_with_the_unmoved_camera():
    estimates = [(UNMOVED, False, CLOTH), (UNMOVED, False, "other"), (BOTH, True, CLOTH), (BOTH, False, "other")]
    estimates = pd.DataFrame(estimates, columns=["direction", "recalibrated", "nearest"]).assign(cloth=CLOTH)
    runs = [(UNMOVED, False, 1.0), (UNMOVED, False, 3.0), (BOTH, True, 1.5), (BOTH, False, 4.0)]
    runs = pd.DataFrame(runs, columns=["direction", "recalibrated", "best"]).assign(controller=PAPERS)
    runs["best"] = [np.full(12, last) for last in runs.best]
    found = _rows({"camera_estimation": estimates, "camera_control": runs})
    assert [(row.value, row.note) for row in found] == [(2.0, "as it is 0.00"), (0.75, "as it is 2.00")]
