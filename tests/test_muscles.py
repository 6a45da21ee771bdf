"""Laws of the muscle arm: tension, rest, stiffness, work; and what it refuses."""

from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
import pytest

from clothlab.arm import (
    MUSCLES,
    MuscleArm,
    check_command,
    ellipse_area,
    learn_body_image,
    static_posture,
    stiffness_ellipse,
)
from clothlab.autoencoder import Autoencoder
from clothlab.cloth import FOAMS, foam
from clothlab.control import ControlPolicy
from clothlab.dpmpb import DPMPB
from clothlab.env import ClothEnv
from clothlab.trials import RandomPolicy, rollout

ARM = MuscleArm()
BENT = np.array([0.3, -np.pi / 2])
DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def bare(arm: MuscleArm = ARM) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The arm without cloth or gravity."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    arm.add_to(spec)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("theta", [(-0.7, -1.5), (0.3, -1.57), (0.9, -0.1)])
@pytest.mark.parametrize("f_const", [10.0, 70.0])
def test_without_gravity_it_rests_at_its_reference(theta, f_const):
    model, data = bare()
    ARM.reset(data, np.array([0.1, -0.8, 40.0]))
    ARM.command(data, np.array([*theta, f_const]))
    mujoco.mj_step(model, data, 4000)
    assert ARM.angles(data) == pytest.approx(theta, abs=1e-4)
    assert ARM.state(data)[:6] == pytest.approx(np.full(6, f_const), rel=1e-3)


def test_set_points_survive_reset():
    model, data = bare()
    u = np.array([0.5, -1.0, 50.0])
    ARM.reset(data, u)
    mujoco.mj_step(model, data, 100)
    assert ARM.angles(data) == pytest.approx(u[:2], abs=1e-9)
    assert np.abs(data.qvel).max() < 1e-9


def test_more_co_contraction_less_deflection_at_every_posture():
    for theta in product((-0.6, 0.2, 1.0), (-1.6, -0.8, -0.1)):
        for push in DIRECTIONS:
            moved = [
                np.linalg.norm(ARM.hand(static_posture(ARM, [*theta, f], push)) - ARM.hand(np.array(theta)))
                for f in (10, 30, 50, 70)
            ]
            assert (np.diff(moved) < 0).all(), (theta, push)


@pytest.mark.parametrize("f_const", [10.0, 30.0, 70.0])
def test_simulated_ellipse_is_the_static_solution(f_const):
    simulated = stiffness_ellipse(ARM, BENT, f_const, directions=4)
    static = [ARM.hand(static_posture(ARM, [*BENT, f_const], push)) - ARM.hand(BENT) for push in DIRECTIONS]
    assert np.linalg.norm(simulated - static, axis=1).max() < 0.02 * np.linalg.norm(static, axis=1).min()


def test_it_is_the_nonlinear_spring_that_makes_stiffness_a_command():
    linear = replace(ARM, spring_linear=5000.0, spring_cubic=0.0)
    for arm, wanted in ((ARM, pytest.approx(2.6, abs=0.3)), (linear, pytest.approx(1.0, abs=0.02))):
        soft, stiff = (ellipse_area(stiffness_ellipse(arm, BENT, f, directions=8)) for f in (30.0, 70.0))
        assert soft / stiff == wanted


def test_the_area_of_a_known_ellipse():
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    assert ellipse_area(np.stack([3 * np.cos(angle), 2 * np.sin(angle)], axis=1)) == pytest.approx(6 * np.pi, rel=1e-4)


def test_elongation_inverts_tension():
    f = np.array([0.0, 1e-6, 2.0, 10.0, 70.0, 250.0])
    assert ARM.tension(ARM.elongation(f)) == pytest.approx(f, rel=1e-9, abs=1e-12)
    assert ARM.tension(np.array([-0.01])) == 0


def test_the_body_image_is_what_the_arm_senses_at_rest():
    env = ClothEnv("muscle", "hard-1")
    env.reset()
    for _ in range(15):
        env.step(np.array([0.2, -1.0, 30.0]))
    f, length = np.split(env.arm.state(env.data), 2)
    assert env.arm.body_image(env.arm.angles(env.data), f) == pytest.approx(length, abs=1e-5)
    env.close()


def test_tension_is_never_negative_and_motors_stay_in_their_limits():
    env = ClothEnv("muscle", "hard-3")
    policy = RandomPolicy(env.arm, seed=0)
    env.reset()
    for _ in range(30):
        observation, *_ = env.step(policy({}))
        assert (observation["robot"][:6] >= 0).all()
        force = env.data.actuator_force
        assert (force >= env.arm.tension_bias).all()
        assert (force <= env.arm.tension_max).all()
    env.close()


def test_a_slack_muscle_does_no_work():
    model, data = bare()
    ARM.reset(data, ARM.home_command)
    for name in MUSCLES:
        data.joint(name).qpos[0] -= 0.05  # every wire far too long
    model.actuator_forcerange[:] = 0
    data.joint("shoulder").qvel[0] = 1.0
    mujoco.mj_forward(model, data)
    assert np.abs(data.qfrc_passive[:2] + ARM.hinge_damping * data.qvel[:2]).max() < 1e-12
    assert ARM.state(data)[:6] == pytest.approx(np.zeros(6))


def test_a_learned_body_image_agrees_with_the_arm_where_it_has_been():
    rng = np.random.default_rng(0)
    theta = rng.uniform(ARM.lower, ARM.upper, (600, 2))
    f = rng.uniform(5, 80, (600, 6))
    image = learn_body_image(theta[:500], f[:500], ARM.body_image(theta, f)[:500], seed=0)
    assert np.abs(image(theta[500:], f[500:]) - ARM.body_image(theta[500:], f[500:])).mean() < 1e-3


def test_sheets_add_mass_and_stiffness_but_no_drag():
    one, three = foam("hard", 1), foam("hard", 3)
    assert (three.mass, three.bending, three.stiffness) == pytest.approx((3 * one.mass, 3 * one.bending, 180))
    assert three.damping == one.damping == FOAMS["soft-1"].damping


@pytest.mark.parametrize("name", FOAMS)
def test_foams_hold_the_time_step(name):
    env = ClothEnv("muscle", name)
    trial = rollout(env, RandomPolicy(env.arm, seed=1), 25)
    env.close()
    assert np.isfinite(trial.robot).all()


def test_a_fixed_stiffness_stays_fixed(square):
    model = DPMPB(state_size=15, command_size=3)
    arm = replace(ARM, tension_range=(10.0, 10.0))
    policy = ControlPolicy(model.requires_grad_(False), Autoencoder().eval(), arm, square, np.zeros(2))
    env = ClothEnv("muscle", "soft-1")
    observation, _ = env.reset()
    for _ in range(3):
        u = policy(observation)
        assert u[2] == 10.0
        observation, *_ = env.step(u)
    env.close()


@pytest.mark.parametrize("u", [(0.0, -0.5, 9.0), (0.0, -0.5, 71.0), (1.2, -0.5, 30.0), (0.0, 0.2, 30.0)])
def test_commands_outside_the_range_are_refused(u):
    with pytest.raises(ValueError, match="outside the muscle arm's range"):
        check_command(ARM, np.array(u))
    with pytest.raises(ValueError, match="outside the muscle arm's range"):
        stiffness_ellipse(ARM, np.array(u[:2]), u[2])


def test_a_force_beyond_the_muscles_is_refused():
    with pytest.raises(ValueError, match="push less"):
        static_posture(ARM, [*BENT, 30.0], np.array([0.0, 1e5]))


def test_weights_of_the_torque_arm_are_refused(square):
    with pytest.raises(ValueError, match="load the weights of this arm"):
        ControlPolicy(DPMPB(7, 2), Autoencoder().eval(), ARM, square, np.zeros(2))


@pytest.mark.parametrize(("kind", "sheets", "error"), [("felt", 1, KeyError), ("soft", 0, ValueError)])
def test_impossible_foams_are_refused(kind, sheets, error):
    with pytest.raises(error, match=r"unknown foam 'felt'; choose from soft, hard|at least one sheet"):
        foam(kind, sheets)
