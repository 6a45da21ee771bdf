"""Laws that the cloth obeys, whatever its parameters."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.policies import RandomPolicy
from clothlab.simulation.cloth import (
    CLOTHS,
    FOAMS,
    SHEETS,
    Cloth,
    cloth_name,
    get_cloth,
)
from clothlab.simulation.cloth_elements import add_cloth, point_names, springs
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from studies._runs import NEW

GRAVITY = 9.81


def falling(cloth: Cloth) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A cloth that nobody holds: its bar slides down with the drag of the points tied
    to it.
    """
    spec = mujoco.MjSpec()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    bar = spec.worldbody.add_body(name="bar")
    bar.add_joint(
        name="bar",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, 1],
        damping=[cloth.columns * cloth.damping, 0, 0],
    )
    add_cloth(spec, cloth, bar, np.zeros(3))
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", ["damp0.03-mass0.05", "damp0.07-mass0.15", "soft-1"])
def test_terminal_speed_is_weight_over_drag(name):
    cloth = get_cloth(name)
    model, data = falling(cloth)
    mujoco.mj_step(model, data, 3000)
    assert -data.joint("bar").qvel[0] == pytest.approx(
        cloth.point_mass * GRAVITY / cloth.damping, rel=1e-3
    )
    assert cloth.terminal_speed == pytest.approx(
        cloth.point_mass * GRAVITY / cloth.damping
    )


def test_a_cloth_shows_in_one_line_what_it_is():
    shown = "Cloth('damp0.03-mass0.05', damping=0.03, mass=0.05, ...)"
    assert repr(get_cloth("damp0.03-mass0.05")) == shown
    assert max(len(repr(cloth)) for cloth in (CLOTHS | FOAMS).values()) <= 80


@pytest.mark.parametrize("name", [*CLOTHS, *FOAMS])
def test_a_cloth_weighs_what_it_says(name):
    model, _ = falling(get_cloth(name))
    assert model.body_subtreemass[0] == pytest.approx(get_cloth(name).mass)


def test_a_cloth_at_rest_stays_at_rest(env):
    before = env.cloth_points()
    for _ in range(10):
        env.advance(env.arm.home_command)
    assert np.abs(env.cloth_points() - before).max() < 1e-3
    assert np.abs(env.data.qvel).max() < 1e-3


def test_a_hanging_cloth_stretches_by_its_weight(env):
    points = env.cloth_points()
    drop = points[0, :, 2].mean() - points[-1, :, 2].mean()
    assert env.cloth.length < drop < 1.02 * env.cloth.length


def motion(cloth: Cloth, time_step: float = 0.002) -> np.ndarray:
    """Where the points are after each of 15 steps of three random runs, `[45, rows,
    columns, 3]` [m].
    """
    env = ClothEnv("torque", cloth, scene=Scene(time_step=time_step))
    moments = []
    for seed in range(3):
        env.start()
        policy = RandomPolicy(env.arm)
        policy.reset(seed)
        for _ in range(15):
            env.advance(policy({}))
            moments.append(env.cloth_points())
    return np.array(moments)


def mean_shift(a: np.ndarray, b: np.ndarray) -> float:
    return np.linalg.norm(a - b, axis=-1).mean()


@pytest.mark.slow
def test_materials_matter_more_than_the_time_step():
    cloth = get_cloth("damp0.05-mass0.10")
    base = motion(cloth)
    halved = mean_shift(base, motion(cloth, time_step=0.001))
    for change in (
        {"damping": 0.07},
        {"damping": 0.03},
        {"mass": 0.15},
        {"mass": 0.05},
    ):
        assert mean_shift(base, motion(replace(cloth, **change))) > 2 * halved


def test_springs_join_neighbours_and_leave_the_hand_bar_out():
    cloth = Cloth("small", rows=3, columns=3)
    found = {(a, b): stiffness for a, b, stiffness in springs(cloth)}
    assert not any(
        a.startswith("cloth_0_") and b.startswith("cloth_0_") for a, b in found
    )
    assert (
        found["cloth_0_0", "cloth_1_0"]
        == found["cloth_0_0", "cloth_1_1"]
        == cloth.stiffness
    )
    assert found["cloth_0_1", "cloth_2_1"] == cloth.bending
    assert len(found) == 6 + 4 + 4 + 4 + 3 + 2


def test_a_free_first_row_has_springs_of_its_own():
    cloth = get_cloth("soft-1")
    more = set(springs(cloth, held=False)) - set(springs(cloth))
    pairs = {
        ("cloth_0_0", "cloth_0_1"),
        ("cloth_0_1", "cloth_0_2"),
        ("cloth_0_0", "cloth_0_2"),
    }
    assert {(a, b) for a, b, _ in more} == pairs


@pytest.mark.parametrize("held", [True, False])
def test_a_scene_has_the_springs_of_how_the_cloth_is_held(held):
    cloth, spec = get_cloth("soft-1"), mujoco.MjSpec()
    hand = spec.worldbody.add_body(name="hand") if held else None
    add_cloth(spec, cloth, hand, np.zeros(3))
    assert len(spec.tendons) == len(list(springs(cloth, held=held)))


def test_a_cloth_that_nobody_holds_falls_as_a_whole():
    cloth, spec = get_cloth("soft-1"), mujoco.MjSpec()
    add_cloth(spec, cloth, None, np.zeros(3))
    model = spec.compile()
    data = mujoco.MjData(model)
    assert model.nv == 3 * cloth.rows * cloth.columns
    mujoco.mj_step(model, data, 100)
    fallen = np.array(
        [data.joint(f"{name}_z").qpos[0] for row in point_names(cloth) for name in row]
    )
    assert fallen == pytest.approx(np.full(len(fallen), fallen[0]))
    assert fallen[0] < -0.05


def test_sheets_add_mass_and_stiffness_but_no_drag():
    one, three = FOAMS["hard-1"], FOAMS["hard-3"]
    assert (three.mass, three.bending, three.stiffness) == pytest.approx(
        (3 * one.mass, 3 * one.bending, 180)
    )
    assert three.damping == one.damping == FOAMS["soft-1"].damping


def test_thick_sheets_bend_less_by_the_third_power():
    soft, hard = (
        FOAMS[f"{kind}-1"].bending
        / (SHEETS[kind].modulus * SHEETS[kind].thickness ** 3)
        for kind in SHEETS
    )
    assert soft == pytest.approx(hard)


@pytest.mark.parametrize("name", FOAMS)
def test_a_bent_foam_stores_what_its_sheets_store(name):
    """Two strips of a beam at an angle of one radian, by the springs that span them."""
    cloth, angle = FOAMS[name], 1.0
    sheet, spacing = SHEETS[cloth.foam], cloth.length / (cloth.rows - 1)
    across = [
        stiffness
        for a, b, stiffness in springs(cloth)
        if a == "cloth_1_0" and b == "cloth_3_0"
    ]
    shortened = 2 * spacing * (1 - np.cos(angle / 2))
    stored = sum(across) * shortened**2 / 2
    column = cloth.width / cloth.columns
    rigidity = sheet.modulus * sheet.thickness**3 / 12 * column  # E I of a column
    beam = cloth.sheets * rigidity * angle**2 / 2 / spacing
    assert stored == pytest.approx(beam, rel=0.06)  # the chord to second order


@pytest.mark.parametrize("kind", SHEETS)
def test_a_foam_weighs_its_volume_and_drags_as_a_plate(kind):
    """½ ρ C A v² at 2 m/s, as a drag that is proportional to v."""
    sheet, cloth = SHEETS[kind], FOAMS[f"{kind}-2"]
    area = 0.5 * 0.4
    assert cloth.mass == pytest.approx(2 * area * sheet.thickness * sheet.density)
    force = 0.5 * 1.2 * 1.2 * area * 2.0**2  # [N]
    assert cloth.rows * cloth.columns * cloth.damping * 2.0 == pytest.approx(force)


@pytest.mark.parametrize("name", FOAMS)
def test_half_the_time_step_moves_a_foam_by_millimetres(name):
    """So light a cloth is the first to tremble where a time step is too large."""
    moved = []
    for time_step in (0.002, 0.001):
        env = ClothEnv("muscle", name, scene=Scene(time_step=time_step))
        policy = RandomPolicy(env.arm)
        policy.reset(1)
        for _ in range(8):
            env.advance(policy({}))
            moved.append(env.cloth_points())
    assert mean_shift(np.array(moved[:8]), np.array(moved[8:])) < 0.002
    assert mean_shift(np.array(moved[:7]), np.array(moved[1:8])) > 0.02


def test_a_cloth_is_found_by_its_name_and_returned_as_it_is():
    cloth = get_cloth(cloth_name(0.03, 0.1))
    assert (cloth.damping, cloth.mass) == (0.03, 0.10)
    assert get_cloth(cloth) is cloth
    assert list(FOAMS) == ["soft-1", "soft-2", "hard-1", "hard-2", "hard-3"]


@pytest.mark.parametrize(
    ("cloth", "label"),
    [
        ("damp0.03-mass0.10", "(0.03, 0.10)"),
        ("hard-2", "hard-2"),
        (Cloth("x", damping=0.035, mass=0.1), "(0.035, 0.10)"),
    ],
)
def test_people_see_a_foam_by_its_name_and_a_cloth_by_its_numbers(cloth, label):
    assert get_cloth(cloth).label == label


def test_every_cloth_of_the_project_has_a_label_of_its_own():
    for cloths in (
        (*CLOTHS.values(), *NEW["torque"]),
        (*FOAMS.values(), *NEW["muscle"]),
    ):
        labels = [cloth.label for cloth in cloths]
        assert len({*labels}) == len(labels), labels
