"""Registration: what did not move stays as it was, a known displacement is found, and images come back."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab.experiments.recalibration import (
    Registered,
    Registration,
    RegistrationSettings,
    View,
    bar_ends,
    find_bar,
    look,
    project,
    project_tips,
    register,
)
from clothlab.learning.autoencoder import iou
from clothlab.policies import FunctionPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout

ARM = get_arm("torque")
SHIFT, TURN = (0.03, -0.03, 0.025), (1.5, -2.0, 1.5)  # 5 cm and 3 degrees
MOVED = ARM.camera.moved(SHIFT, TURN)
FEW = RegistrationSettings(shoulder=3, elbow=2)


def exact_views(camera, count=8):
    """Views without pixels."""
    rng = np.random.default_rng(0)
    ends = [bar_ends(ARM, rng.uniform(ARM.lower, ARM.upper)) for _ in range(count)]
    return [View(each, project_tips(camera, each[None])[0]) for each in ends]


def turned(a, b):
    """Angle between two cameras [degree]."""
    return np.rad2deg(np.arccos(np.clip((np.trace(a.axes @ b.axes.T) - 1) / 2, -1, 1)))


@pytest.fixture(scope="module")
def there():
    """A scene whose camera was moved."""
    env = ClothEnv(replace(ARM, camera=MOVED))
    yield env
    env.close()


@pytest.fixture(scope="module")
def found(there):
    return register(ARM, look(there, FEW), FEW)


def test_the_bar_is_found_where_the_robot_knows_it_to_be(env):
    for _ in range(6):
        env.advance([0.2, -0.9])
    ends = bar_ends(ARM, ARM.state(env.data)[:2])
    seen = find_bar(env.picture())
    (tips,) = project_tips(ARM.camera, ends[None])
    assert np.sort(seen, axis=0) == pytest.approx(np.sort(tips, axis=0), abs=1 / 480)  # a pixel


def test_pictures_without_a_whole_bar_say_so(env):
    picture = env.picture().copy()
    assert find_bar(picture) is not None
    assert find_bar(np.full_like(picture, 200)) is None
    picture[:10, 5:15] = 0
    assert find_bar(picture) is None  # it seems to reach the border


def test_no_displacement_leaves_images_as_they_are(env):
    theta, image = ARM.state(env.data)[:2], env.observe()["image"]
    same = Registration(ARM, ARM.camera)
    assert same.homography(theta) == pytest.approx(np.eye(3), abs=1e-4)
    assert np.array_equal(same.mask(image, theta), image.astype(bool))
    found = register(ARM, exact_views(ARM.camera))
    assert found.camera.position == pytest.approx(ARM.camera.position, abs=1e-6)
    assert found.residual < 1e-8


def test_without_pixels_the_displacement_is_found_exactly():
    found = register(ARM, exact_views(MOVED))
    assert found.camera.position == pytest.approx(MOVED.position, abs=1e-5)
    assert turned(found.camera, MOVED) < 1e-3


def test_a_hidden_end_of_the_bar_does_little_harm():
    views = exact_views(MOVED, 12)
    views[3] = replace(views[3], seen=views[3].seen + np.array([[0.08, 0.05], [0, 0]]))
    found = register(ARM, views)
    assert found.camera.position == pytest.approx(MOVED.position, abs=0.01)
    assert turned(found.camera, MOVED) < 0.3


def test_which_end_is_which_does_not_matter():
    views = exact_views(MOVED)
    swapped = [replace(view, seen=view.seen[::-1]) for view in views]
    assert register(ARM, swapped).camera.position == pytest.approx(MOVED.position, abs=1e-5)


def test_from_pictures_it_is_found_to_a_centimetre_and_half_a_degree(found):
    assert found.residual * 480 < 1  # [pixel]
    assert found.camera.position == pytest.approx(MOVED.position, abs=0.01)
    assert turned(found.camera, MOVED) < 0.5


def test_images_come_back(there, found):
    here = rollout(ClothEnv(ARM), RandomPolicy(ARM), 20, seed=3)
    seen = rollout(there, ReplayPolicy(here.commands), 20, seed=3)
    back = found.trial(seen)
    assert iou(seen.images, here.images).mean() < 0.6
    assert iou(back.images, here.images).mean() > 0.85
    assert np.array_equal(back.commands, here.commands)


def test_a_policy_sees_what_the_old_camera_would_have_seen(there, found):
    there.start()
    told = []
    policy = Registered(FunctionPolicy(lambda observation: told.append(observation) or [0.1, -0.4]), found)
    observation = there.observe()
    before = observation["image"].copy()
    assert policy(observation).tolist() == [0.1, -0.4]
    assert np.array_equal(told[0]["image"], found.mask(before, observation["robot"][:2]))
    assert np.array_equal(observation["image"], before)
    assert told[0]["image"].dtype == np.int8


def test_a_turn_is_undone_exactly_at_any_distance():
    camera = ARM.camera.moved(turn=(2, 3, 4))
    registration, points = Registration(ARM, camera), np.array([[0.5, 0.1, 0.9], [0.2, -0.3, 0.4]])
    matrix = registration.homography([0.4, -0.4])
    old, new = (project(each, points) * 96 - 0.5 for each in (ARM.camera, camera))
    there = np.column_stack([old, np.ones(2)]) @ matrix.T
    assert there[:, :2] / there[:, 2:] == pytest.approx(new, abs=1e-2)


def test_the_hand_is_where_it_was_whatever_the_displacement():
    registration, theta = Registration(ARM, MOVED), np.array([0.1, -1.0])
    middle = bar_ends(ARM, theta).mean(axis=0, keepdims=True)
    (old,), (new,) = (project(each, middle) * 96 - 0.5 for each in (ARM.camera, MOVED))
    there = registration.homography(theta) @ [*old, 1]
    assert there[:2] / there[2] == pytest.approx(new, abs=1e-2)


def test_what_says_too_little_is_refused(muscle_env):
    with pytest.raises(ValueError, match="the bar is in 3 pictures; 4 are needed"):
        register(ARM, exact_views(MOVED, 3))
    with pytest.raises(ValueError, match="the muscle arm does not sense its joint angles"):
        look(muscle_env)
    with pytest.raises(ValueError, match=r"theta is \[2\] and finite"):
        Registration(ARM, MOVED).homography([0.1])
    with pytest.raises(ValueError, match="cloth images are"):
        Registration(ARM, MOVED).mask(np.zeros((3, 3)), [0.1, 0.2])
    with pytest.raises(ValueError, match=r"RegistrationSettings.margin must be at most 0.4"):
        RegistrationSettings(margin=0.6)
