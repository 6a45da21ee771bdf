"""Recalibration: a known displacement of the camera is found, and images come back."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab.masks import iou
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation._arm_data import get_arm
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies import recalibration
from studies.recalibration import Recalibration, View, recalibrate, take_views

ARM = get_arm("torque")
MOVED = ARM.camera.moved((0.03, -0.03, 0.025), (1.5, -2.0, 1.5))  # 5 cm and 3 degrees


def exact_views(camera, count=8):
    """Views without pixels."""
    rng = np.random.default_rng(0)
    ends = [
        recalibration._bar_ends(ARM, rng.uniform(ARM.lower, ARM.upper))
        for _ in range(count)
    ]
    return [
        View(each, recalibration._project_tips(camera, each[None])[0]) for each in ends
    ]


def turn_between(a, b):
    """Angle between two cameras [degree]."""
    return np.rad2deg(np.arccos(np.clip((np.trace(a.axes @ b.axes.T) - 1) / 2, -1, 1)))


@pytest.fixture(scope="module")
def moved_env():
    """A scene whose camera was moved."""
    env = ClothEnv(replace(ARM, camera=MOVED))
    yield env
    env.close()


@pytest.fixture(scope="module")
def found(moved_env):
    return recalibrate(ARM, take_views(moved_env, shoulder=3, elbow=2))


def test_the_bar_is_found_where_the_robot_knows_it_to_be(env):
    for _ in range(6):
        env.advance([0.2, -0.9])
    seen = recalibration._find_bar(env.picture())
    (tips,) = recalibration._project_tips(
        ARM.camera, recalibration._bar_ends(ARM, ARM.state(env.data)[:2])[None]
    )
    # a pixel
    assert np.sort(seen, axis=0) == pytest.approx(np.sort(tips, axis=0), abs=1 / 480)


def test_no_displacement_leaves_images_as_they_are(env):
    theta, image = ARM.state(env.data)[:2], env.observe()["image"]
    same = Recalibration(ARM, ARM.camera)
    assert same.homography(theta) == pytest.approx(np.eye(3), abs=1e-4)
    assert np.array_equal(same.warp(image, theta), image.astype(bool))


@pytest.mark.parametrize("camera", [ARM.camera, MOVED])
def test_without_pixels_the_pose_is_found_exactly_whichever_end_is_which(camera):
    views = exact_views(camera)
    views[::2] = [view._replace(seen=view.seen[::-1]) for view in views[::2]]
    pose = recalibrate(ARM, views)
    assert pose.camera.position == pytest.approx(camera.position, abs=1e-5)
    assert turn_between(pose.camera, camera) < 1e-3
    assert pose.residual < 1e-6


@pytest.mark.slow
def test_from_pictures_it_is_found_to_a_centimetre_and_half_a_degree(found):
    assert found.residual * 480 < 1  # [pixel]
    assert found.camera.position == pytest.approx(MOVED.position, abs=0.01)
    assert turn_between(found.camera, MOVED) < 0.5


@pytest.mark.slow
def test_images_come_back(moved_env, found):
    here = rollout(ClothEnv(ARM), RandomPolicy(ARM), 20, seed=3)
    seen = rollout(moved_env, ReplayPolicy(here.commands), 20, seed=3)
    assert iou(seen.images, here.images).mean() < 0.6
    assert iou(found.trial(seen).images, here.images).mean() > 0.85


def test_what_says_too_little_is_refused(muscle_env):
    with pytest.raises(ValueError, match="the bar is in 3 pictures; 4 are needed"):
        recalibrate(ARM, exact_views(MOVED, 3))
    with pytest.raises(
        ValueError, match="the muscle arm does not sense its joint angles"
    ):
        take_views(muscle_env)
