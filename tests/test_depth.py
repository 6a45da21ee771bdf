"""Depth images: known points in the world, noise, borders."""

import mujoco
import numpy as np
import pytest

from clothlab.experiments.recalibration import project
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import Scene
from clothlab.simulation.vision import depth_points
from clothlab.table_scene.perception import capture_point_cloud, depth_picture
from clothlab.table_scene.scene import Furniture, build_spec
from clothlab.table_scene.table_env import TableEnv

RADIUS = 0.04  # [m] of the balls


@pytest.fixture
def env(table_scene):
    table_scene.start(seed=0)
    return table_scene


def test_a_known_point_is_where_the_pixel_says():
    camera = MuscleArm().camera
    point = np.array([0.6, 0.1, 0.8])
    column, row = project(camera, point[None])[0] * 96 - 0.5
    axes = np.array(camera.axes)
    depth = np.full((96, 128), (camera.position - point) @ axes[2])
    cloud = depth_points(depth, camera.fovy, camera.position, axes)
    assert cloud.shape == (96, 128, 3)
    low, high = (cloud[int(f(row)), int(f(column))] for f in (np.floor, np.ceil))
    assert (np.abs(point - (low + high) / 2) < np.abs(high - low)).all()
    assert np.linalg.norm(high - low) < 0.03


def test_known_balls_are_seen_within_two_millimetres_at_one_metre():
    arm = MuscleArm()
    spec = build_spec(arm, get_cloth("hard-1"), Scene(), Furniture())
    camera = np.array(arm.camera.position)
    directions = np.array([[0.5, 0.5, -0.25], [0.6, 0.1, -0.2], [0.3, 0.6, -0.5], [0.7, 0.45, -0.25]])  # past the arm
    centres = camera + directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for centre in centres:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=centre, size=[RADIUS, 0, 0], contype=0, conaffinity=0
        )
    env = TableEnv(arm)
    env.model = spec.compile()
    env.data = mujoco.MjData(env.model)
    mujoco.mj_forward(env.model, env.data)  # everything at zero: the base in front of the table
    cloud = capture_point_cloud(env)
    for centre in centres:
        ball = cloud.points[np.linalg.norm(cloud.points - centre, axis=1) < RADIUS + 0.004]
        assert len(ball) > 200
        assert np.abs(np.linalg.norm(ball - centre, axis=1) - RADIUS).max() < 0.002
    env.close()


def test_points_on_the_side_table_are_at_its_height(env):
    forward, _, height = env.furniture.side_place
    env.data.joint("base").qpos[0] = forward - 0.85
    mujoco.mj_forward(env.model, env.data)
    x, y, z = capture_point_cloud(env).points.T
    on_top = (np.abs(x - forward) < 0.14) & (np.abs(y) < 0.16) & (np.abs(z - height) < 0.01)
    assert on_top.sum() > 200
    assert np.abs(z[on_top] - height).max() < 0.002


def test_far_things_are_left_out_and_the_border_is_known(env):
    cloud = capture_point_cloud(env, 96)
    assert 0 < len(cloud) < 96 * 128
    assert 0 < (~cloud.inside).sum() < len(cloud)
    part = cloud[cloud.inside]
    assert len(part) == cloud.inside.sum()
    assert part.inside.all()


def test_noise_is_as_large_as_it_says_and_needs_an_rng(env):
    clean = capture_point_cloud(env, 96)
    noisy = capture_point_cloud(env, 96, noise=0.002, rng=np.random.default_rng(0))
    below = slice(-3000, None)  # the same pixels in both: down there nothing is left out
    off = np.linalg.norm(noisy.points[below] - clean.points[below], axis=1)
    distance = np.linalg.norm(clean.points[below] - clean.camera, axis=1)
    assert 0.0005 < np.median(off / distance**2) < 0.002
    with pytest.raises(ValueError, match=r"needs an rng: numpy.random.default_rng\(seed\)"):
        capture_point_cloud(env, 96, noise=0.002)
    with pytest.raises(ValueError, match="noise"):
        capture_point_cloud(env, 96, noise=-1.0)


def test_a_depth_image_is_in_metres_and_leaves_colour_pictures_as_they_were(env):
    before = env.camera_picture()
    depth = depth_picture(env, 96)
    assert depth.shape == (96, 128)
    assert depth[-1].min() < env.data.camera("camera").xpos[2]  # the arm is nearer than the floor
    assert depth.max() > 10  # the floor, far away
    assert np.array_equal(env.camera_picture(), before)
