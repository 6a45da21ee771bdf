"""Reaching: postures, driving, the approach in closed loop and what can go wrong with it, laying down slowly."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import get_arm
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.table_scene import servoing
from clothlab.table_scene.perception import NotInView, find_cloth
from clothlab.table_scene.scene import Furniture
from clothlab.table_scene.servoing import (
    MissedError,
    Mover,
    OutOfReachError,
    ReachSettings,
    lay_slowly,
    nearest_posture,
    posture,
    take,
)
from clothlab.table_scene.table_env import GraspError, TableEnv

ARM = get_arm("muscle")
SMALL = ReachSettings(height=240)  # pictures of a quarter of the pixels are drawn and searched faster


@pytest.fixture
def mover(table_scene):
    table_scene.start(seed=0)
    return Mover(table_scene, SMALL, samples=1)


def look_at_basket(mover):
    """As after the cloth has been laid: it is out of the way, and the robot looks at the side table."""
    env = mover.env
    env.hold_fast(["cloth_0_0", "cloth_0_1", "cloth_0_2"])
    env.release()
    env.place_cloth(env.cloth_points() + np.array([2.0, 0, 0]))
    base = env.furniture.side_place - env.furniture.look_ahead
    env.data.joint("base").qpos[0] = env.data.actuator("base").ctrl[0] = base
    mujoco.mj_forward(env.model, env.data)


@pytest.mark.parametrize("theta", [(0.4, -0.4), (-0.8, -1.6), (1.0, -0.01), (0.0, -1.0)])
def test_a_posture_is_the_inverse_of_where_the_hand_is(theta):
    assert posture(ARM, ARM.hand(np.array(theta))) == pytest.approx(theta, abs=1e-9)
    assert nearest_posture(ARM, ARM.hand(np.array(theta))) == pytest.approx(theta, abs=1e-9)


@pytest.mark.parametrize("place", [(0.7, 0.0), (0.0, 0.0), (-0.4, 0.0), (0.2, -0.55)])
def test_what_is_out_of_reach_is_refused_or_approached(place):
    with pytest.raises(OutOfReachError, match="m ahead and"):
        posture(ARM, place)
    near = nearest_posture(ARM, place)
    assert ((ARM.lower <= near) & (near <= ARM.upper)).all()
    rng = np.random.default_rng(0)
    others = [ARM.hand(rng.uniform(ARM.lower, ARM.upper)) for _ in range(300)]
    assert np.linalg.norm(ARM.hand(near) - place) < min(np.linalg.norm(np.subtract(others, place), axis=1)) + 0.01


@pytest.mark.parametrize("place", [(np.nan, 0.0), (0.1, 0.2, 0.3), "there"], ids=str)
def test_a_place_is_two_finite_numbers(place):
    with pytest.raises(ValueError, match="place"):
        posture(ARM, place)


def test_the_robot_feels_where_its_hand_is(mover):
    assert mover.felt_hand == pytest.approx(mover.env.hand, abs=1e-6)
    assert mover.from_shoulder(mover.env.hand) == pytest.approx(mover.felt_place(), abs=1e-3)


def test_the_hand_glides_to_a_place_although_the_arm_sags(mover):
    mover.glide([0.45, 0.1])
    assert mover.from_shoulder(mover.env.hand) == pytest.approx([0.45, 0.1], abs=0.01)


def test_the_base_gathers_speed_evenly_and_arrives(mover):
    start, places = mover.env.base, [mover.env.base_goal]
    mover.watch = lambda: places.append(mover.env.base_goal)
    mover.drive(start + 0.8)
    assert mover.env.base == pytest.approx(start + 0.8, abs=1e-3)
    speed = np.diff(places) / CONTROL_PERIOD
    assert speed.max() == pytest.approx(mover.env.furniture.base_speed)
    assert np.abs(np.diff(speed, prepend=0.0)).max() <= 1.001 * SMALL.acceleration * CONTROL_PERIOD
    mover.drive(-9.0)  # no farther than it can
    assert mover.env.base == pytest.approx(mover.env.furniture.base_range[0], abs=1e-3)


def test_the_cloth_is_taken_from_the_rack_by_its_edge(mover):
    env = mover.env
    taken = take(mover, "cloth")
    assert taken.held == ("cloth_0_0", "cloth_0_1", "cloth_0_2")
    assert taken.attempts == 1
    assert np.linalg.norm(taken.errors[-1]) < SMALL.close
    mover.glide([0.45, 0.3])
    assert env.cloth_points()[0].mean(axis=0)[[0, 2]] == pytest.approx(env.hand[[0, 2]], abs=0.002)
    assert env.cloth_points()[-1, :, 2].max() < env.hand[2] - 0.4  # it has left the rack


def test_the_basket_is_taken_by_its_handle(mover):
    look_at_basket(mover)
    assert take(mover, "basket").held == ("basket",)
    mover.glide([0.5, -0.1])
    assert mover.env.data.body("basket").xpos[2] > mover.env.furniture.side_height + 0.1


def stand_still(mover, monkeypatch):
    """What moves the robot from place to place does nothing, so that what comes between is tested alone."""
    for name in ("drive", "glide"):
        monkeypatch.setattr(mover, name, lambda *args, **options: None)


def test_a_missed_grasp_is_tried_once_more(mover, monkeypatch):
    grasp, calls = mover.env.grasp, []

    def slips_once():
        calls.append(mover.env.base)
        if len(calls) == 1:
            raise GraspError("it slipped")
        return grasp()

    monkeypatch.setattr(mover.env, "grasp", slips_once)
    taken = take(mover, "cloth")
    assert taken.attempts == 2
    assert len(taken.held) == 3


def test_a_grasp_missed_twice_is_a_failure_that_says_why(mover, monkeypatch):
    stand_still(mover, monkeypatch)
    monkeypatch.setattr(servoing, "_approach", lambda mover, what, seen: (seen, [np.zeros(2)]))
    message = r"the cloth was not grasped, in two attempts: nothing within 3 cm of the hand; nearest is cloth_\d_\d"
    with pytest.raises(MissedError, match=message):
        take(mover, "cloth")


def test_an_approach_that_gets_nowhere_ends(mover, monkeypatch):
    stand_still(mover, monkeypatch)
    mover.settings = replace(SMALL, steps=2)
    with pytest.raises(MissedError, match=r"after 2 steps the hand is still \d+\.\d cm from its goal"):
        take(mover, "cloth")


def test_what_the_hand_hides_is_where_it_was_seen_last(mover):
    seen = find_cloth(mover.look())
    env = mover.env
    env.place_cloth(env.cloth_points() + np.array([0.01, 0, 0]))  # moved a little: followed
    closer = servoing._look_again("cloth", mover.look(), seen)
    assert closer.place[0] == pytest.approx(seen.place[0] + 0.01, abs=0.004)
    env.place_cloth(env.cloth_points() + np.array([0.0, 0.1, 0]))  # leapt, as when a part of it is hidden
    assert servoing._look_again("cloth", mover.look(), seen) is seen
    env.place_cloth(env.cloth_points() + np.array([3.0, 0, 0]))  # hidden
    assert servoing._look_again("cloth", mover.look(), seen) is seen


def test_a_cloth_out_of_view_is_looked_for_once_more_from_behind(mover):
    env = mover.env
    base = env.base
    env.place_cloth(env.cloth_points() + np.array([3.0, 0, 0]))
    env.hold_fast(["cloth_0_0", "cloth_0_1", "cloth_0_2"])
    env.release()
    with pytest.raises(NotInView, match="no cloth in view"):
        take(mover, "cloth")
    assert env.base == pytest.approx(base - 0.15, abs=1e-3)


def test_what_cannot_be_taken_lists_what_can(mover):
    with pytest.raises(KeyError, match="unknown thing to take 'cup'; choose from cloth, basket"):
        take(mover, "cup")


def test_whoever_watches_can_stop_the_robot(mover):
    def stop():
        raise InterruptedError

    mover.watch = stop
    with pytest.raises(InterruptedError):
        take(mover, "cloth")


def lay(near):
    env = TableEnv(start_in="hand", furniture=Furniture(near=near))
    env.start(seed=0)
    mover = Mover(env, samples=1)
    lay_slowly(mover)
    for _ in range(5):
        mover.step()
    env.close()
    return env.lies()


def test_a_cloth_is_laid_slowly_where_the_robot_gets_near_enough_to_the_table():
    assert lay(near=0.15).success


def test_a_cloth_laid_slowly_where_the_robot_does_not_reach_is_no_cloth_spread():
    assert not lay(near=0.45).success


@pytest.mark.parametrize("wrong", [{"gain": 0.0}, {"steps": 0}, {"close": -1.0}, {"height": 10}], ids=str)
def test_settings_that_reach_nothing_are_refused(wrong):
    with pytest.raises(ValueError, match=f"ReachSettings.{next(iter(wrong))}"):
        replace(SMALL, **wrong)


def test_everything_that_can_be_taken_has_its_finder():
    assert set(servoing.FINDERS) == {"cloth", "basket"}
