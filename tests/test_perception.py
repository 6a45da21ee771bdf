"""Perception: cloth, basket and bar in clouds from the scene and in clouds made by hand."""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.cloth import get_cloth
from clothlab.table_scene.perception import (
    NotVisibleError,
    PointCloud,
    _basket_distance,
    capture_point_cloud,
    find_bar,
    find_basket,
    find_cloth_centre,
    find_cloth_edge,
    find_cloth_pose,
)
from clothlab.table_scene.scene import BASKET_SIZE, HANDLE_HEIGHT, HANDLE_RADIUS, HANDLE_WIDTH

ASIDE = (2.0, 0.0, -0.6)  # [m] out of the way of a look at the basket
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


def sheet(centre, width=0.4, length=0.5, spacing=0.004):
    """Points on an upright sheet across the robot's way `[N, 3]` [m]."""
    y, z = np.meshgrid(np.arange(-width / 2, width / 2, spacing), np.arange(-length, 0, spacing))
    return np.add(centre, np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()]))


def cloud_of(points, colour, inside=True):
    points = np.asarray(points, dtype=float)
    colours = np.tile(np.array(colour, np.uint8), (len(points), 1))
    return PointCloud(points, colours, np.full(len(points), inside), np.array([0.0, -0.25, 1.45]))


def both(a, b):
    joined = (np.concatenate([getattr(c, name) for c in (a, b)]) for name in ("points", "colours", "inside"))
    return PointCloud(*joined, a.camera)


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.0), (1, 0.0), (2, 0.0), (1, 0.003)])
def test_the_edge_of_a_hanging_cloth_is_found(env, seed, noise):
    env.start(seed=seed)
    ends = find_cloth_edge(capture_point_cloud(env, noise=noise, rng=np.random.default_rng(0)))
    edge = env.cloth_points()[0]
    assert ends.mean(axis=0) == pytest.approx(edge[1], abs=0.012 if noise else 0.006)
    if not noise:
        assert ends[:, [0, 2]] == pytest.approx(edge[[0, 2]][:, [0, 2]], abs=0.003)
        assert ends[:, 1] == pytest.approx(edge[[0, 2], 1], abs=0.012)  # a column of pixels, a bin of points


@pytest.mark.parametrize(("seed", "noise", "off"), [(0, 0.0, 0.003), (1, 0.0, 0.003), (1, 0.003, 0.01)])
def test_the_basket_is_found(env, seed, noise, off):
    env.start(seed=seed)
    put(env, base=env.furniture.side_place[0] - 0.85, cloth=np.add(env.cloth_points(), ASIDE))
    bottom, turn = find_basket(capture_point_cloud(env, noise=noise, rng=np.random.default_rng(0)))
    basket = env.data.body("basket")
    assert bottom == pytest.approx(basket.xpos, abs=off)
    assert turn == pytest.approx(np.rad2deg(np.arctan2(basket.xmat[3], basket.xmat[0])), abs=1.0)


def test_the_bar_is_found_where_the_hand_is(env):
    assert find_bar(capture_point_cloud(env), env.hand + 0.02) == pytest.approx(env.hand, abs=0.005)


def test_a_dark_place_far_from_the_hand_is_no_bar():
    y = np.linspace(-0.22, 0.22, 300)
    bar = cloud_of(np.column_stack([np.full(300, 0.5), y, np.full(300, 1.0)]), BLACK)
    assert find_bar(bar, [0.5, 0, 1.0]) == pytest.approx([0.5, 0, 1.0], abs=0.008)
    with pytest.raises(NotVisibleError):
        find_bar(bar, [0.5, 0.0, 1.5])


def test_a_cloth_on_the_table_is_found(env):
    x, y = np.meshgrid(np.linspace(0.45, 0.95, 6), np.linspace(-0.2, 0.2, 3), indexing="ij")
    put(env, base=0.0, cloth=np.stack([x, y, np.full_like(x, 0.603)], axis=-1))
    centre = find_cloth_centre(capture_point_cloud(env), env.furniture.height)
    assert centre == pytest.approx([0.70, 0.0, 0.603], abs=0.006)


def lying(length=0.5, turn=0.0, colour=BACK, height=0.6):
    """The pose of a sheet on a table at 0.6 m, its middle at the world's origin."""
    _, y, x = sheet((0.0, 0.0, length / 2), length=length).T
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    points = np.column_stack([cos * x - sin * y, sin * x + cos * y, np.full(len(x), height)])
    return find_cloth_pose(cloud_of(points, colour), 0.6, get_cloth("hard-1"))


def test_a_sheet_on_the_table_covers_what_it_covers():
    assert lying().spread
    assert lying().area == pytest.approx(1.0, abs=0.06)  # its outline lies on the grid: no cell is half covered
    assert lying(length=0.42).area == pytest.approx(0.84, abs=0.06)
    assert not lying(length=0.40).spread
    assert lying(turn=-12.0).angle == pytest.approx(-12.0, abs=1.0)
    assert not lying(turn=20.0).spread


def test_a_sheet_with_its_front_up_or_in_the_air_is_not_spread():
    assert not lying(colour=FRONT).back_up
    assert lying(height=0.65).flat == 0
    assert not lying(height=0.65).spread


def test_what_is_not_there_is_not_visible(env):
    put(env, base=0.0, cloth=env.cloth_points())  # past the rack and the side table
    cloud = capture_point_cloud(env)
    with pytest.raises(NotVisibleError, match=r"no cloth in view: \d+ points have its colour, 150 are needed"):
        find_cloth_edge(cloud)
    with pytest.raises(NotVisibleError, match="no basket in view"):
        find_basket(cloud)
    with pytest.raises(NotVisibleError, match="no cloth on the table in view"):
        find_cloth_centre(cloud, 0.6)
    empty = cloud_of(np.empty((0, 3)), RED)
    for find in (find_cloth_edge, find_basket, lambda cloud: find_bar(cloud, np.zeros(3))):
        with pytest.raises(NotVisibleError):
            find(empty)


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (cloud_of(sheet([0.8, 0, 1.2]), RED, inside=False), "cut off by the picture: look from farther away"),
        (cloud_of(sheet([0.8, 0, 1.2], width=0.06), RED), "of the cloth's edge are in view"),
        (cloud_of(sheet([0.8, 0, 1.2]), GREY), "no cloth in view"),
    ],
)
def test_a_part_of_an_edge_and_other_colours_are_refused(cloud, message):
    with pytest.raises(NotVisibleError, match=message):
        find_cloth_edge(cloud)


def test_pixels_behind_the_outline_do_not_move_the_edge():
    cloth = cloud_of(sheet([0.8, 0, 1.2]), RED)
    behind = cloud_of(sheet([1.9, 0, 1.6], length=0.02), RED)  # coloured like the cloth, as far away as the wall
    assert find_cloth_edge(both(cloth, behind)).mean(axis=0) == pytest.approx([0.8, 0.0, 1.2], abs=0.01)


def test_a_basket_without_its_handle_in_view_is_refused():
    x, y, z = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 4000))
    points = np.column_stack([x, y, z + 0.5]) * BASKET_SIZE
    points[:, 0] = -BASKET_SIZE[0] / 2  # its near side
    with pytest.raises(NotVisibleError, match=r"basket"):
        find_basket(cloud_of(points, YELLOW))


def test_distances_to_a_basket_that_are_known():
    x, y, z = BASKET_SIZE
    leg, rod = HANDLE_WIDTH / 2, HANDLE_HEIGHT
    points = np.array([[x, 0, 0.05], [0, 0, z / 2], [0, 0, rod + 0.05], [0, leg, 0.15], [x / 2, y / 2, z]])
    expected = [x / 2, -z / 2, 0.05 - HANDLE_RADIUS, -HANDLE_RADIUS, 0.0]
    assert _basket_distance(points, np.zeros(3), 0.0) == pytest.approx(expected, abs=1e-12)
    turned = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) + [1, 2, 3]
    assert _basket_distance(turned, np.array([1.0, 2, 3]), np.pi / 2) == pytest.approx(expected, abs=1e-12)
