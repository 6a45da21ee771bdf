"""The experiment on moved cameras: what did not move changes nothing, what moved is mended, what is done is kept."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab import artifacts, experiments
from clothlab.experiments import cameras, practice
from clothlab.experiments._record import new_trial, trained
from clothlab.experiments.cameras import BOTH, GRADIENT, UNMOVED, Control, Estimate, Place, Record, Settings, jobs, run
from clothlab.experiments.recalibration import Registration
from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import get_arm

CLOTH = "damp0.03-mass0.05"
SMALL = Settings(
    models=(0,),
    curve_models=(0,),
    directions=("yaw",),
    turns=(3.0,),
    draws=1,
    cloths=(CLOTH,),
    steps=12,
    held=(CLOTH,),
    control_steps=16,
)
ARM = get_arm("torque")


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """A few recorded steps; and the right camera in place of a registration, which has tests of its own."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:20] for trial in whole(name.removesuffix(artifacts.MORE))[::6]]
    )
    monkeypatch.setattr(cameras, "registered", lambda arm, place: (Registration(ARM, place.camera(ARM)), 12))
    practice._seen.cache_clear()
    yield
    practice._seen.cache_clear()


def test_a_record_has_every_place_with_and_without_mending_and_survives_the_round_trip(tmp_path, monkeypatch):
    settings = replace(SMALL, methods=(GRADIENT,), directions=())
    record = run(settings, folder=tmp_path)
    assert [(each.place, each.shift_error, each.turn_error < 1e-3) for each in record.registrations] == [
        (UNMOVED, 0, True),
        (BOTH, 0, True),
    ]
    assert len(record.estimates) == len(record.control) == 2 * 2
    assert record.z_error(UNMOVED, False) == record.z_error(UNMOVED, True) == 0
    assert record.z_error(BOTH, False) > 2 * record.z_error(BOTH, True) > 0
    assert record.over_unmoved(UNMOVED, True)[GRADIENT] == 1
    assert set(record.over_unmoved(BOTH, True)) == {"nearest", GRADIENT}
    experiments.save("cameras", record, data=tmp_path)
    assert experiments.load("cameras", data=tmp_path).settings == settings
    monkeypatch.setattr(cameras, "new_trial", lambda *job: pytest.fail("done again"))
    assert np.array_equal(run(settings, folder=tmp_path).control[0].best, record.control[0].best)


def test_the_place_decides_what_is_seen_and_not_what_happens():
    there = replace(ARM, camera=ARM.camera.moved((0.05, 0, 0)))
    moved, still = (new_trial(RandomPolicy(arm), arm, CLOTH, 6, 1) for arm in (there, ARM))
    again = cameras._seen_from(ARM, moved)
    assert np.array_equal(moved.robot, still.robot)
    assert not np.array_equal(moved.images, still.images)
    assert np.array_equal(again.images, still.images)


def test_practice_with_a_registration_sees_from_the_old_place(monkeypatch):
    seen, real = [], cameras.Registered.__call__
    monkeypatch.setattr(cameras.Registered, "__call__", lambda self, what: seen.append(what) or real(self, what))
    run = cameras.control_one(SMALL, SMALL.places[1], True, 0, "practice", CLOTH)
    assert len(seen) == SMALL.control_steps
    assert run.best.shape == run.believed.shape == (1,)
    assert run.last == run.best[0] != run.believed[0]


def test_places_are_displacements_of_the_sizes_that_they_claim():
    places = Settings().places
    assert len(places) == len({(place.name, place.size) for place in places}) == 1 + 6 * 3 + 3
    for place in places:
        camera, old = place.camera(ARM), ARM.camera
        shift = np.linalg.norm(np.subtract(camera.position, old.position))
        turn = np.rad2deg(np.arccos(np.clip((np.trace(camera.axes @ old.axes.T) - 1) / 2, -1, 1)))
        if place.name == UNMOVED:
            assert camera == old
        elif place.name == BOTH:
            assert (shift, turn) == pytest.approx((0.05, 3.0))
        else:
            assert max(shift, turn) == pytest.approx(place.size)
            assert min(shift, turn) == pytest.approx(0, abs=1e-5)


def estimate(place, mended, nearest, model=0):
    return Estimate(place, 0.0, mended, model, CLOTH, nearest, 0.5, 0.1, 0.9)


def control(place, mended, last, model=0):
    return Control(place, 0.0, mended, model, GRADIENT, CLOTH, np.full(12, last), np.full(12, last))


def test_what_is_compared_with_the_unmoved_camera_has_the_same_trainings():
    settings = replace(SMALL, methods=(GRADIENT,), models=(0, 1), control_models=(0, 1))
    estimates = (
        estimate(UNMOVED, False, CLOTH),
        estimate(UNMOVED, False, "other", model=1),
        estimate("yaw", True, CLOTH),
        estimate("yaw", False, "other"),
    )
    runs = (control(UNMOVED, False, 1.0), control(UNMOVED, False, 3.0, model=1))
    runs += (control("yaw", True, 1.5), control("yaw", False, 4.0))
    record = Record(settings, (), estimates, runs)
    assert record.nearest_rate(UNMOVED, False) == 0.5
    assert record.over_unmoved("yaw", True) == {"nearest": 1.0, GRADIENT: 1.5}
    assert record.over_unmoved("yaw", False) == {"nearest": 0.0, GRADIENT: 4.0}


def test_what_is_lost_is_lost_with_the_same_training():
    runs = tuple(control(UNMOVED, False, 1.0 + k, model=k) for k in (0, 1))
    runs += tuple(control(BOTH, True, last, model=k) for k, last in ((1, 2.5), (0, 1.25), (1, 2.0)))
    record = Record(
        replace(SMALL, methods=(GRADIENT,)), (), (), (*runs, control(BOTH, True, 1.5), control(BOTH, False, 9))
    )
    assert record.lost(GRADIENT, True) == pytest.approx(np.array([[0.25, 0.5], [0.5, 0.0]]))


def test_more_trainings_are_tried_where_a_bound_stands():
    pieces = [piece for job in jobs(Settings()) for piece in job]
    assert len(pieces) == len(set(pieces))
    for kind, count in (("estimate", 5), ("control", 3)):
        models = {place.name: set() for _, place, *_ in pieces}
        for _, place, *rest in [piece for piece in pieces if piece[0] == kind]:
            models[place.name].add(rest[1])
        assert models[UNMOVED] == models[BOTH] == set(range(count))
        assert models["yaw"] == {0}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"directions": ("sideways",)},
            "unknown direction 'sideways'; choose from right, up, backward, pitch, yaw, roll",
        ),
        ({"cloths": ("silk",)}, "unknown cloth 'silk'"),
        ({"curve_methods": ("magic",)}, "unknown method 'magic'; choose from random"),
    ],
)
def test_settings_that_name_nothing_are_refused(wrong, message):
    with pytest.raises(KeyError, match=message):
        Settings(**wrong)


def test_displacements_that_are_none_are_refused():
    with pytest.raises(ValueError, match=r"Settings.turns must be above 0"):
        Settings(turns=(0.0,))
    assert trained("torque-0").arm == ARM
    assert isinstance(SMALL.places[0], Place)
