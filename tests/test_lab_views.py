"""What the panel shows is plain data, made of what the session holds."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from clothlab.lab import views
from clothlab.lab.drivers import Period
from clothlab.lab.session import LiveSession
from clothlab.learning.calibration import EstimateReport, inside
from clothlab.simulation.arm import get_arm

BIASES = {"a": np.array([1.0, 0.0]), "b": np.array([-1.0, 0.5]), "c": np.array([0.0, -2.0])}


@pytest.fixture(scope="module", params=["torque", "muscle"])
def session(request, tmp_path_factory):
    session = LiveSession(request.param, recordings=tmp_path_factory.mktemp("mine"), picture_size=(96, 128))
    yield session
    session.close()


@pytest.fixture(scope="module")
def history(session):
    session.set_driver("random")
    return [session.step() for _ in range(3)]


def plain(value):
    """Whether JSON has a word for all of it but bytes."""
    return json.dumps(value, default=lambda each: "bytes" if isinstance(each, bytes) else 1 / 0)


def test_a_place_on_the_map_is_a_p_and_back():
    plane = views.Plane(BIASES, {"a": "first"})
    for p in BIASES.values():
        assert plane.p(plane.at(p)) == pytest.approx(p)
    assert [dot["label"] for dot in plane.map["dots"]] == ["first", "b", "c"]
    assert all(max(map(abs, dot["at"])) < plane.map["reach"] for dot in plane.map["dots"])


def test_a_region_on_the_map_is_around_its_place():
    plane, covariance = views.Plane(BIASES, {}), np.array([[0.04, 0.01], [0.01, 0.09]])
    edge = plane.region(BIASES["a"], covariance)
    assert np.mean(edge[:-1], axis=0) == pytest.approx(plane.at(BIASES["a"]), abs=0.01)
    assert all(inside(plane.p(at), BIASES["a"], 1.01 * covariance) for at in edge)
    assert not any(inside(plane.p(at), BIASES["a"], 0.99 * covariance) for at in edge)


def test_doubts_are_shown_while_p_is_estimated_and_say_what_is_strange(session):
    the_plane, known = views.plane(session), EstimateReport(0.01 * np.eye(2), 0.1, False, False)
    nothing = {"region": [], "warning": ""}
    assert views.estimate_report(session, the_plane) == nothing
    session.tracker.report = known
    assert views.estimate_report(session, the_plane) == nothing
    session.estimating = True
    shown = views.estimate_report(session, the_plane)
    plain(shown)
    assert len(shown["region"]) > 10
    assert shown["warning"] == ""
    session.tracker.report = known._replace(outside_hull=True)
    assert "outside the trained ones" in views.estimate_report(session, the_plane)["warning"]
    session.tracker.report = known._replace(out_of_distribution=True, log_error_ratio=np.log(2))
    assert "2.0 times the usual" in views.estimate_report(session, the_plane)["warning"]
    session.tracker.report, session.estimating = None, False


def test_images_become_files_of_the_same_size():
    mask = np.zeros((96, 128), bool)
    mask[10:20, 30:50] = True
    read = cv2.imdecode(np.frombuffer(views.encoded(mask), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(read > 127, mask)
    red = np.zeros((4, 6, 3), np.uint8) + np.array([255, 0, 0], np.uint8)
    assert (cv2.imdecode(np.frombuffer(views.encoded(red), np.uint8), cv2.IMREAD_COLOR)[..., 2] == 255).all()


def test_names_ranges_and_sizes_come_from_the_arm(session):
    shown = views.fixtures(session, views.plane(session))
    plain(shown)
    arm = get_arm(session.arm.name)
    assert [name for name, _ in shown["hands"]] == list(arm.command_names)
    assert [limits[:2] for _, limits in shown["hands"]] == [*zip(arm.command_lower, arm.command_upper, strict=True)]
    assert (shown["tension"] is not None) == arm.has_stiffness
    assert len(shown["map"]["dots"]) == len(session.trained.biases)


def test_traces_are_as_long_as_the_history(session, history):
    shown = views.traces(session, history)
    plain(shown)
    titles = [each["title"] for each in shown]
    assert titles[0] == "distance to the target"
    assert shown[0]["limit"] == ("hanging still", session.still_distance)
    assert ("stiffness command" in titles) == session.arm.has_stiffness
    assert all(len(line["values"]) == len(history) for each in shown for line in each["lines"])


def test_a_promise_is_a_second_line_beside_the_distance(session, history):
    def promised(history):
        return [line for line in views.traces(session, history)[0]["lines"] if line["name"] == "predicted at each step"]

    assert not promised(history)
    promises = [replace(moment, predicted=0.25 + k) for k, moment in enumerate(history)]
    (line,) = promised([history[0], *promises])
    assert line["values"] == [None, 0.25, 1.25, 2.25]
    distance = views.traces(session, promises)[0]["lines"][0]
    assert (line["colour"], line["dash"]) != (distance["colour"], distance["dash"])
    assert line["dash"] == 1
    assert [each["fine"] for each in views.traces(session, promises)[0]["lines"]] == [False, True]
    plain(line)


def test_promise_and_outcome_of_a_period_stand_where_it_ended(session, history):
    ended = [replace(moment, period=Period(0.5, 0.75) if k == 2 else None) for k, moment in enumerate(history)]
    shown = views.traces(session, ended)
    plain(shown)
    assert shown[0]["pairs"] == [(2, 0.5, 0.75)]
    assert all(each["pairs"] == [] for each in shown[1:])
    assert views.traces(session, history)[0]["pairs"] == []


def test_a_mark_is_where_a_period_of_the_controller_ended(session, history):
    ended = [replace(moment, period_ended=k == 1) for k, moment in enumerate(history)]
    assert views.frame(session, views.plane(session), ended)["marks"] == [1]
    assert views.frame(session, views.plane(session), history)["marks"] == []


def test_a_frame_before_the_first_step_has_pictures_too(session):
    shown = views.frame(session, views.plane(session), [])
    plain(shown)
    assert all(shown[name] for name in ("scene", "seen", "decoded"))
    assert shown["trail"] == []


def test_controls_stand_where_the_session_is(session):
    shown = views.state(session)
    plain(shown)
    assert (shown["arm"], shown["driver"]) == (session.arm.name, session.driver)
    assert shown["hand"] == pytest.approx(session.command)  # the hand does not drive


def test_the_sliders_of_the_hand_show_what_is_sent(session):
    session.set_driver("random")
    sent = session.step().command
    assert views.state(session)["hand"] == pytest.approx(sent)
    session.set_driver("manual")
    assert views.state(session)["hand"] == pytest.approx(session.hand)
    session.set_driver("random")
    for each in (session.arm.command_lower, session.arm.command_upper):
        session.command = each.astype(np.float32) * np.float32(1 + 1e-6)  # as a controller may round it
        session.set_hand(views.state(session)["hand"])


def test_there_is_one_f_const(session):
    if session.arm.has_stiffness:
        assert views.state(session)["tension"] == [views.state(session)["hand"][2]]
        session.set_tension(45.0)
        shown = views.state(session)
        assert (shown["fixed"], shown["tension"], shown["hand"][2]) == (True, [45.0], 45.0)
        session.set_tension(None)
    else:
        assert views.state(session)["tension"] == []


def test_the_verdict_says_whether_the_network_knows_the_target(session):
    session.set_target(session.gallery["recorded 1"])
    assert views.target(session)["known"]
    session.set_target(np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0)
    shown = views.target(session)
    assert not shown["known"]
    assert "does not reproduce" in shown["verdict"]


def test_only_muscles_have_an_ellipse(session):
    assert bool(views.ellipse(session, session.hand)) == session.arm.has_stiffness
