"""What the panel shows is plain data, made of what the session holds."""

import contextlib
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

import studies
from clothlab import data
from clothlab.analysis import inside
from clothlab.lab import views
from clothlab.lab.drivers import Period
from clothlab.lab.map import Plane
from clothlab.lab.session import SETUPS, LiveSession
from clothlab.lab.views import ellipse_at_hand, encoded, outlined
from clothlab.method.autoencoder import decode, encode
from clothlab.simulation.arm import MuscleArm

pytestmark = pytest.mark.slow  # both arms have a session

BIASES = {
    "a": np.array([1.0, 0.0]),
    "b": np.array([-1.0, 0.5]),
    "c": np.array([0.0, -2.0]),
}


@pytest.fixture(scope="module", params=["torque", "muscle"])
def session(request, tmp_path_factory):
    session = LiveSession(
        request.param,
        recordings=tmp_path_factory.mktemp("mine"),
        picture_size=(96, 128),
    )
    session.set_driver("random")
    yield session
    session.close()


@pytest.fixture(scope="module")
def history(session):
    return [session.step() for _ in range(3)]


@pytest.fixture
def shown(session):
    return views.Views(session)


def plain(value):
    """The value, if JSON has a word for all of it but bytes."""
    json.dumps(
        value, default=lambda each: "bytes" if isinstance(each, bytes) else 1 / 0
    )
    return value


def test_a_place_on_the_map_is_a_p_and_back_with_its_region_around_it():
    plane, covariance = (
        Plane(BIASES, {"a": "first"}),
        np.array([[0.04, 0.01], [0.01, 0.09]]),
    )
    for p in BIASES.values():
        assert plane.p(plane.at(p)) == pytest.approx(p)
    assert [dot["label"] for dot in plane.map["dots"]] == ["first", "b", "c"]
    assert all(
        max(map(abs, dot["at"])) < plane.map["reach"] for dot in plane.map["dots"]
    )
    edge = plane.region(BIASES["a"], covariance)
    assert np.mean(edge[:-1], axis=0) == pytest.approx(plane.at(BIASES["a"]), abs=0.01)
    assert all(inside(plane.p(at), BIASES["a"], 1.01 * covariance) for at in edge)
    assert not any(inside(plane.p(at), BIASES["a"], 0.99 * covariance) for at in edge)


def test_the_region_is_shown_while_p_is_estimated(session, shown, monkeypatch):
    covariance = 0.01 * np.eye(2)
    monkeypatch.setattr(LiveSession, "covariance", property(lambda _: covariance))
    assert shown.frame([])["region"] == []
    session.estimating = True
    assert len(plain(shown.frame([])["region"])) > 10
    assert shown.frame([])["warning"] == ""
    covariance = None
    assert shown.frame([])["region"] == []
    session.estimating = False
    monkeypatch.setattr(LiveSession, "unfamiliar", True)
    assert "unlike the trained ones" in shown.frame([])["warning"]


def test_names_and_ranges_come_from_the_arm(session, shown):
    about, arm = plain(shown.about()), session.arm
    assert about["arms"] == list(SETUPS)
    assert [name for name, _ in about["hands"]] == list(arm.command_names)
    assert [limits[:2] for _, limits in about["hands"]] == [
        *zip(arm.command_lower, arm.command_upper, strict=True)
    ]
    assert (
        (about["tension"] is not None)
        == arm.has_stiffness
        == bool(shown.ellipse(session.hand))
    )
    assert len(about["map"]["dots"]) == len(session.trained.biases)


def test_a_frame_has_pictures_and_traces_as_long_as_the_history(
    session, shown, history
):
    for steps in ([], history):
        frame = plain(shown.frame(steps))
        assert frame["scene"]
        image = steps[-1].image if steps else session.observation["image"]
        autoencoder = session.trained.autoencoder
        decoded = decode(autoencoder, encode(autoencoder, image.astype(bool)))
        seen = outlined(image.astype(bool), session.target)
        assert frame["seen"] == encoded(seen)
        assert frame["decoded"] == encoded(decoded)
        assert len(frame["trail"]) == len(steps)
        assert all(
            len(line["values"]) == len(steps)
            for each in frame["traces"]
            for line in each["lines"]
        )
    titles = [each["title"] for each in frame["traces"]]
    assert titles[0] == "distance to the target"
    assert frame["traces"][0]["limit"] == ("hanging still", session.still_distance)
    assert ("stiffness command" in titles) == session.arm.has_stiffness


def picture(file):
    """The grey picture in a file, 0 to 255."""
    return cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_GRAYSCALE)


def test_beside_what_the_camera_sees_stands_what_the_autoencoder_makes_of_it(
    session, shown, history
):
    # A cloth can be decoded so well that the two pictures are the same; a board can't
    board = np.indices((96, 128)).sum(axis=0) % 2 == 1
    last = replace(history[-1], image=board)
    hanging = session.observation["image"] > 0
    for steps, seen, made_of in (
        ([], hanging, hanging),
        (history, history[-1].image, history[-1].image),
        ([last], board, history[-1].image),
    ):
        frame = shown.frame(steps)
        autoencoder = session.trained.autoencoder
        decoded = decode(autoencoder, encode(autoencoder, made_of))
        camera = cv2.imdecode(np.frombuffer(frame["seen"], np.uint8), cv2.IMREAD_COLOR)
        edge = (camera != camera[..., :1]).any(axis=2)
        assert np.array_equal(camera[~edge][:, 0], 255 * seen[~edge])
        assert 0 < edge.sum() < session.target.sum()
        assert session.target[edge].all()
        assert picture(frame["decoded"]) / 255 == pytest.approx(decoded, abs=0.02)


def test_predictions_stand_beside_the_distance_and_where_their_period_ended(
    shown, history
):
    first, *others = history
    ended = [
        first,
        *(
            replace(moment, predicted=0.25, period_ended=k == 1)
            for k, moment in enumerate(others)
        ),
    ]
    ended[2] = replace(ended[2], period=Period(0.5, 0.75))
    frame = plain(shown.frame(ended))
    distance, predicted = frame["traces"][0]["lines"]
    assert (predicted["name"], predicted["values"]) == (
        "predicted at each step",
        [None, 0.25, 0.25],
    )
    assert (predicted["colour"], predicted["dash"], predicted["fine"]) != (
        distance["colour"],
        0,
        False,
    )
    assert (frame["marks"], frame["traces"][0]["pairs"]) == ([2], [(2, 0.5, 0.75)])
    frame = shown.frame(history)
    assert (
        frame["marks"],
        frame["traces"][0]["pairs"],
        len(frame["traces"][0]["lines"]),
    ) == ([], [], 1)


def test_the_sliders_of_the_hand_show_what_is_sent(session, shown):
    sent = session.step().command
    assert plain(shown.state())["hand"] == pytest.approx(sent)
    session.set_driver("manual")
    assert shown.state()["hand"] == pytest.approx(session.hand)
    session.set_driver("random")
    for each in (session.arm.command_lower, session.arm.command_upper):
        # As a controller may round it
        session.command = each.astype(np.float32) * np.float32(1 + 1e-6)
        session.set_hand(shown.state()["hand"])
    if session.arm.has_stiffness:
        assert shown.state()["tension"] == [shown.state()["hand"][2]]
        session.set_tension(45.0)
        state = shown.state()
        assert (state["fixed"], state["tension"], state["hand"][2]) == (
            True,
            [45.0],
            45.0,
        )
        session.set_tension(None)


def test_the_verdict_says_whether_the_autoencoder_reproduces_the_target(session, shown):
    session.set_target(session.gallery["recorded 1"])
    assert plain(shown.target())["known"]
    assert shown.target()["verdict"].startswith("Known shape. ")
    session.set_target(np.indices((96, 128)).sum(axis=0) // 8 % 2 == 0)
    assert not shown.target()["known"]
    assert (
        shown.target()["verdict"]
        == "Not reachable. The autoencoder does not reproduce it."
    )


def test_what_is_called_reachable_is_reached_by_a_search_on_the_true_simulator(
    monkeypatch,
):
    # As outside of tests
    monkeypatch.setattr("clothlab.lab.targets.REFERENCE_EVERY", 20)
    searched = studies.load("oracle_transfer").query("overlap")
    with contextlib.closing(LiveSession()) as session:
        for target, best in zip(
            searched["target"], searched["iou"].map(np.max), strict=True
        ):
            session.set_target(data.load_target(target))
            verdict = views.Views(session).target()["verdict"]
            assert (
                best < 0.55 if verdict.startswith("Not reachable") else best >= 0.5
            ), (target, verdict, best)


def test_the_ellipse_lies_around_the_hand_and_is_smaller_the_stiffer_the_arm():
    arm, theta = MuscleArm(), np.array([0.3, -1.0])
    figures = [ellipse_at_hand(arm, theta, f_const) for f_const in (10.0, 70.0)]
    (links, soft), (_, stiff) = (figure.axes[0].lines for figure in figures)
    hand = [line[-1] for line in links.get_data()]
    assert hand == pytest.approx(arm.hand(theta))
    assert np.mean(stiff.get_xydata()[:-1], axis=0) == pytest.approx(hand, abs=0.02)
    assert np.ptp(soft.get_xydata(), axis=0) == pytest.approx(
        3.3 * np.ptp(stiff.get_xydata(), axis=0), rel=0.1
    )
