"""Laws that every arm obeys, and those of the torque arm and of the muscle arm."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.policies import RandomPolicy
from clothlab.simulation.arm import ARMS, JOINTS, Arm, MuscleArm, TorqueArm, get_arm
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv
from clothlab.simulation.muscle import MUSCLES

MUSCLE = MuscleArm()


def bare(arm: Arm) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The arm without cloth or gravity."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    arm.add_to(spec)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("name", ARMS)
def test_names_sizes_and_places_of_an_arm_belong_together(name):
    arm = get_arm(name)
    assert arm.name == name
    assert (
        len(arm.command_names)
        == len(arm.command_lower)
        == len(arm.command_upper)
        == len(arm.home_command)
    )
    assert np.array_equal(arm.check_command(arm.home_command), arm.home_command)
    model, data = bare(arm)
    assert len(arm.state(data)) == len(arm.state_names)
    assert all("[N]" in each for each in arm.state_names[arm.tensions])
    assert len(arm.command_names[arm.angle_command]) == len(JOINTS)
    assert arm.has_stiffness == bool(arm.command_names[arm.stiffness_command])
    assert model.nu == len(model.actuator_ctrlrange)


def test_an_arm_shows_in_one_line_what_it_is():
    assert repr(MUSCLE) == "MuscleArm('muscle', ...)"
    assert repr(TorqueArm()) == "TorqueArm('torque', ...)"


@pytest.mark.parametrize("arm", [TorqueArm(gripper=True), MuscleArm(gripper=True)])
def test_a_gripper_is_one_number_more_in_a_command(arm):
    without = replace(arm, gripper=False)
    last = len(without.command_names)
    assert arm.command_names == (*without.command_names, "hand closed [period]")
    assert arm.closed_command == slice(last, last + 1)
    assert without.closed_command == slice(last, last)
    assert (arm.command_lower[-1], arm.command_upper[-1]) == (0, 1)
    _, data = bare(arm)
    arm.reset(data, arm.home_command)
    assert arm.angles(data) == pytest.approx(arm.home)


@pytest.mark.parametrize("name", ARMS)
def test_the_state_is_z_and_then_the_robot(name):
    arm, layout = get_arm(name), get_arm(name).layout(3)
    numbered = np.arange(layout.size)
    assert layout.size == len(layout.names) == 3 + len(arm.state_names)
    assert numbered[layout.z].tolist() == [0, 1, 2]
    assert all(layout.names[n].startswith("f ") for n in numbered[layout.tensions])
    assert len(numbered[layout.tensions]) == (
        len(MUSCLES) if name.startswith("muscle") else 0
    )


@pytest.mark.parametrize("name", ARMS)
def test_the_jacobian_is_the_derivative_of_the_hand(name):
    arm, theta = get_arm(name), np.array([0.3, -0.9])
    differences = [
        (arm.hand(theta + step) - arm.hand(theta - step)) / 2e-6
        for step in 1e-6 * np.eye(2)
    ]
    assert arm.hand_jacobian(theta) == pytest.approx(
        np.transpose(differences), abs=1e-8
    )


@pytest.mark.parametrize("name", ARMS)
def test_the_hand_is_where_the_joints_put_it(name):
    arm = get_arm(name)
    model, data = bare(arm)
    u = arm.home_command
    u[:2] = 0.3, -0.8
    arm.reset(data, u)
    mujoco.mj_kinematics(model, data)
    forward, up = arm.hand(arm.angles(data))
    assert data.site("hand").xpos == pytest.approx([forward, 0, 1 + up], abs=1e-9)


def test_the_torque_arm_reaches_its_command(env):
    u = np.array([0.2, -1.0])
    for _ in range(15):
        env.advance(u)
    # Without integral part it sags under weight
    assert env.arm.state(env.data)[:2] == pytest.approx(u, abs=0.12)


@pytest.mark.parametrize("theta", [(-0.7, -1.5), (0.3, -1.57), (0.9, -0.1)])
@pytest.mark.parametrize("f_const", [10.0, 70.0])
def test_without_gravity_the_muscle_arm_rests_at_its_reference(theta, f_const):
    model, data = bare(MUSCLE)
    MUSCLE.reset(data, np.array([0.1, -0.8, 40.0]))
    MUSCLE.command(data, np.array([*theta, f_const]))
    mujoco.mj_step(model, data, 4000)
    assert MUSCLE.angles(data) == pytest.approx(theta, abs=1e-4)
    assert MUSCLE.state(data)[:6] == pytest.approx(np.full(6, f_const), rel=1e-3)


def test_set_points_survive_reset():
    model, data = bare(MUSCLE)
    u = np.array([0.5, -1.0, 50.0])
    MUSCLE.reset(data, u)
    mujoco.mj_step(model, data, 100)
    assert MUSCLE.angles(data) == pytest.approx(u[:2], abs=1e-9)
    assert np.abs(data.qvel).max() < 1e-9


def test_the_body_image_is_what_the_arm_senses_at_rest(muscle_env):
    for _ in range(15):
        muscle_env.advance(np.array([0.2, -1.0, 30.0]))
    f, length = np.split(muscle_env.arm.state(muscle_env.data), 2)
    angles = muscle_env.arm.angles(muscle_env.data)
    assert muscle_env.arm.body_image(angles, f) == pytest.approx(length, abs=1e-5)


@pytest.mark.parametrize("name", ARMS)
def test_angles_follow_from_what_an_arm_senses_while_it_moves(name):
    env = ClothEnv(name, "hard-1")
    policy = RandomPolicy(env.arm)
    robot, theta = [], []
    for _ in range(10):
        env.advance(policy({}))
        robot.append(env.arm.state(env.data))
        theta.append(env.arm.angles(env.data))
    assert env.arm.estimate_angles(robot) == pytest.approx(np.array(theta), abs=1e-6)


def test_an_arm_can_be_carried_by_another_body():
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(
        name="base", mass=1.0, inertia=[1.0] * 3, explicitinertial=True
    )
    base.add_joint(name="base", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    hand, position = MUSCLE.add_to(spec, base)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("base").qpos[0] = -0.5
    mujoco.mj_kinematics(model, data)
    assert data.body(hand.name).xpos == pytest.approx(position - [0.5, 0, 0])


def test_tension_is_never_negative_and_motors_stay_in_their_limits(muscle_env):
    arm, data = muscle_env.arm, muscle_env.data
    policy = RandomPolicy(arm)
    for _ in range(30):
        muscle_env.advance(policy({}))
        assert (arm.state(data)[arm.tensions] >= 0).all()
        assert (data.actuator_force >= arm.tension_bias).all()
        assert (data.actuator_force <= arm.tension_max).all()


@pytest.mark.parametrize("away", [-1.0, 1.0])
def test_a_motor_far_from_its_set_point_pulls_as_hard_as_it_can(away):
    """It never pushes, and never pulls harder."""
    model, data = bare(MUSCLE)
    MUSCLE.reset(data, MUSCLE.home_command)
    for name in MUSCLES:
        data.joint(name).qpos[0] += (
            away  # [m], where the controller asks for 1,000s of N
        )
    mujoco.mj_forward(model, data)
    limits = {-1.0: MUSCLE.tension_max, 1.0: MUSCLE.tension_bias}
    assert data.actuator_force == pytest.approx(np.full(6, limits[away]))


def test_a_slack_muscle_does_no_work():
    model, data = bare(MUSCLE)
    MUSCLE.reset(data, MUSCLE.home_command)
    for name in MUSCLES:
        data.joint(name).qpos[0] -= 0.05  # every wire far too long
    model.actuator_forcerange[:] = 0
    data.joint("shoulder").qvel[0] = 1.0
    mujoco.mj_forward(model, data)
    assert (
        np.abs(data.qfrc_passive[:2] + MUSCLE.hinge_damping * data.qvel[:2]).max()
        < 1e-12
    )
    assert MUSCLE.state(data)[:6] == pytest.approx(np.zeros(6))


def test_a_fixed_stiffness_leaves_nothing_to_command():
    stiff = MUSCLE.with_stiffness(70)
    assert (
        stiff.command_lower[2] == stiff.command_upper[2] == stiff.home_command[2] == 70
    )
    assert np.array_equal(stiff.command_lower[:2], MUSCLE.command_lower[:2])


@pytest.mark.parametrize(
    ("arm", "f_const", "message"),
    [(MUSCLE, 9, "outside"), (TorqueArm(), 30, "no stiffness")],
)
def test_a_stiffness_that_the_arm_does_not_have_is_refused(arm, f_const, message):
    with pytest.raises(ValueError, match=message):
        arm.with_stiffness(f_const)


@pytest.mark.parametrize(
    ("u", "message"),
    [
        (
            [0.0],
            r"a command of the torque arm is \[2\] and finite, got the shape \[1\]",
        ),
        (
            [3.0, 0.0],
            r"outside the torque arm's range \[-0.8 -1.6\] to \[1. 0.\]; use numpy.clip",
        ),
    ],
)
def test_a_command_that_the_arm_cannot_follow_is_refused(u, message):
    with pytest.raises(ValueError, match=message):
        get_arm("torque").check_command(u)


def test_a_command_off_by_rounding_is_moved_into_the_range_and_the_original_is_kept():
    u = np.array([-0.8, -1.6], np.float32)  # -0.8 in single precision lies outside
    checked = TorqueArm().check_command(u)
    assert checked.tolist() == [-0.8, -1.6]
    assert checked.dtype == np.float64
    assert u[0] != checked[0]


@pytest.mark.parametrize("arm", ARMS.values(), ids=str)
def test_a_range_that_does_not_rise_through_home_is_refused(arm):
    with pytest.raises(ValueError, match="home, lower and upper"):
        replace(arm, home=(0.4, 0.1))


def test_a_camera_s_axes_are_those_of_the_simulation():
    arm = get_arm("torque")
    for camera in (arm.camera, replace(arm.camera, position=(1.9, -0.6, 0.9))):
        env = ClothEnv(replace(arm, camera=camera))
        env.start()
        seen = env.data.camera("camera")
        assert np.allclose(seen.xmat.reshape(3, 3).T, camera.axes, atol=1e-9)
        assert seen.xpos == pytest.approx(camera.position)


def full_swing(arm):
    """How fast the motors reel in `[6]` [m/s], and how fast the hand is at most."""
    env, hand = ClothEnv(arm, "hard-1"), []
    before = env.data.act.copy()
    command = [-0.8, -1.6, 70.0]
    env.advance(command, lambda: hand.append(env.data.site("hand").xpos.copy()), 50)
    reeled = np.abs(env.data.act - before) / CONTROL_PERIOD
    steps = np.linalg.norm(np.diff(hand, axis=0), axis=1)
    return reeled, steps.max() / (CONTROL_PERIOD / 50)


def test_motors_reel_in_no_faster_than_their_speed_and_the_hand_feels_it():
    """With half the motors' speed the hand is about half as fast."""
    speed = MUSCLE.motor_speed
    reeled, hand = full_swing(MUSCLE)
    slowly, slow_hand = full_swing(replace(MUSCLE, motor_speed=speed / 2))
    assert reeled == pytest.approx(np.full(6, speed), rel=1e-6)
    assert slowly == pytest.approx(np.full(6, speed / 2), rel=1e-6)
    assert hand == pytest.approx(2 * slow_hand, rel=0.3)
