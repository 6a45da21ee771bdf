"""Perception: depth images and clouds; cloth, basket and bar in clouds from the scene
and in clouds made by hand.
"""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.scene import Scene
from studies.table_scene.perception import (
    NotVisibleError,
    PointCloud,
    capture_point_cloud,
    find_bar,
    find_basket,
    find_cloth_centre,
    find_cloth_edge,
    find_cloth_pose,
)
from studies.table_scene.scene import Furniture, build_spec
from studies.table_scene.table_env import TableEnv

pytestmark = pytest.mark.slow  # a scene with depth pictures

CLOTH, RADIUS = get_cloth("hard-1"), 0.04  # [m] of the balls
RED, YELLOW, BLACK, GREY = (200, 20, 25), (190, 175, 40), (40, 40, 40), (160, 150, 130)
BACK, FRONT = (160, 12, 49), (209, 18, 25)


@pytest.fixture
def env(table_scene):
    table_scene.start(seed=0)
    return table_scene


def put(env, *, base, cloth):
    """Move things by hand: no physics, only a picture."""
    env.data.joint("base").qpos[0] = base
    env.place_cloth(cloth)
    mujoco.mj_forward(env.model, env.data)


def sheet(centre=(0.8, 0, 1.2), width=0.4, length=0.5, spacing=0.004):
    """Points on an upright sheet across the robot's way `[N, 3]` [m]."""
    y, z = np.meshgrid(
        np.arange(-width / 2, width / 2, spacing), np.arange(-length, 0, spacing)
    )
    return np.add(centre, np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()]))


def cloud_of(points, colour, inside=True):
    colours = np.tile(np.array(colour, np.uint8), (len(points), 1))
    return PointCloud(
        points, colours, np.full(len(points), inside), np.array([0.0, -0.25, 1.45])
    )


def test_known_balls_are_seen_within_two_millimetres_at_one_metre():
    arm = MuscleArm()
    spec = build_spec(arm, CLOTH, Scene(), Furniture())
    camera = np.array(arm.camera.position)
    # Past the arm
    directions = np.array(
        [[0.5, 0.5, -0.25], [0.6, 0.1, -0.2], [0.3, 0.6, -0.5], [0.7, 0.45, -0.25]]
    )
    centres = camera + directions / np.linalg.norm(directions, axis=1, keepdims=True)
    sphere = {
        "type": mujoco.mjtGeom.mjGEOM_SPHERE,
        "size": [RADIUS, 0, 0],
        "contype": 0,
        "conaffinity": 0,
    }
    for centre in centres:
        spec.worldbody.add_geom(pos=centre, **sphere)
    env = TableEnv(arm)
    env.model = spec.compile()
    env.data = mujoco.MjData(env.model)
    # Everything at zero: the base in front of the table
    mujoco.mj_forward(env.model, env.data)
    cloud = capture_point_cloud(env)
    for centre in centres:
        ball = cloud.points[
            np.linalg.norm(cloud.points - centre, axis=1) < RADIUS + 0.004
        ]
        assert len(ball) > 200
        assert np.abs(np.linalg.norm(ball - centre, axis=1) - RADIUS).max() < 0.002
    env.close()


def test_noise_is_as_large_as_it_says_and_needs_an_rng(env):
    clean = capture_point_cloud(env, 96)
    noisy = capture_point_cloud(env, 96, noise=0.002, rng=np.random.default_rng(0))
    # The same pixels in both: down there nothing is left out
    below = slice(-3000, None)
    off = np.linalg.norm(noisy.points[below] - clean.points[below], axis=1)
    distance = np.linalg.norm(clean.points[below] - clean.camera, axis=1)
    assert 0.0005 < np.median(off / distance**2) < 0.002
    with pytest.raises(
        ValueError, match=r"needs an rng: numpy.random.default_rng\(seed\)"
    ):
        capture_point_cloud(env, 96, noise=0.002)


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.0), (1, 0.0), (1, 0.003)])
def test_the_edge_of_a_hanging_cloth_is_found(env, seed, noise):
    env.start(seed=seed)
    ends = find_cloth_edge(
        capture_point_cloud(env, noise=noise, rng=np.random.default_rng(0))
    )
    edge = env.cloth_points()[0]
    assert ends.mean(axis=0) == pytest.approx(edge[1], abs=0.012 if noise else 0.006)
    if not noise:
        assert ends[:, [0, 2]] == pytest.approx(edge[[0, 2]][:, [0, 2]], abs=0.003)
        # a column of pixels, a bin of points
        assert ends[:, 1] == pytest.approx(edge[[0, 2], 1], abs=0.012)


@pytest.mark.parametrize(
    ("seed", "noise", "off"), [(0, 0.0, 0.003), (1, 0.0, 0.003), (1, 0.003, 0.01)]
)
def test_the_basket_is_found(env, seed, noise, off):
    env.start(seed=seed)
    # Out of the way
    put(
        env,
        base=env.furniture.side_place[0] - 0.85,
        cloth=np.add(env.cloth_points(), [2.0, 0.0, -0.6]),
    )
    bottom, turn = find_basket(
        capture_point_cloud(env, noise=noise, rng=np.random.default_rng(0))
    )
    basket = env.data.body("basket")
    assert bottom == pytest.approx(basket.xpos, abs=off)
    assert turn == pytest.approx(
        np.rad2deg(np.arctan2(basket.xmat[3], basket.xmat[0])), abs=1.0
    )


def test_the_bar_is_found_where_the_hand_is_and_nowhere_else(env):
    cloud = capture_point_cloud(env)
    assert find_bar(cloud, env.hand + 0.02) == pytest.approx(env.hand, abs=0.005)
    with pytest.raises(NotVisibleError):
        find_bar(cloud, np.add(env.hand, [0.0, 0.0, 0.5]))


def lying(length=0.5, turn=0.0, colour=BACK, height=0.6):
    """The pose of a sheet on a table at 0.6 m, its middle at the world's origin."""
    _, y, x = sheet((0.0, 0.0, length / 2), length=length).T
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    points = np.column_stack(
        [cos * x - sin * y, sin * x + cos * y, np.full(len(x), height)]
    )
    return find_cloth_pose(cloud_of(points, colour), 0.6, CLOTH)


def test_a_sheet_on_the_table_covers_what_it_covers():
    assert lying().spread
    # Its outline lies on the grid: no cell is half covered
    assert lying().area == pytest.approx(1.0, abs=0.06)
    assert lying(length=0.42).area == pytest.approx(0.84, abs=0.06)
    assert lying(turn=-12.0).angle == pytest.approx(-12.0, abs=1.0)
    assert not lying(colour=FRONT).back_up
    assert lying(height=0.65).flat == 0


def test_what_is_not_there_is_not_visible(env):
    put(env, base=0.0, cloth=env.cloth_points())  # past the rack and the side table
    empty = cloud_of(np.empty((0, 3)), RED)
    for cloud in (capture_point_cloud(env), empty):
        with pytest.raises(
            NotVisibleError,
            match=r"no cloth in view: \d+ points have its colour, 150 are needed",
        ):
            find_cloth_edge(cloud)
        with pytest.raises(NotVisibleError, match="no basket in view"):
            find_basket(cloud)
        with pytest.raises(NotVisibleError, match="no cloth on the table in view"):
            find_cloth_centre(cloud, 0.6)


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (
            cloud_of(sheet(), RED, inside=False),
            "cut off by the picture: look from farther away",
        ),
        (cloud_of(sheet(width=0.06), RED), "of the cloth's edge are in view"),
        (cloud_of(sheet(), GREY), "no cloth in view"),
    ],
)
def test_a_part_of_an_edge_and_other_colours_are_refused(cloud, message):
    with pytest.raises(NotVisibleError, match=message):
        find_cloth_edge(cloud)
