"""Visual servoing: postures, driving, the approach in closed loop and what can go wrong
with it, laying down slowly.
"""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import get_arm
from clothlab.simulation.env import CONTROL_PERIOD
from studies.table_scene import servoing
from studies.table_scene.gripping import GraspError
from studies.table_scene.perception import NotVisibleError, find_cloth_edge
from studies.table_scene.scene import Furniture
from studies.table_scene.servoing import RobotDriver, grasp, lay_slowly, posture
from studies.table_scene.table_env import TableEnv

pytestmark = pytest.mark.slow  # a scene with depth pictures

ARM = get_arm("muscle")
# Pictures of a quarter of the pixels are drawn and searched faster
SMALL = {"height": 240, "samples": 1}
EDGE = ("cloth_0_0", "cloth_0_1", "cloth_0_2")


@pytest.fixture
def driver(table_scene):
    table_scene.start(seed=0)
    return RobotDriver(table_scene, **SMALL)


def clear_cloth(env, shift=(3.0, 0, 0)):
    """Take the cloth off the rack and put it elsewhere."""
    env.hold_fast(EDGE)
    env.release()
    env.place_cloth(env.cloth_points() + np.array(shift))


@pytest.mark.parametrize(
    "theta", [(0.4, -0.4), (-0.8, -1.6), (1.0, -0.01), (0.0, -1.0)]
)
def test_a_posture_is_the_inverse_of_where_the_hand_is(theta):
    assert posture(ARM, ARM.hand(np.array(theta))) == pytest.approx(theta, abs=1e-9)


@pytest.mark.parametrize("place", [(0.7, 0.0), (0.0, 0.0), (-0.4, 0.0), (0.2, -0.55)])
def test_what_is_out_of_reach_is_approached(place):
    near = posture(ARM, place)
    assert ((ARM.lower <= near) & (near <= ARM.upper)).all()
    rng = np.random.default_rng(0)
    others = [ARM.hand(rng.uniform(ARM.lower, ARM.upper)) for _ in range(300)]
    assert (
        np.linalg.norm(ARM.hand(near) - place)
        < min(np.linalg.norm(np.subtract(others, place), axis=1)) + 0.01
    )


def test_proprioception_says_where_the_hand_is_and_leads_it_to_a_place_although_the_arm_sags(
    driver,
):
    assert driver.proprioceptive_hand == pytest.approx(driver.env.hand, abs=1e-6)
    driver.move_straight([0.45, 0.1])
    assert driver.proprioceptive_place == pytest.approx([0.45, 0.1], abs=0.01)
    assert driver.from_shoulder(driver.env.hand) == pytest.approx([0.45, 0.1], abs=0.01)


def test_the_base_gathers_speed_evenly_and_arrives(driver):
    start, places = driver.env.base, [driver.env.base_goal]
    driver.watch = lambda: places.append(driver.env.base_goal)
    driver.drive(start + 0.8)
    assert driver.env.base == pytest.approx(start + 0.8, abs=1e-3)
    speed = np.diff(places) / CONTROL_PERIOD
    assert speed.max() == pytest.approx(driver.env.furniture.base_speed)
    assert (
        np.abs(np.diff(speed, prepend=0.0)).max()
        <= 1.001 * servoing._ACCELERATION * CONTROL_PERIOD
    )
    driver.drive(-9.0)  # no farther than it can
    assert driver.env.base == pytest.approx(
        driver.env.furniture.base_range[0], abs=1e-3
    )


def test_the_basket_is_grasped_by_its_handle(driver):
    env = driver.env
    clear_cloth(env)
    base = env.furniture.side_place[0] - env.furniture.look_ahead
    env.data.joint("base").qpos[0] = env.data.actuator("base").ctrl[0] = base
    mujoco.mj_forward(env.model, env.data)
    grasp(driver, "basket")
    assert env.held == ("basket",)
    driver.move_straight([0.5, -0.1])
    assert env.data.body("basket").xpos[2] > env.furniture.side_place[2] + 0.1


def test_the_cloth_is_grasped_from_the_rack_by_its_edge_in_two_attempts(
    driver, monkeypatch
):
    env, close, calls = driver.env, driver.env.grasp, []

    def slips_once():
        calls.append(env.base)
        if len(calls) == 1:
            raise GraspError("it slipped")
        return close()

    monkeypatch.setattr(env, "grasp", slips_once)
    errors = grasp(driver, "cloth")
    assert (len(calls), env.held) == (2, EDGE)
    assert np.linalg.norm(errors[-1]) < servoing._CLOSE
    driver.move_straight([0.45, 0.3])
    assert env.cloth_points()[0].mean(axis=0)[[0, 2]] == pytest.approx(
        env.hand[[0, 2]], abs=0.002
    )
    # It has left the rack
    assert env.cloth_points()[-1, :, 2].max() < env.hand[2] - 0.4


@pytest.fixture
def standing(driver, monkeypatch):
    """What moves the robot from place to place does nothing, so that what comes between
    is tested alone.
    """
    for name in ("drive", "move_straight"):
        monkeypatch.setattr(driver, name, lambda *args: None)
    return driver


def test_a_grasp_missed_twice_is_a_failure_that_says_why(standing, monkeypatch):
    monkeypatch.setattr(
        standing, "servo", lambda find_goal, direction: np.zeros((1, 2))
    )
    message = r"the cloth was not grasped, in two attempts: nothing within 3 cm of the hand; nearest is cloth_\d_\d"
    with pytest.raises(GraspError, match=message):
        grasp(standing, "cloth")


def test_an_approach_that_gets_nowhere_ends(standing, monkeypatch):
    monkeypatch.setattr(servoing, "_STEPS", 2)
    with pytest.raises(
        GraspError, match=r"after 2 steps the hand is still \d+\.\d cm from its goal"
    ):
        grasp(standing, "cloth")


def test_what_the_hand_hides_is_where_it_was_seen_last(driver):
    env, far = driver.env, np.zeros(3)
    place = find_cloth_edge(driver.capture()).mean(axis=0)
    track = servoing._tracker(servoing._THINGS["cloth"], place)
    # Moved a little: followed
    env.place_cloth(env.cloth_points() + np.array([0.01, 0, 0]))
    # But for a bar so near that it hides it
    assert track(driver.capture(), place) is place
    moved = track(driver.capture(), far)
    assert moved[0] == pytest.approx(place[0] + 0.01, abs=0.004)
    # Leapt, as when a part of it is hidden
    env.place_cloth(env.cloth_points() + np.array([0.0, 0.1, 0]))
    assert track(driver.capture(), far) is moved
    env.place_cloth(env.cloth_points() + np.array([3.0, 0, 0]))  # hidden
    assert track(driver.capture(), far) is moved


def test_a_cloth_out_of_view_is_looked_for_once_more_from_behind(driver):
    base = driver.env.base
    clear_cloth(driver.env)
    with pytest.raises(NotVisibleError, match="no cloth in view"):
        grasp(driver, "cloth")
    assert driver.env.base == pytest.approx(base - 0.15, abs=1e-3)


@pytest.mark.parametrize(("near", "spread"), [(0.15, True), (0.45, False)])
def test_a_cloth_is_laid_slowly_where_the_robot_gets_near_enough_to_the_table(
    near, spread
):
    env = TableEnv(start_in="hand", furniture=Furniture(near=near))
    env.start(seed=0)
    driver = RobotDriver(env, samples=1)
    lay_slowly(driver)
    for _ in range(5):
        driver.step()
    env.close()
    assert env.cloth_pose().spread == spread
