"""When a cloth is spread."""

import numpy as np
import pytest

from clothlab.simulation.cloth import get_cloth
from clothlab.table_scene.scene import Furniture
from clothlab.table_scene.table_env import ClothPose, measure_pose

CLOTH, FURNITURE = get_cloth("hard-1"), Furniture()


def flat(height=0.603, ahead=0.68, turn=0.0):
    """A cloth that lies at a height, its middle so far ahead `[rows, columns, 3]` [m]."""
    x, y = np.meshgrid(
        np.linspace(-0.5, 0.5, CLOTH.rows) * CLOTH.length,
        np.linspace(-0.5, 0.5, CLOTH.columns) * CLOTH.width,
        indexing="ij",
    )
    cos, sin = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    return np.stack([ahead + cos * x - sin * y, sin * x + cos * y, np.full_like(x, height)], axis=-1)


def test_a_flat_cloth_is_spread():
    pose = measure_pose(CLOTH, FURNITURE, flat())
    assert pose.spread
    assert (pose.flat, pose.angle) == (1.0, pytest.approx(0.0))
    assert pose.area == pytest.approx(1.0, abs=0.01)
    assert pose.centre == pytest.approx([0.68, 0.0, 0.603])


@pytest.mark.parametrize(("turn", "spread"), [(14.0, True), (-14.0, True), (16.0, False), (180.0, False)])
def test_a_turned_cloth_is_spread_up_to_fifteen_degrees(turn, spread):
    pose = measure_pose(CLOTH, FURNITURE, flat(turn=turn))
    assert pose.angle == pytest.approx(turn)
    assert pose.area == pytest.approx(1.0, abs=0.015)
    assert pose.spread == spread


def test_a_folded_cloth_covers_half():
    points = flat()
    points[3:, :, 0] = points[2::-1, :, 0]
    pose = measure_pose(CLOTH, FURNITURE, points)
    assert pose.area == pytest.approx(0.4, abs=0.01)  # two of the five cells between six rows
    assert pose.fault == "it is folded or hangs over the edge"


@pytest.mark.parametrize("points", [flat(0.63), flat(ahead=1.0), flat(0.0)], ids=["hovers", "hangs", "floor"])
def test_a_cloth_that_is_not_on_the_table_is_not_spread(points):
    assert measure_pose(CLOTH, FURNITURE, points).fault == "it does not lie flat on the table"


def test_a_cloth_seen_with_its_front_up_lies_the_wrong_way_round():
    assert ClothPose(1.0, 1.0, 0.0, np.zeros(3), back_up=False).fault == "it lies the wrong way round"
