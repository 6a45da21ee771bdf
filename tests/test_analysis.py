"""Figures of merit, on cases whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from clothlab import CLOTHS, load
from clothlab.analysis import (
    best_per_period,
    crossed_interval,
    nearest_material,
    period_ends,
    points,
    principal_axes,
    rate_interval,
    spread,
    target_distance,
    upright,
)
from clothlab.lab import PBMap
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings
from clothlab.simulation.cloth import DAMPINGS, MASSES, Cloth
from clothlab.simulation.vision import chamfer_distance
from studies._runs import bias_error, chamfer_against_z
from studies.estimation import MaterialReadout

GRID = {
    f"{c}-{m}": Cloth(f"{c}-{m}", damping=c, mass=m) for c in DAMPINGS for m in MASSES
}
TWO = {"a": np.array([0.0, 3.0]), "b": np.array([0.0, -3.0])}


def biases_from(matrix) -> dict[str, np.ndarray]:
    """A p for each cloth of the grid that is linear in (log C_damp, log C_mass)."""
    return {
        name: np.array(matrix) @ np.log([cloth.damping, cloth.mass])
        for name, cloth in GRID.items()
    }


def test_materials_written_linearly_into_p_are_read_off_exactly():
    biases = biases_from([[1.0, -0.5], [0.3, 2.0]])
    readout = MaterialReadout.fit(biases, GRID)
    assert readout.linear_r2 == pytest.approx([1, 1])
    assert (readout.r2 > 0.99).all()
    for name, cloth in GRID.items():
        assert readout(biases[name]) == pytest.approx(
            (cloth.damping, cloth.mass), rel=0.02
        )


def test_materials_written_on_a_curved_surface_are_read_off_too():
    biases = {
        name: np.array([np.exp(a), b - 0.3 * a**2])
        for name, (a, b) in biases_from(np.eye(2)).items()
    }
    readout = MaterialReadout.fit(biases, GRID)
    assert (readout.r2 > 0.9).all()
    assert (readout.r2 > readout.linear_r2).all()


def test_what_is_not_in_p_is_not_read_off():
    rng = np.random.default_rng(1)
    assert (
        MaterialReadout.fit({name: rng.normal(size=2) for name in GRID}, GRID).r2 < 0.5
    ).all()
    only_ratio = {
        name: np.array([p[0], rng.normal()])
        for name, p in biases_from([[1, -1], [0, 0]]).items()
    }
    readout = MaterialReadout.fit(only_ratio, GRID)
    assert readout.ratio_r2 > 0.99
    assert (readout.r2 < 0.9).all()


def test_the_spread_is_a_distance_and_the_nearest_is_near():
    assert spread(TWO) == pytest.approx(3)
    assert nearest_material([5.0, 0.1], TWO) == "a"
    assert nearest_material(np.float32([5.0, -0.1]), TWO) == "b"
    # Of the spread of 3
    assert bias_error([TWO["a"][0], TWO["a"][1] + 6.0], "a", TWO) == pytest.approx(2)
    with pytest.raises(ValueError, match="two materials"):
        principal_axes({"a": [0.0, 1.0]})


@pytest.mark.parametrize("name", ["torque-0", "torque-2", "torque-paper-0"])
def test_all_maps_of_p_are_the_same_way_round(name):
    """The axes of notebooks and figures, and what the widget draws."""
    biases = load(name).biases
    pca = principal_axes(biases)
    at = {name: pca.transform(p[None])[0] for name, p in biases.items()}
    assert upright(at).tolist() == [1, 1]
    assert at["damp0.07-mass0.05"][0] > 0 > at["damp0.03-mass0.15"][0]
    assert at["damp0.03-mass0.05"][1] > at["damp0.07-mass0.15"][1]
    for dot in PBMap(biases, {}, p=np.zeros(2)).about["dots"]:
        assert dot["at"] == pytest.approx(at[dot["name"]])

    # Whichever way the numbers of p themselves are turned
    turned = {name: -p[::-1] for name, p in biases.items()}
    again = principal_axes(turned).transform([*turned.values()])
    assert again == pytest.approx(np.array([*at.values()]), abs=1e-5)


def test_other_materials_stay_as_they_are():
    assert upright({"a": [1.0, 2.0], "b": [-1.0, -2.0]}).tolist() == [1, 1]
    assert list(CLOTHS)[2] == "damp0.03-mass0.15"
    flipped = {name: -np.ones(2) * k for k, name in enumerate(CLOTHS)}
    assert upright(flipped).tolist() == [-1, 1]


def test_a_period_holds_its_end_and_not_that_of_the_one_before():
    distances = [-9, 6, 5, 7, 1, 2, 7, 9, 4, 4, 3, 4, 3, -1]  # three whole ones of four
    assert best_per_period(distances, period=4) == pytest.approx([1, 2, 3])
    assert len(best_per_period(distances[:4], period=4)) == 0
    with pytest.raises(ValueError, match="period must be at least 1"):
        best_per_period(distances, 0)


@pytest.mark.parametrize("period", [1, 3, 8])
def test_the_mask_and_the_periods_end_at_the_same_steps(period):
    settings = ControlSettings(horizon=40, period=period)
    ends = np.flatnonzero(period_mask(0, settings)) + 1  # step 0 is not predicted
    distances = np.ones(41)
    for k, end in enumerate(ends):
        lower = distances.copy()
        lower[end] = 0
        found = best_per_period(lower, period)
        assert np.flatnonzero(found == 0).tolist() == [k]


def test_distance_to_a_target_is_that_of_their_z(trial):
    autoencoder = Autoencoder().eval()
    distances = target_distance(autoencoder, trial, trial.images[0])
    z = encode(autoencoder, trial.images)
    assert distances == pytest.approx(np.linalg.norm(z - z[0], axis=1), abs=1e-5)
    with pytest.raises(ValueError, match=r"cloth image|no cloth"):
        target_distance(autoencoder, trial, np.zeros((96, 128)))


def test_both_distances_are_compared_where_cloth_is_in_view_and_the_logarithm_exists(
    trial,
):
    images = trial.images.copy()
    images[3] = False
    log_chamfer, z = chamfer_against_z(
        Autoencoder().eval(), replace(trial, images=images), images[0]
    )
    compared = [image for image in images if image.any() and (image != images[0]).any()]
    assert 0 < len(compared) < 11
    assert log_chamfer == pytest.approx(
        [np.log(chamfer_distance(image, images[0])) for image in compared]
    )
    assert len(z) == len(compared)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_units", "of_repeats", "rest"), [(1, 0.5, 1), (0, 1, 1), (0, 0, 1), (1, 0, 0)]
)
def test_an_interval_over_units_and_repeats_covers_what_it_says(
    of_units, of_repeats, rest
):
    rng = np.random.default_rng(0)
    held = []
    for _ in range(400):
        values = of_units * rng.normal(size=(12, 1)) + of_repeats * rng.normal(size=5)
        values = values + rest * rng.normal(size=(12, 5))
        _, low, high = crossed_interval(values)
        held.append(low <= 0 <= high)
    assert np.mean(held) > 0.92


def test_with_one_repeat_the_interval_is_students():
    values = np.array([0.3, 0.1, 0.4, 0.2])
    students = stats.ttest_1samp(values, 0).confidence_interval()
    found = crossed_interval(values[:, None])
    assert found == pytest.approx((0.25, *students))
    assert crossed_interval(values[None]) == pytest.approx(found)


def test_an_interval_of_equal_numbers_is_a_point_and_of_one_number_everything():
    assert crossed_interval(np.full((3, 2), 0.5)) == (0.5, 0.5, 0.5)
    assert crossed_interval([[0.5]]) == (0.5, -np.inf, np.inf)


def test_a_rate_has_an_interval_that_holds_the_true_one():
    rng = np.random.default_rng(0)
    for truth in (0.1, 0.5, 0.9):
        intervals = [rate_interval(rng.random(50) < truth) for _ in range(150)]
        assert (
            0.88 < np.mean([low <= truth <= high for _, low, high in intervals]) < 0.99
        )
    assert rate_interval([True, False, False, False])[0] == 0.25
    with pytest.raises(ValueError, match="held says"):
        rate_interval([0.5, 1.0])


def test_a_rate_of_all_or_none_is_not_sure():
    rate, low, high = rate_interval(np.ones(50, bool))
    assert (rate, high) == pytest.approx((1.0, 1.0))
    # Wilson's, solved for all of fifty
    assert low == pytest.approx(50 / (50 + 1.96**2), abs=1e-3)
    assert rate_interval(np.zeros(50, bool))[2] == pytest.approx(1 - low)


def test_points_of_a_throw_are_of_its_end():
    distances = [2.0, *[0.5] * 7, 1.0, *[0.1] * 7, 3.0, 0.0]
    ends = period_ends(distances)
    assert list(ends) == [1.0, 3.0]
    assert list(points(ends, still=2.0)) == [50.0, -50.0]
    assert points(0.0, still=2.0) == 100.0
