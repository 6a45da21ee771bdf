"""The scene of the table: laws of falling and resting, grasping, the base, and how a cloth lies."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import get_cloth, point_names, springs
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.table_scene.scene import Furniture
from clothlab.table_scene.table_env import GraspError, TableEnv, placement, room_picture, spread
from clothlab.trials import rollout

CLOTH, FURNITURE = get_cloth("hard-1"), Furniture()


@pytest.fixture
def table(table_scene):
    table_scene.start(seed=0)
    return table_scene


@pytest.fixture(scope="module")
def _hand():
    env = TableEnv(start_in="hand")
    yield env
    env.close()


@pytest.fixture
def hand(_hand):
    """With the cloth in the hand, in front of the table."""
    _hand.start(seed=0)
    return _hand


def flat(height, ahead=0.68, turn=0.0):
    """A cloth that lies at a height, its middle so far ahead `[rows, columns, 3]` [m]."""
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, CLOTH.rows) * CLOTH.length,
        np.linspace(-0.5, 0.5, CLOTH.columns) * CLOTH.width,
        indexing="ij",
    )
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    return np.stack([ahead + cos * x - sin * y, sin * x + cos * y, np.full_like(x, height)], axis=-1)


def energy(env):
    """Of the cloth [J]: of motion, height and springs. Arm and basket stand still."""
    model, data = env.model, env.data
    bodies = [model.body(f"cloth_{i}_{j}").id for i in range(CLOTH.rows) for j in range(CLOTH.columns)]
    speed = np.array([data.qvel[model.body_dofadr[body] : model.body_dofadr[body] + 3] for body in bodies])
    mass = model.body_mass[bodies]
    points = env.cloth_points()
    at = {name: points[i, j] for i, row in enumerate(point_names(CLOTH)) for j, name in enumerate(row)}
    # Stretched by how much: a watcher's tendons are those of the step before.
    stretch = [
        (k, np.linalg.norm(at[a] - at[b]) - model.tendon_lengthspring[model.tendon(f"{a}-{b}").id, 1])
        for a, b, k in springs(CLOTH, held=False)
    ]
    return (
        0.5 * (mass[:, None] * speed**2).sum()
        + 9.81 * (mass * data.xpos[bodies, 2]).sum()
        + 0.5 * sum(k * length**2 for k, length in stretch)
    )


def everything(env):
    return np.concatenate([env.data.qpos, env.data.qvel, env.data.act, env.data.ctrl, env.data.mocap_pos[0]])


def test_a_falling_cloth_obeys_gravity_and_drag(hand):
    hand.release()
    hand.place_cloth(flat(2.0))  # so high that nothing is touched
    hand.advance(hand.command)
    tau = CLOTH.point_mass / CLOTH.damping
    fallen = CLOTH.terminal_speed * (CONTROL_PERIOD - tau * (1 - np.exp(-CONTROL_PERIOD / tau)))
    assert 2.0 - hand.cloth_points()[..., 2] == pytest.approx(np.full((6, 3), fallen), rel=0.01)
    assert hand.cloth_points()[..., :2] == pytest.approx(flat(2.0)[..., :2], abs=1e-9)  # momentum: none sideways


def test_a_cloth_let_go_above_the_table_comes_to_rest_on_it(hand):
    hand.release()
    points = flat(FURNITURE.height + 0.15)
    points[..., 2] += 0.1 * np.linspace(0, 1, CLOTH.rows)[:, None]  # slanted
    hand.place_cloth(points)
    lowest = []
    for _ in range(12):
        hand.advance(hand.command, lambda: lowest.append(hand.cloth_points()[..., 2].min()), 20)
    # The lowest point of a sphere is a radius below its centre.
    assert min(lowest[-40:]) - FURNITURE.point_radius > FURNITURE.height - 0.002
    dofs = [hand.model.body_dofadr[hand.model.body(f"cloth_{i}_1").id] for i in range(CLOTH.rows)]
    assert np.abs(hand.data.qvel[dofs]).max() < 0.01
    assert hand.lies().success


def test_a_cloth_let_go_from_the_hand_never_gains_energy(hand):
    for _ in range(10):
        hand.advance(hand.command)
    hand.release()
    energies = [energy(hand)]
    for _ in range(10):
        hand.advance(hand.command, lambda: energies.append(energy(hand)), 100)
    assert (np.diff(energies) < 0).all()  # in no time step, contacts with the table included
    assert energies[-1] < energies[0] - 0.05


def test_a_cloth_in_the_hand_moves_as_one_that_is_built_into_it():
    far = TableEnv(furniture=replace(FURNITURE, near=3.0), start_in="hand")
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


def test_the_hand_refuses_when_nothing_is_near(table):
    with pytest.raises(GraspError, match=r"nothing within 3 cm of the hand; nearest is cloth_\d_\d, \d+\.\d cm away"):
        table.grasp()
    assert table.held == ()


@pytest.mark.parametrize(("away", "taken"), [(0.029, 3), (0.031, 0)])
def test_the_hand_takes_what_is_within_three_centimetres(hand, away, taken):
    hand.release()
    points = hand.cloth_points()
    points[0] = hand.hand + np.stack([[-away, y, 0.0] for y in (-0.2, 0.0, 0.2)])
    hand.place_cloth(points)
    if not taken:
        with pytest.raises(GraspError, match=r"3\.1 cm away"):
            hand.grasp()
        return
    assert hand.grasp() == ("cloth_0_0", "cloth_0_1", "cloth_0_2")
    hand.advance(hand.command)
    bar = hand.hand + np.array([[0, y, 0] for y in (-0.2, 0.0, 0.2)])
    assert hand.cloth_points()[0] == pytest.approx(bar, abs=0.003)


def test_what_is_grasped_keeps_its_place_along_the_bar(hand):
    hand.release()
    points = hand.cloth_points()
    points[0] = hand.hand + np.stack([[0.01, y, -0.01] for y in (-0.185, 0.015, 0.215)])
    hand.place_cloth(points)
    hand.grasp()
    hand.advance(hand.command)
    assert hand.cloth_points()[0, :, 1] == pytest.approx([-0.185, 0.015, 0.215], abs=0.003)


def test_a_hand_that_holds_something_takes_nothing_else(hand):
    with pytest.raises(GraspError, match="not empty, it holds cloth_0_0, cloth_0_1, cloth_0_2: release it first"):
        hand.grasp()


def test_release_lets_go_within_one_control_step(hand):
    hand.release()
    hand.advance(hand.command)
    gap = hand.hand[2] - hand.cloth_points()[0, :, 2]
    tau = CLOTH.point_mass / CLOTH.damping
    fallen = CLOTH.terminal_speed * (CONTROL_PERIOD - tau * (1 - np.exp(-CONTROL_PERIOD / tau)))
    assert (gap > 0.5 * fallen).all()
    assert hand.held == ()


def test_the_hand_opens_at_the_moment_that_a_plan_names(hand):
    off = []

    def watch():
        off.append(np.linalg.norm(hand.cloth_points()[0, 1] - hand.hand))

    hand.advance(hand.command, watch, 100, release_after=0.1)
    assert max(off[:50]) < 1e-3
    assert (np.diff(off[55:]) > 0).all()
    assert hand.held == ()


@pytest.mark.parametrize("after", [0.0, CONTROL_PERIOD])
def test_the_hand_opens_at_either_end_of_a_period(hand, after):
    hand.advance(hand.command, release_after=after)
    assert hand.held == ()
    assert not hand.data.eq_active[hand.model.equality("grip_cloth_0_1").id]
    assert (np.linalg.norm(hand.cloth_points()[0, 1] - hand.hand) > 0.05) == (after == 0.0)


@pytest.mark.parametrize("after", [-0.1, 0.3, np.nan])
def test_a_release_outside_of_the_period_is_refused(hand, after):
    with pytest.raises(ValueError, match="release_after"):
        hand.advance(hand.command, release_after=after)


def test_the_rack_holds_the_cloth_until_the_hand_takes_it(table):
    edge = table.cloth_points()[0]
    for _ in range(5):
        table.advance(table.command)
    assert table.cloth_points()[0] == pytest.approx(edge, abs=1e-4)
    table.hold_fast(["cloth_0_0"])
    assert not table.data.eq_active[table.model.equality("clip_cloth_0_0").id]
    assert table.data.eq_active[table.model.equality("clip_cloth_0_1").id]


def test_holding_what_is_not_there_lists_the_choices(table):
    with pytest.raises(KeyError, match="unknown thing to grasp 'spoon'; choose from cloth_0_0"):
        table.hold_fast(["spoon"])


def test_the_base_goes_where_it_is_sent_and_stays_without_being_asked(table):
    start = table.base
    table.advance([*table.command, start + 0.05])
    for _ in range(3):
        table.advance(table.command)
    assert table.base == pytest.approx(start + 0.05, abs=1e-4)


@pytest.mark.parametrize(
    ("goal", "message"),
    [(0.0, "the base moves by 0.08 m in a control step at most"), (9.0, "at_most|at most"), (np.nan, "finite")],
)
def test_a_base_too_fast_or_out_of_range_is_refused(table, goal, message):
    before = everything(table)
    with pytest.raises(ValueError, match=message):
        table.advance([*table.command, goal])
    assert np.array_equal(everything(table), before)


def test_what_is_refused_leaves_the_hand_closed(hand):
    with pytest.raises(ValueError, match="the place of the base"):
        hand.advance([*hand.command, 9.0], release_after=0.0)
    hand.advance(hand.command)
    assert len(hand.held) == 3


def test_a_stored_state_remembers_what_is_in_the_hand(hand):
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(hand.model, kind))
    mujoco.mj_getState(hand.model, hand.data, state, kind)
    hand.release()
    assert hand.held == ()
    mujoco.mj_setState(hand.model, hand.data, state, kind)
    assert hand.held == ("cloth_0_0", "cloth_0_1", "cloth_0_2")


@pytest.mark.parametrize("u", [[0.0], [0, 0, 20, 0, 0], [0, 0, np.nan], [9, 0, 20]], ids=str)
def test_commands_of_no_arm_are_refused(table, u):
    with pytest.raises(ValueError, match="command"):
        table.advance(u)


def test_a_seed_gives_the_same_episode_and_another_one_does_not(table):
    states = []
    for seed in (3, 3, 4):
        table.start(seed=seed)
        table.advance([*table.command, table.base + 0.04])
        states.append(everything(table))
    assert np.array_equal(states[0], states[1])
    assert not np.allclose(states[0], states[2])


def test_watching_changes_nothing(hand):
    states = []
    for watch in (None, lambda: None):
        hand.start(seed=0)
        hand.advance([*hand.command, -0.05], watch, 7)
        hand.advance(hand.command, watch, 7, release_after=0.134)
        states.append(everything(hand))
    assert np.array_equal(*states)


def test_what_knows_no_base_records_trials_here_too(hand):
    trial = rollout(hand, RandomPolicy(hand.arm), 3, seed=1)
    assert trial.commands.shape == (3, 3)
    assert trial.images[0].any()
    assert hand.base == pytest.approx(0.0, abs=1e-3)


def test_an_unknown_start_lists_the_choices():
    with pytest.raises(KeyError, match="unknown start 'floor'; choose from rack, hand"):
        TableEnv(start_in="floor")


def test_a_flat_cloth_is_spread():
    lies = spread(CLOTH, FURNITURE, flat(FURNITURE.height + FURNITURE.point_radius))
    assert lies.success
    assert (lies.flat, lies.angle) == (1.0, pytest.approx(0.0))
    assert lies.area == pytest.approx(1.0, abs=0.01)
    assert lies.centre == pytest.approx([0.68, 0.0, 0.603])


@pytest.mark.parametrize(("turn", "success"), [(14.0, True), (-14.0, True), (16.0, False), (180.0, False)])
def test_a_turned_cloth_is_spread_up_to_fifteen_degrees(turn, success):
    lies = spread(CLOTH, FURNITURE, flat(0.603, turn=turn))
    assert lies.angle == pytest.approx(turn)
    assert lies.area == pytest.approx(1.0, abs=0.015)
    assert lies.success == success


def test_a_folded_cloth_covers_half():
    points = flat(0.603)
    points[3:, :, 0] = points[2::-1, :, 0]
    lies = spread(CLOTH, FURNITURE, points)
    assert lies.area == pytest.approx(0.4, abs=0.01)  # two of the five cells between six rows
    assert not lies.success


@pytest.mark.parametrize("points", [flat(0.63), flat(0.603, ahead=1.0), flat(0.0)], ids=["hovers", "hangs", "floor"])
def test_a_cloth_that_is_not_on_the_table_is_not_spread(points):
    assert not spread(CLOTH, FURNITURE, points).success


def test_points_of_another_cloth_are_refused():
    with pytest.raises(ValueError, match="points"):
        spread(CLOTH, FURNITURE, np.zeros((2, 2, 3)))


def test_a_basket_put_on_a_cloth_stands_upright_and_drags_nothing(hand):
    hand.release()
    hand.place_cloth(flat(0.603))
    hand.data.joint("basket").qpos[:3] = [0.68, 0.01, 0.615]
    assert not placement(hand).success or placement(hand).on_table
    for _ in range(8):
        hand.advance(hand.command)
    stands = placement(hand)
    assert stands.success
    assert stands.off_centre == pytest.approx(0.01, abs=0.003)
    assert np.abs(hand.cloth_points() - flat(0.603)).max() < 0.005
    hand.data.joint("basket").qpos[3:] = [np.cos(np.deg2rad(4)), np.sin(np.deg2rad(4)), 0, 0]
    mujoco.mj_forward(hand.model, hand.data)
    assert placement(hand).tilt == pytest.approx(8.0)
    assert not placement(hand).success


def test_the_basket_hangs_upright_from_its_handle(table):
    place = table.hand - [0, 0, FURNITURE.basket.handle_height + 0.01]
    table.data.joint("basket").qpos[:3] = place
    mujoco.mj_forward(table.model, table.data)
    assert table.grasp() == ("basket",)
    for _ in range(15):
        table.advance(table.command)
    assert np.linalg.norm(table.data.site("basket").xpos - table.hand) < 0.002
    assert placement(table).tilt < 5.0


def test_a_visitor_sees_more_of_the_scene_than_the_robot(table):
    def parts(picture):
        """Share of the pixels that are cloth, and that are basket."""
        red, green, blue = picture.astype(int).reshape(-1, 3).T
        return np.mean(red - np.maximum(green, blue) > 60), np.mean(np.minimum(red, green) - blue > 60)

    picture = room_picture(table, 90, 160)
    assert picture.shape == (90, 160, 3)
    cloth, basket = parts(picture)
    assert 0.005 < cloth < 0.1
    assert 0.0005 < basket < 0.05
    robots = table.camera_picture(90, 120)
    assert parts(robots)[1] < 0.0005, "the cloth hides the basket from the robot"
    assert np.array_equal(robots, table.camera_picture(90, 120)), "the robot's camera is where it was"
