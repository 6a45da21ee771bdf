"""The table scene as an environment: falling and resting, grasping, the base, and when
a cloth is spread.
"""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from studies.table_scene.gripping import GraspError
from studies.table_scene.scene import Furniture
from studies.table_scene.table_env import TableEnv, _measure_pose

pytestmark = pytest.mark.slow  # a scene with contacts

CLOTH, FURNITURE = get_cloth("hard-1"), Furniture()
TAU = CLOTH.point_mass / CLOTH.damping
# [m] in a control period
FALLEN = CLOTH.terminal_speed * (
    CONTROL_PERIOD - TAU * (1 - np.exp(-CONTROL_PERIOD / TAU))
)


def flat(height=0.603, ahead=0.68, turn=0.0):
    """A cloth that lies at a height, its middle so far ahead `[rows, columns, 3]` [m]."""
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, CLOTH.rows) * CLOTH.length,
        np.linspace(-0.5, 0.5, CLOTH.columns) * CLOTH.width,
        indexing="ij",
    )
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    return np.stack(
        [ahead + cos * x - sin * y, sin * x + cos * y, np.full_like(x, height)], axis=-1
    )


@pytest.fixture
def table(table_scene):
    table_scene.start(seed=0)
    return table_scene


@pytest.fixture(scope="module")
def _hand():
    env = TableEnv("muscle-hand", start_in="hand")
    yield env
    env.close()


@pytest.fixture
def hand(_hand):
    """With the cloth in the hand, in front of the table."""
    _hand.start(seed=0)
    return _hand


def everything(env):
    return np.concatenate(
        [
            env.data.qpos,
            env.data.qvel,
            env.data.act,
            env.data.ctrl,
            env.data.mocap_pos[0],
        ]
    )


def test_a_falling_cloth_obeys_gravity_and_drag(hand):
    hand.release()
    hand.place_cloth(flat(2.0))  # so high that nothing is touched
    hand.advance(hand.command)
    assert 2.0 - hand.cloth_points()[..., 2] == pytest.approx(
        np.full((6, 3), FALLEN), rel=0.01
    )
    # Momentum: none sideways
    assert hand.cloth_points()[..., :2] == pytest.approx(flat(2.0)[..., :2], abs=1e-9)


def test_a_cloth_let_go_above_the_table_comes_to_rest_on_it(hand):
    hand.release()
    points = flat(FURNITURE.height + 0.15)
    points[..., 2] += 0.1 * np.linspace(0, 1, CLOTH.rows)[:, None]  # slanted
    hand.place_cloth(points)
    lowest = []
    for _ in range(12):
        hand.advance(
            hand.command, lambda: lowest.append(hand.cloth_points()[..., 2].min()), 20
        )
    # The lowest point of a sphere is a radius below its centre.
    assert min(lowest[-40:]) - FURNITURE.point_radius > FURNITURE.height - 0.002
    dofs = [
        hand.model.body_dofadr[hand.model.body(f"cloth_{i}_1").id]
        for i in range(CLOTH.rows)
    ]
    assert np.abs(hand.data.qvel[dofs]).max() < 0.01
    assert hand.cloth_pose().spread


def test_a_cloth_in_the_hand_moves_as_one_that_is_built_into_it():
    far = TableEnv(furniture=Furniture(near=3.0), start_in="hand")
    built_in = ClothEnv(far.arm, CLOTH)
    rng = np.random.default_rng(1)
    for env in (far, built_in):
        env.start()
    for _ in range(8):
        u = rng.uniform(far.arm.command_lower, far.arm.command_upper)
        far.advance(u)
        built_in.advance(u)
        assert far.cloth_points() == pytest.approx(built_in.cloth_points(), abs=0.02)
    assert abs(far.base) < 0.002  # the swing's reaction hardly moves the base


def test_the_hand_refuses_when_nothing_is_near_or_something_is_held(table):
    with pytest.raises(
        GraspError,
        match=r"nothing within 3 cm of the hand; nearest is cloth_\d_\d, \d+\.\d cm away",
    ):
        table.grasp()
    assert table.held == ()
    table.hold_fast(["cloth_0_0"])
    with pytest.raises(
        GraspError, match="not empty, it holds cloth_0_0: release it first"
    ):
        table.grasp()


@pytest.mark.parametrize(("gap", "taken"), [(0.029, 3), (0.031, 0)])
def test_the_hand_takes_what_is_within_three_centimetres_where_it_is_along_the_bar(
    hand, gap, taken
):
    hand.release()
    points = hand.cloth_points()
    points[0] = hand.hand + np.stack([[-gap, y, 0.0] for y in (-0.185, 0.015, 0.215)])
    hand.place_cloth(points)
    if not taken:
        with pytest.raises(GraspError, match=r"3\.1 cm away"):
            hand.grasp()
        return
    assert hand.grasp() == ("cloth_0_0", "cloth_0_1", "cloth_0_2")
    hand.advance(hand.command)
    bar = hand.hand + np.array([[0, y, 0] for y in (-0.185, 0.015, 0.215)])
    assert hand.cloth_points()[0] == pytest.approx(bar, abs=0.003)


@pytest.mark.parametrize("closed", [0.0, 0.5])
def test_the_hand_opens_when_the_command_says_so(hand, closed):
    gap, u = [], hand.arm.home_command
    u[hand.arm.closed_command] = closed
    hand.advance(
        u,
        lambda: gap.append(np.linalg.norm(hand.cloth_points()[0, 1] - hand.hand)),
        100,
    )
    assert hand.held == ()
    opens = round(100 * closed)
    held, free = gap[:opens], gap[opens + 5 : opens + 45]
    assert max(held, default=0.0) < 1e-3
    assert (np.diff(free) > 0).all()
    if not closed:
        assert (hand.hand[2] - hand.cloth_points()[0, :, 2] > 0.5 * FALLEN).all()


def test_the_rack_holds_the_cloth_until_the_hand_takes_it(table):
    edge = table.cloth_points()[0]
    for _ in range(5):
        table.advance(table.command)
    assert table.cloth_points()[0] == pytest.approx(edge, abs=1e-4)
    table.hold_fast(["cloth_0_0"])
    assert not table.data.eq_active[table.model.equality("clip_cloth_0_0").id]
    assert table.data.eq_active[table.model.equality("clip_cloth_0_1").id]
    with pytest.raises(
        KeyError, match="unknown thing to grasp 'spoon'; choose from cloth_0_0"
    ):
        table.hold_fast(["spoon"])


@pytest.mark.parametrize(
    ("u", "message"),
    [
        ([0, 0, 20, 0.0], "the base moves by 0.08 m in a control step at most"),
        ([0, 0, 20, 9.0], "at most"),
        ([0, 0, 20, np.nan], "finite"),
        ([0.0], "command"),
        ([9, 0, 20], "command"),
    ],
)
def test_what_is_refused_changes_nothing(table, u, message):
    before = everything(table)
    with pytest.raises(ValueError, match=message):
        table.advance(u)
    assert np.array_equal(everything(table), before)


def test_a_seed_gives_the_same_episode_and_another_one_does_not(table):
    states = []
    for seed in (3, 3, 4):
        table.start(seed=seed)
        table.advance([*table.command, table.base + 0.04])
        states.append(everything(table))
    assert np.array_equal(states[0], states[1])
    assert not np.allclose(states[0], states[2])


FOLDED = flat()
FOLDED[3:, :, 0] = FOLDED[2::-1, :, 0]


@pytest.mark.parametrize(
    ("points", "area", "fault"),
    [
        (flat(), 1.0, ""),
        (flat(turn=-14.0), 1.0, ""),
        (flat(turn=16.0), 1.0, "it is turned"),
        (flat(turn=180.0), 1.0, "it is turned"),
        (
            FOLDED,
            0.4,
            "it is folded or hangs over the edge",
        ),  # two of the five cells between six rows
        (flat(0.63), 1.0, "it does not lie flat on the table"),
        (flat(ahead=1.0), 1.0, "it does not lie flat on the table"),
    ],
)
def test_a_cloth_is_spread_when_it_lies_flat_whole_and_straight(points, area, fault):
    pose = _measure_pose(CLOTH, FURNITURE, points)
    assert pose.fault == fault
    assert pose.spread == (not fault)
    assert pose.area == pytest.approx(area, abs=0.015)


def test_a_basket_put_on_a_cloth_stands_upright_and_drags_nothing(hand):
    hand.release()
    hand.place_cloth(flat())
    hand.data.joint("basket").qpos[:3] = [0.68, 0.01, 0.615]
    for _ in range(8):
        hand.advance(hand.command)
    stands = hand.placement()
    assert stands.success
    assert stands.off_centre == pytest.approx(0.01, abs=0.003)
    assert np.abs(hand.cloth_points() - flat()).max() < 0.005
    hand.data.joint("basket").qpos[3:] = [
        np.cos(np.deg2rad(4)),
        np.sin(np.deg2rad(4)),
        0,
        0,
    ]
    mujoco.mj_forward(hand.model, hand.data)
    assert hand.placement().tilt == pytest.approx(8.0)
    assert not hand.placement().success
