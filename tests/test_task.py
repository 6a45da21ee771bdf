"""The phases of an episode: what each does, what stops it, and what is said of it then."""

import numpy as np
import pytest

from clothlab.policies import ReplayPolicy
from clothlab.table_scene import task
from clothlab.table_scene.perception import LaidCloth, NotInView, SeenSpread
from clothlab.table_scene.servoing import Mover, ReachSettings
from clothlab.table_scene.table_env import Placement, Spread, TableEnv, placement
from clothlab.table_scene.task import PHASES, Episode, NotSpreadError, Outcome, put_basket, see_laid, see_spread, throw
from clothlab.table_scene.throwing import laid_by_hand

SMALL = ReachSettings(height=240)
GOOD = SeenSpread(1.0, 1.0, 0.0, True, np.array([0.66, 0.0, 0.603]))


@pytest.fixture(scope="module")
def _table():
    env = TableEnv("muscle-hand", start_in="hand")
    yield env
    env.close()


@pytest.fixture
def mover(_table):
    _table.start(seed=0)
    return Mover(_table, SMALL, samples=1)


@pytest.fixture
def laid(mover):
    """With the cloth on the table, as somebody laid it by hand."""
    laid_by_hand(mover.env, 0.66)
    return mover


@pytest.fixture
def play(monkeypatch, mover):
    """Runs an episode in which no phase does anything but what a test puts in its place."""

    def run(spreader=lambda mover: None, **instead):
        usual = {"see_spread": lambda mover: GOOD}
        for name in ("fetch_cloth", "go_to_table", "see_laid", "fetch_basket", "see_spread"):
            monkeypatch.setattr(task, name, instead.get(name, usual.get(name, lambda mover: None)))
        for name in ("carry_basket", "put_basket"):
            monkeypatch.setattr(task, name, instead.get(name, lambda mover, laid: None))
        begun = []
        return Episode(mover, spreader, begun.append).run(), begun

    return run


def fail(error):
    def phase(*_):
        raise error

    return phase


def test_an_episode_has_its_phases_in_order_and_says_so(play):
    outcome, begun = play()
    assert tuple(begun) == PHASES
    assert (outcome.failed, outcome.cause) == ("", "")
    assert outcome.grasped
    assert not outcome.success  # the cloth is in the hand all the time, and the basket where it was


@pytest.mark.parametrize(
    ("name", "phase", "error"),
    [
        ("fetch_cloth", "fetch cloth", NotInView("no cloth in view")),
        ("see_spread", "look", NotSpreadError("it is turned")),
        ("see_laid", "look", NotInView("nothing there")),
        ("fetch_basket", "fetch basket", task.MissedError("missed")),
        ("put_basket", "put basket", task.OutOfReachError("too far")),
    ],
)
def test_a_failure_ends_the_episode_and_has_its_phase_and_cause(play, name, phase, error):
    outcome, begun = play(**{name: fail(error)})
    assert (outcome.failed, outcome.cause) == (phase, str(error))
    assert begun[-1] == phase
    assert outcome.grasped == (phase != "fetch cloth")
    assert (outcome.spread is not None) == (PHASES.index(phase) >= PHASES.index("look"))
    assert (outcome.placement is not None) == (phase == "put basket")


def test_who_stops_the_robot_is_not_a_failure(play):
    with pytest.raises(InterruptedError):
        play(spreader=fail(InterruptedError()))


def outcome(spread=None, stands=None, dragged=None):
    return Outcome("", "", True, None, spread, stands, dragged, 9)


@pytest.mark.parametrize(
    ("area", "off", "dragged", "success"),
    [(1.0, 0.0, 0.0, True), (0.8, 0.0, 0.0, False), (1.0, 0.05, 0.0, False), (1.0, 0.0, 0.021, False)],
)
def test_a_table_is_set_when_cloth_and_basket_are_where_they_should(area, off, dragged, success):
    lies, stands = Spread(1.0, area, 0.0, np.zeros(3)), Placement(1.0, off, True)
    assert outcome(lies, stands, dragged).success == success
    assert not outcome(lies).success
    assert not outcome(None, stands, 0.0).success


def test_a_cloth_that_lies_well_is_seen_and_found(laid):
    assert see_spread(laid).success
    assert see_laid(laid).centre[:2] == pytest.approx([0.66, 0.0], abs=0.01)


def test_what_does_not_lie_well_is_told_apart(laid):
    env = laid.env
    points = env.cloth_points()
    env.place_cloth(points[::-1])
    with pytest.raises(NotSpreadError, match="the wrong way round"):
        see_spread(laid)
    folded = points.copy()
    folded[:3] = points[:2:-1]
    env.place_cloth(folded)
    with pytest.raises(NotSpreadError, match="folded or hangs over the edge"):
        see_spread(laid)
    env.place_cloth(points - [0.0, 0.0, 0.55])
    with pytest.raises(NotSpreadError, match=r"no cloth in view|not lie flat"):
        see_spread(laid)


def test_a_throw_ends_when_it_is_done(mover):
    seen = []
    throw(mover, lambda observation: seen.append(observation) or mover.env.arm.home_command, 9, lambda: len(seen) == 2)
    assert mover.steps == len(seen) == 2
    throw(mover, ReplayPolicy([mover.env.arm.home_command] * 2), 2)
    assert mover.steps == 4


def test_a_basket_in_the_hand_is_put_on_the_cloth(laid):
    env = laid.env
    found = LaidCloth(np.array([0.50, 0.0, 0.603]), np.array([0.5, 0.4]))
    env.place_cloth(env.cloth_points() - [0.16, 0.0, 0.0])
    laid.glide([0.485, -0.08])
    basket = env.data.joint("basket")
    basket.qpos[:3] = env.hand - [0.0, 0.0, env.furniture.basket.handle_height]
    basket.qpos[3:] = [1.0, 0.0, 0.0, 0.0]
    env.hold_fast(["basket"])
    before = env.cloth_points().mean(axis=(0, 1))
    put_basket(laid, found)
    assert env.held == ()
    assert placement(env).success
    assert np.linalg.norm(env.cloth_points().mean(axis=(0, 1)) - before) < 0.02
