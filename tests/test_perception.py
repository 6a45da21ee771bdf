"""Recognition: cloth, basket and bar in clouds from the scene and in clouds made by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.simulation.cloth import get_cloth
from clothlab.table_scene.depth import PointCloud, look
from clothlab.table_scene.perception import (
    NotInView,
    basket_distance,
    find_bar,
    find_basket,
    find_cloth,
    find_laid_cloth,
    find_spread,
)
from clothlab.table_scene.scene import Basket
from clothlab.table_scene.table_env import TableEnv

ASIDE = (2.0, 0.0, -0.6)  # [m] out of the way of a look at the basket
RED, YELLOW, BLACK, GREY = (200, 20, 25), (190, 175, 40), (40, 40, 40), (160, 150, 130)


@pytest.fixture(scope="module")
def env():
    env = TableEnv()
    yield env
    env.close()


def put(env, *, base=None, cloth=None):
    """Move things by hand: no physics, only a picture."""
    if base is not None:
        env.data.joint("base").qpos[0] = base
    if cloth is not None:
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


@pytest.mark.parametrize("seed", range(4))
def test_the_edge_of_a_hanging_cloth_is_found_with_its_slant(env, seed):
    env.start(seed=seed)
    seen, edge = find_cloth(look(env)), env.cloth_points()[0]
    assert seen.ends[:, [0, 2]] == pytest.approx(edge[[0, 2]][:, [0, 2]], abs=0.003)
    assert seen.ends[:, 1] == pytest.approx(edge[[0, 2], 1], abs=0.012)  # a column of pixels, a bin of points
    across = edge[2] - edge[0]
    assert seen.turn == pytest.approx(np.rad2deg(np.arctan2(-across[0], across[1])), abs=0.5)
    assert seen.slant == pytest.approx(np.rad2deg(np.arctan2(across[2], np.hypot(*across[:2]))), abs=0.5)
    assert seen.place == pytest.approx(edge[1], abs=0.006)


def test_a_noisy_camera_finds_the_edge_too(env):
    env.start(seed=1)
    seen = find_cloth(look(env, noise=0.003, rng=np.random.default_rng(0)))
    assert seen.place == pytest.approx(env.cloth_points()[0, 1], abs=0.012)


@pytest.mark.parametrize("seed", range(3))
def test_the_basket_is_found_with_its_handle(env, seed):
    env.start(seed=seed)
    put(env, base=env.furniture.side_place - 0.85, cloth=np.add(env.cloth_points(), ASIDE))
    seen, basket = find_basket(look(env)), env.data.body("basket")
    assert seen.bottom == pytest.approx(basket.xpos, abs=0.003)
    assert seen.place == pytest.approx(env.data.site("basket").xpos, abs=0.003)
    assert seen.turn == pytest.approx(np.rad2deg(np.arctan2(basket.xmat[3], basket.xmat[0])), abs=1.0)
    assert seen.residual < 0.002


def test_the_pose_of_a_basket_seen_with_noise_is_within_a_centimetre(env):
    env.start(seed=1)
    put(env, base=env.furniture.side_place - 0.85, cloth=np.add(env.cloth_points(), ASIDE))
    seen = find_basket(look(env, noise=0.003, rng=np.random.default_rng(0)))
    assert seen.place == pytest.approx(env.data.site("basket").xpos, abs=0.01)


def test_the_bar_is_found_where_the_hand_is(env):
    env.start(seed=0)
    assert find_bar(look(env), env.hand + 0.02) == pytest.approx(env.hand, abs=0.005)


def test_a_cloth_on_the_table_is_found(env):
    env.start(seed=0)
    x, y = np.meshgrid(np.linspace(0.45, 0.95, 6), np.linspace(-0.2, 0.2, 3), indexing="ij")
    put(env, base=0.0, cloth=np.stack([x, y, np.full_like(x, 0.603)], axis=-1))
    laid = find_laid_cloth(look(env), env.furniture.height)
    assert laid.centre == pytest.approx([0.70, 0.0, 0.603], abs=0.006)
    assert laid.size == pytest.approx([0.5, 0.4], abs=0.01)


BACK, FRONT = (160, 12, 49), (209, 18, 25)


def lying(length=0.5, turn=0.0, colour=BACK, height=0.6):
    """A sheet on a table at 0.6 m, its middle at the world's origin."""
    _, y, x = sheet((0.0, 0.0, length / 2), length=length).T
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    points = np.column_stack([cos * x - sin * y, sin * x + cos * y, np.full(len(x), height)])
    return find_spread(cloud_of(points, colour), 0.6, get_cloth("hard-1"))


def test_a_sheet_on_the_table_covers_what_it_covers():
    assert lying().success
    assert lying().area == pytest.approx(1.0, abs=0.06)  # its outline lies on the grid: no cell is half covered
    assert lying().flat == 1.0
    assert lying(length=0.42).area == pytest.approx(0.84, abs=0.06)
    assert not lying(length=0.40).success


@pytest.mark.parametrize(("turn", "success"), [(10.0, True), (-12.0, True), (20.0, False), (-20.0, False)])
def test_a_turned_sheet_is_seen_turned(turn, success):
    assert lying(turn=turn).angle == pytest.approx(turn, abs=1.0)
    assert lying(turn=turn).success == success


def test_a_sheet_with_its_front_up_or_in_the_air_is_not_spread():
    assert not lying(colour=FRONT).back_up
    assert not lying(colour=FRONT).success
    assert lying(height=0.65).flat == 0
    assert not lying(height=0.65).success


def test_what_is_not_there_is_not_in_view(env):
    env.start(seed=0)
    put(env, base=0.0)  # past the rack and the side table
    cloud = look(env)
    with pytest.raises(NotInView, match=r"no cloth in view: \d+ points have its colour, 150 are needed"):
        find_cloth(cloud)
    with pytest.raises(NotInView, match="no basket in view"):
        find_basket(cloud)
    with pytest.raises(NotInView, match="the bar is not in view where the hand is felt"):
        find_bar(cloud, [0.6, 0.0, 1.4])
    with pytest.raises(NotInView, match="no cloth on the table in view"):
        find_laid_cloth(cloud, 0.6)


def test_an_empty_cloud_has_nothing_in_it():
    empty = cloud_of(np.empty((0, 3)), RED)
    for find in (find_cloth, find_basket, lambda cloud: find_bar(cloud, np.zeros(3))):
        with pytest.raises(NotInView):
            find(empty)


def test_an_edge_at_the_pictures_border_is_refused():
    with pytest.raises(NotInView, match="upper edge is cut off by the picture: look from farther away"):
        find_cloth(cloud_of(sheet([0.8, 0, 1.2]), RED, inside=False))


def test_a_strip_is_no_edge():
    with pytest.raises(NotInView, match="of the cloth's edge are in view"):
        find_cloth(cloud_of(sheet([0.8, 0, 1.2], width=0.06), RED))


def test_pixels_behind_the_outline_do_not_move_the_edge():
    cloth = cloud_of(sheet([0.8, 0, 1.2]), RED)
    behind = cloud_of(sheet([1.9, 0, 1.6], length=0.02), RED)  # coloured like the cloth, as far away as the wall
    assert find_cloth(both(cloth, behind)).place == pytest.approx([0.8, 0.0, 1.2], abs=0.01)


def test_other_colours_are_neither_cloth_nor_basket():
    grey = cloud_of(sheet([0.8, 0, 1.2]), GREY)
    with pytest.raises(NotInView):
        find_cloth(grey)
    with pytest.raises(NotInView):
        find_basket(both(grey, cloud_of(sheet([0.8, 0, 1.2]), RED)))


def test_a_basket_without_its_handle_in_view_is_refused():
    basket = Basket()
    x, y, z = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 4000))
    points = np.column_stack([x, y, z + 0.5]) * basket.size
    points[:, 0] = -basket.size[0] / 2  # its near side
    with pytest.raises(NotInView, match=r"basket"):
        find_basket(cloud_of(points, YELLOW))


def test_distances_to_a_basket_that_are_known():
    basket = replace(Basket(), size=(0.2, 0.16, 0.1), handle=0.1, handle_width=0.12, handle_radius=0.01)
    points = np.array([[0.2, 0, 0.05], [0, 0, 0.05], [0, 0, 0.25], [0, 0.06, 0.15], [0, 0, 0.15], [0.1, 0.08, 0.1]])
    expected = [0.1, -0.05, 0.04, -0.01, 0.04, 0.0]
    assert basket_distance(points, basket, np.zeros(3), 0.0) == pytest.approx(expected, abs=1e-12)
    turned = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) + [1, 2, 3]
    assert basket_distance(turned, basket, np.array([1.0, 2, 3]), np.pi / 2) == pytest.approx(expected, abs=1e-12)


def test_a_dark_place_far_from_the_hand_is_no_bar():
    y = np.linspace(-0.22, 0.22, 300)
    bar = cloud_of(np.column_stack([np.full(300, 0.5), y, np.full(300, 1.0)]), BLACK)
    assert find_bar(bar, [0.5, 0, 1.0]) == pytest.approx([0.5, 0, 1.0], abs=0.008)
    with pytest.raises(NotInView):
        find_bar(bar, [0.5, 0.0, 1.5])
    with pytest.raises(ValueError, match="near"):
        find_bar(bar, [0.5, 0.0])
