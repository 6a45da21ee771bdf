"""The phases of setting a table: what each does, what stops it, and its outcome."""

import numpy as np
import pytest

from studies.table_scene import task
from studies.table_scene.perception import NotVisibleError, find_cloth_centre
from studies.table_scene.scene import Basket
from studies.table_scene.servoing import RobotDriver
from studies.table_scene.table_env import ClothPose, Placement, TableEnv
from studies.table_scene.task import (
    PHASES,
    Outcome,
    _NotSpreadError,
    _put_basket,
    _see_spread,
    set_table,
)
from studies.table_scene.throwing import laid_by_hand

pytestmark = pytest.mark.slow  # a scene with depth pictures

GOOD = ClothPose(1.0, 1.0, 0.0, np.array([0.66, 0.0, 0.603]))


@pytest.fixture(scope="module")
def _table():
    env = TableEnv("muscle-hand", start_in="hand")
    yield env
    env.close()


@pytest.fixture
def driver(_table):
    _table.start(seed=0)
    return RobotDriver(_table, height=240, samples=1)


@pytest.fixture
def laid(driver):
    """With the cloth on the table, as a person laid it by hand."""
    laid_by_hand(driver.env, 0.66)
    return driver


@pytest.fixture
def run(monkeypatch, driver):
    """Runs a task in which no phase does anything but what a test puts in its place."""

    def run(spreader=lambda driver: None, **instead):
        usual = {"_see_spread": lambda driver: GOOD}
        for name in (
            "grasp",
            "go_to_table",
            "_see_spread",
            "find_cloth_centre",
            "fetch_basket",
        ):
            monkeypatch.setattr(
                task, name, instead.get(name, usual.get(name, lambda *_: None))
            )
        for name in ("_carry_basket", "_put_basket"):
            monkeypatch.setattr(task, name, instead.get(name, lambda *_: None))
        begun = []
        return set_table(driver, spreader, begun.append), begun

    return run


def fail(error):
    def phase(*_):
        raise error

    return phase


def test_a_task_has_its_phases_in_order_and_says_so(run):
    outcome, begun = run()
    assert tuple(begun) == PHASES
    assert (outcome.failed, outcome.cause) == ("", "")
    assert outcome.grasped
    # The cloth is in the hand all the time, and the basket where it was
    assert not outcome.success


@pytest.mark.parametrize(
    ("name", "phase", "error"),
    [
        ("grasp", "fetch cloth", NotVisibleError("no cloth in view")),
        ("_see_spread", "look", _NotSpreadError("it is turned")),
        ("find_cloth_centre", "look", NotVisibleError("nothing there")),
        ("fetch_basket", "fetch basket", task.GraspError("missed")),
        ("_put_basket", "put basket", task.GraspError("too far")),
    ],
)
def test_a_failure_ends_the_task_and_has_its_phase_and_cause(run, name, phase, error):
    outcome, begun = run(**{name: fail(error)})
    assert (outcome.failed, outcome.cause) == (phase, str(error))
    assert begun[-1] == phase
    assert outcome.grasped == (phase != "fetch cloth")
    assert (outcome.pose is not None) == (PHASES.index(phase) >= PHASES.index("look"))
    assert (outcome.placement is not None) == (phase == "put basket")


@pytest.mark.parametrize(
    ("area", "off", "dragged", "success"),
    [
        (1.0, 0.0, 0.0, True),
        (0.8, 0.0, 0.0, False),
        (1.0, 0.05, 0.0, False),
        (1.0, 0.0, 0.021, False),
    ],
)
def test_a_table_is_set_when_cloth_and_basket_are_where_they_should(
    area, off, dragged, success
):
    pose, stands = ClothPose(1.0, area, 0.0, np.zeros(3)), Placement(1.0, off, True)
    assert Outcome("", "", True, None, pose, stands, dragged, 9).success == success
    assert not Outcome("", "", True, None, pose, None, dragged, 9).success
    assert not Outcome("", "", True, None, None, stands, 0.0, 9).success


def test_the_robot_sees_how_the_cloth_lies(laid):
    env = laid.env
    assert _see_spread(laid).spread
    assert find_cloth_centre(laid.capture(), 0.6)[:2] == pytest.approx(
        [0.66, 0.0], abs=0.01
    )
    points = env.cloth_points()
    folded = points.copy()
    folded[:3] = points[:2:-1]
    for place, fault in (
        (points[::-1], "the wrong way round"),
        (folded, "folded or hangs over the edge"),
        (points - [0.0, 0.0, 0.55], r"no cloth in view|not lie flat"),
    ):
        env.place_cloth(place)
        with pytest.raises(_NotSpreadError, match=fault):
            _see_spread(laid)


def test_a_basket_in_the_hand_is_put_on_the_cloth(laid):
    env = laid.env
    env.place_cloth(env.cloth_points() - [0.16, 0.0, 0.0])
    laid.move_straight([0.485, -0.08])
    env.data.joint("basket").qpos[:] = [
        *(env.hand - [0.0, 0.0, Basket.handle_height]),
        1.0,
        0.0,
        0.0,
        0.0,
    ]
    env.hold_fast(["basket"])
    before = env.cloth_points().mean(axis=(0, 1))
    _put_basket(laid, np.array([0.50, 0.0, 0.603]))
    assert env.held == ()
    assert env.placement().success
    assert np.linalg.norm(env.cloth_points().mean(axis=(0, 1)) - before) < 0.02
