"""What stands in the scene of the table: measures that fit the arm, chance within its ranges."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import Scene
from clothlab.table_scene.scene import Basket, Furniture, build_spec, hanging_points, place_basket, place_rack
from clothlab.table_scene.servoing import OutOfReachError, posture

FURNITURE, CLOTH, ARM = Furniture(), get_cloth("hard-1"), get_arm("muscle")


@pytest.fixture(scope="module")
def model():
    return build_spec(ARM, CLOTH, Scene(), FURNITURE).compile()


def reach(height):
    """How far ahead the hand can be at a height above the floor: from, to [m]."""
    ahead = []
    for x in np.arange(0.1, 0.62, 0.002):
        try:
            posture(ARM, (x, height - 1.0))
        except OutOfReachError:
            continue
        ahead.append(x)
    return ahead[0], ahead[-1]


def test_the_hand_reaches_what_the_docstring_says():
    assert reach(FURNITURE.height + 0.01) == pytest.approx((0.43, 0.45), abs=0.006)
    assert reach(FURNITURE.height + CLOTH.length)[1] == pytest.approx(0.59, abs=0.006)
    assert reach(FURNITURE.height + CLOTH.length)[1] + FURNITURE.base_range[1] == pytest.approx(0.74, abs=0.006)
    assert FURNITURE.near - FURNITURE.base_range[1] == pytest.approx(0.2)


def test_a_cloth_laid_down_has_room_on_the_table():
    near_edge = np.mean(reach(FURNITURE.height + 0.01))
    assert FURNITURE.near < near_edge
    assert near_edge + CLOTH.length < FURNITURE.far
    # With the base drawn up, the basket's handle gets to the middle of the cloth.
    handle = FURNITURE.height + FURNITURE.basket.handle_height
    assert FURNITURE.base_range[1] + reach(handle)[1] > near_edge + CLOTH.length / 2


def test_no_slant_brings_an_edge_out_of_the_hands_reach():
    turn, slant = np.deg2rad(FURNITURE.rack_turn)
    corner = CLOTH.width / 2 * np.hypot(np.sin(turn), np.sin(slant))
    assert corner < FURNITURE.reach - 0.01  # a centimetre is left for the approach


def test_chance_stays_within_its_ranges_and_uses_them(model):
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    racks, baskets = [], []
    for _ in range(300):
        place_rack(data, FURNITURE, rng)
        place_basket(data, FURNITURE, rng)
        mujoco.mj_kinematics(model, data)
        across = data.body("rack").xmat.reshape(3, 3)[:, 1]
        turn, slant = np.rad2deg([np.arctan2(-across[0], across[1]), np.arcsin(across[2])])
        racks.append([*(data.body("rack").xpos - [FURNITURE.rack_place, 0, FURNITURE.rack_height]), turn, slant])
        ahead = data.body("basket").xmat.reshape(3, 3)[:, 0]
        baskets.append([*(data.body("basket").xpos[:2] - [FURNITURE.side_place, 0]), np.rad2deg(np.arcsin(ahead[1]))])
    for drawn, most in (
        (racks, [*FURNITURE.rack_shift, *FURNITURE.rack_turn]),
        (baskets, [*FURNITURE.basket_shift, FURNITURE.basket_turn]),
    ):
        extent = np.abs(drawn).max(axis=0)
        assert (extent <= np.array(most) * 1.001).all()
        assert (extent > 0.95 * np.array(most)).all()


def test_basket_and_tables_weigh_and_stand_as_they_say(model):
    assert model.body("basket").mass[0] == pytest.approx(0.3)
    top = model.geom("table").pos + model.geom("table").size
    assert top[[0, 2]] == pytest.approx([FURNITURE.far, FURNITURE.height])
    assert 2 * model.geom("table").size[0] == pytest.approx(0.7)


def test_only_what_should_touch_touches(model):
    def touch(a, b):
        a, b = model.geom(a), model.geom(b)
        return bool((a.contype & b.conaffinity) | (b.contype & a.conaffinity))

    points = [model.body(name).geomadr[0] for name in ("cloth_0_0", "cloth_3_1")]
    bar = model.body("hand").geomadr[0]
    assert not touch(*points)
    for thing in ("table", "side_table"):
        assert all(touch(thing, other) for other in (*points, bar, "basket"))
    assert touch("basket", points[0])
    assert not touch("basket", bar)
    assert not touch(bar, points[0])


def test_the_cloth_weighs_what_it_does_elsewhere_and_its_first_row_is_free(model):
    names = [model.body(k).name for k in range(model.nbody)]
    points = [name for name in names if name.startswith("cloth_")]
    assert sum(model.body(name).mass[0] for name in points) == pytest.approx(CLOTH.mass)
    assert model.joint("cloth_0_0_x").damping[0] == CLOTH.damping
    assert "cloth_0_0-cloth_0_1" in {model.tendon(k).name for k in range(model.ntendon)}


def test_a_cloth_hangs_down_from_the_middle_of_its_edge():
    points = hanging_points(CLOTH)
    assert points.shape == (CLOTH.rows, CLOTH.columns, 3)
    assert points[0].mean(axis=0) == pytest.approx(np.zeros(3))
    assert points[-1, 0] == pytest.approx([0.0, -CLOTH.width / 2, -CLOTH.length])


@pytest.mark.parametrize(
    "wrong", [{"near": 0.0}, {"depth": -1}, {"rack_shift": (0.1, 0.1)}, {"reach": np.nan}, {"basket": "big"}], ids=str
)
def test_furniture_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=f"Furniture.{next(iter(wrong))}"):
        replace(FURNITURE, **wrong)


def test_a_basket_without_mass_is_refused():
    with pytest.raises(ValueError, match=r"Basket.mass must be above 0"):
        Basket(mass=0.0)
