"""The table scene: table.xml and the furniture agree, chance stays within its ranges,
what should touch does.
"""

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.scene import Scene
from studies.table_scene.scene import Basket, Furniture, build_spec, place_furniture

FURNITURE, CLOTH, ARM = Furniture(), get_cloth("hard-1"), get_arm("muscle")


@pytest.fixture(scope="module")
def model():
    return build_spec(ARM, CLOTH, Scene(), FURNITURE).compile()


@pytest.mark.parametrize("near", [0.10, 0.35])
def test_the_file_and_the_furniture_say_the_same(near):
    furniture = Furniture(near=near)
    model = build_spec(ARM, CLOTH, Scene(), furniture).compile()
    table, side, basket = (
        model.geom(name) for name in ("table", "side_table", "basket")
    )
    assert (table.pos - table.size)[:2] == pytest.approx([near, -furniture.width / 2])
    assert (table.pos + table.size)[[0, 2]] == pytest.approx(
        [furniture.far, furniture.height]
    )
    assert [*side.pos[:2], (side.pos + side.size)[2]] == pytest.approx(
        furniture.side_place
    )
    legs = np.delete(
        model.geom_pos[model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER],
        slice(4, None),
        axis=0,
    )
    assert legs[:, 0].min() == pytest.approx(near + 0.03)
    assert 2 * basket.size == pytest.approx(Basket.size)
    assert model.site("basket").pos[2] == pytest.approx(Basket.handle_height)
    assert model.actuator("base").ctrlrange == pytest.approx(furniture.base_range)
    assert model.body("basket").mass[0] == pytest.approx(0.3)


def test_chance_stays_within_its_ranges_and_uses_them(model):
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    rack, racks, baskets = model.body("rack").pos, [], []
    for _ in range(300):
        mujoco.mj_resetData(model, data)
        place_furniture(data, FURNITURE, rng)
        mujoco.mj_kinematics(model, data)
        across = data.body("rack").xmat.reshape(3, 3)[:, 1]
        turn, slant = np.rad2deg(
            [np.arctan2(-across[0], across[1]), np.arcsin(across[2])]
        )
        racks.append([*(data.body("rack").xpos - rack), turn, slant])
        ahead = data.body("basket").xmat.reshape(3, 3)[:, 0]
        shift = data.body("basket").xpos - FURNITURE.side_place
        baskets.append([*shift[:2], np.rad2deg(np.arcsin(ahead[1]))])
    for drawn, most in (
        (racks, [*FURNITURE.rack_shift, *FURNITURE.rack_turn]),
        (baskets, [*FURNITURE.basket_shift, FURNITURE.basket_turn]),
    ):
        extent = np.abs(drawn).max(axis=0)
        assert (extent <= np.array(most) * 1.001).all()
        assert (extent > 0.95 * np.array(most)).all()


def test_only_what_should_touch_touches(model):
    def touch(a, b):
        a, b = model.geom(a), model.geom(b)
        return bool((a.contype & b.conaffinity) | (b.contype & a.conaffinity))

    points = [model.body(name).geomadr[0] for name in ("cloth_0_0", "cloth_3_1")]
    bar = model.body("hand").geomadr[0]
    assert not touch(*points)
    for name in ("table", "side_table"):
        assert all(touch(name, other) for other in (*points, bar, "basket"))
    assert touch("basket", points[0])
    assert not touch("basket", bar)
    assert not touch(bar, points[0])
