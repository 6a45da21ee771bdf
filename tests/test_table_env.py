"""The table scene as an environment: laws of falling and resting, grasping, the base."""

import mujoco
import numpy as np
import pytest
from test_cloth_pose import flat

from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import get_cloth, point_names, springs
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.table_scene.scene import HANDLE_HEIGHT, Furniture
from clothlab.table_scene.table_env import GraspError, TableEnv, measure_placement
from clothlab.trials import rollout

CLOTH, FURNITURE = get_cloth("hard-1"), Furniture()
TAU = CLOTH.point_mass / CLOTH.damping
FALLEN = CLOTH.terminal_speed * (CONTROL_PERIOD - TAU * (1 - np.exp(-CONTROL_PERIOD / TAU)))  # [m] in a control period


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


def energy(env):
    """Of the cloth [J]: of motion, height and springs. Arm and basket stand still."""
    model, data = env.model, env.data
    bodies = [model.body(name).id for row in point_names(CLOTH) for name in row]
    speed = np.array([data.qvel[model.body_dofadr[body] : model.body_dofadr[body] + 3] for body in bodies])
    mass = model.body_mass[bodies]
    at = dict(zip((name for row in point_names(CLOTH) for name in row), data.xpos[bodies], strict=True))
    # Stretched by how much: a watcher's tendons are those of the step before.
    stretch = [
        (k, np.linalg.norm(at[a] - at[b]) - model.tendon_lengthspring[model.tendon(f"{a}-{b}").id, 1])
        for a, b, k in springs(CLOTH, held=False)
    ]
    potential = 9.81 * (mass * data.xpos[bodies, 2]).sum() + 0.5 * sum(k * length**2 for k, length in stretch)
    return 0.5 * (mass[:, None] * speed**2).sum() + potential


def everything(env):
    return np.concatenate([env.data.qpos, env.data.qvel, env.data.act, env.data.ctrl, env.data.mocap_pos[0]])


def test_a_falling_cloth_obeys_gravity_and_drag(hand):
    hand.release()
    hand.place_cloth(flat(2.0))  # so high that nothing is touched
    hand.advance(hand.command)
    assert 2.0 - hand.cloth_points()[..., 2] == pytest.approx(np.full((6, 3), FALLEN), rel=0.01)
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
    assert hand.cloth_pose().spread


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
    with pytest.raises(GraspError, match=r"nothing within 3 cm of the hand; nearest is cloth_\d_\d, \d+\.\d cm away"):
        table.grasp()
    assert table.held == ()
    table.hold_fast(["cloth_0_0"])
    with pytest.raises(GraspError, match="not empty, it holds cloth_0_0: release it first"):
        table.grasp()


@pytest.mark.parametrize(("gap", "taken"), [(0.029, 3), (0.031, 0)])
def test_the_hand_takes_what_is_within_three_centimetres_where_it_is_along_the_bar(hand, gap, taken):
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
    hand.advance(u, lambda: gap.append(np.linalg.norm(hand.cloth_points()[0, 1] - hand.hand)), 100)
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
    with pytest.raises(KeyError, match="unknown thing to grasp 'spoon'; choose from cloth_0_0"):
        table.hold_fast(["spoon"])


def test_the_base_goes_where_it_is_sent_and_stays_without_being_asked(table):
    start = table.base
    table.advance([*table.command, start + 0.05])
    for _ in range(3):
        table.advance(table.command)
    assert table.base == pytest.approx(start + 0.05, abs=1e-4)


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


def test_a_stored_state_remembers_what_is_in_the_hand(hand):
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(hand.model, kind))
    mujoco.mj_getState(hand.model, hand.data, state, kind)
    hand.release()
    mujoco.mj_setState(hand.model, hand.data, state, kind)
    assert hand.held == ("cloth_0_0", "cloth_0_1", "cloth_0_2")


def test_a_seed_gives_the_same_episode_and_another_one_does_not(table):
    states = []
    for seed in (3, 3, 4):
        table.start(seed=seed)
        table.advance([*table.command, table.base + 0.04])
        states.append(everything(table))
    assert np.array_equal(states[0], states[1])
    assert not np.allclose(states[0], states[2])


def test_watching_changes_nothing(hand):
    states, opens = [], [*hand.arm.home_command[:3], 0.67]
    for watch in (None, lambda: None):
        hand.start(seed=0)
        hand.advance([*hand.command, -0.05], watch, 7)
        hand.advance(opens, watch, 7)
        states.append(everything(hand))
    assert np.array_equal(*states)


def test_what_knows_no_base_records_trials_here_too(hand):
    trial = rollout(hand, RandomPolicy(hand.arm), 3, seed=1)
    assert trial.images[0].any()
    assert hand.base == pytest.approx(0.0, abs=1e-3)


def test_an_unknown_start_lists_the_choices():
    with pytest.raises(KeyError, match="unknown start 'floor'; choose from rack, hand"):
        TableEnv(start_in="floor")


def test_a_basket_put_on_a_cloth_stands_upright_and_drags_nothing(hand):
    hand.release()
    hand.place_cloth(flat())
    hand.data.joint("basket").qpos[:3] = [0.68, 0.01, 0.615]
    for _ in range(8):
        hand.advance(hand.command)
    stands = measure_placement(hand)
    assert stands.success
    assert stands.off_centre == pytest.approx(0.01, abs=0.003)
    assert np.abs(hand.cloth_points() - flat()).max() < 0.005
    hand.data.joint("basket").qpos[3:] = [np.cos(np.deg2rad(4)), np.sin(np.deg2rad(4)), 0, 0]
    mujoco.mj_forward(hand.model, hand.data)
    assert measure_placement(hand).tilt == pytest.approx(8.0)
    assert not measure_placement(hand).success


def test_the_basket_hangs_upright_from_its_handle(table):
    table.data.joint("basket").qpos[:3] = table.hand - [0, 0, HANDLE_HEIGHT + 0.01]
    mujoco.mj_forward(table.model, table.data)
    assert table.grasp() == ("basket",)
    for _ in range(15):
        table.advance(table.command)
    assert np.linalg.norm(table.data.site("basket").xpos - table.hand) < 0.002
    assert measure_placement(table).tilt < 5.0


def test_the_room_s_camera_sees_more_of_the_scene_than_the_robot(table):
    def parts(picture):
        """Share of the pixels that are cloth, and that are basket."""
        red, green, blue = picture.astype(int).reshape(-1, 3).T
        return np.mean(red - np.maximum(green, blue) > 60), np.mean(np.minimum(red, green) - blue > 60)

    cloth, basket = parts(table.camera_picture(90, 160, view="room"))
    assert 0.005 < cloth < 0.1
    assert 0.0005 < basket < 0.05
    assert parts(table.camera_picture(90, 120))[1] < 0.0005, "the cloth hides the basket from the robot"
