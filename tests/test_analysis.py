"""Figures of merit, on cases whose answer is known."""

import numpy as np
import pytest

from clothlab.analysis import MaterialReadout, best_per_period, nearest_material, principal_axes, spread, success_rate
from clothlab.cloth import DAMPINGS, MASSES, Cloth

GRID = {f"{c}-{m}": Cloth(f"{c}-{m}", damping=c, mass=m) for c in DAMPINGS for m in MASSES}


def biases_from(matrix) -> dict[str, np.ndarray]:
    """A p for each cloth of the grid that is linear in (log C_damp, log C_mass)."""
    return {name: np.array(matrix) @ np.log([cloth.damping, cloth.mass]) for name, cloth in GRID.items()}


def test_materials_written_linearly_into_p_are_read_off_exactly():
    biases = biases_from([[1.0, -0.5], [0.3, 2.0]])
    readout = MaterialReadout.fit(biases, GRID)
    assert readout.r2 == pytest.approx([1, 1])
    for name, cloth in GRID.items():
        assert readout(biases[name]) == pytest.approx((cloth.damping, cloth.mass))


def test_a_p_that_knows_only_the_ratio_explains_only_the_ratio():
    rng = np.random.default_rng(0)
    biases = {name: np.array([p[0], rng.normal()]) for name, p in biases_from([[1, -1], [0, 0]]).items()}
    readout = MaterialReadout.fit(biases, GRID)
    assert readout.ratio_r2 > 0.99
    assert (readout.r2 < 0.9).all()


def test_the_spread_is_a_distance_and_the_nearest_is_near():
    biases = {"a": np.array([0.0, 3.0]), "b": np.array([0.0, -3.0])}
    assert spread(biases) == pytest.approx(3)
    assert nearest_material(np.array([5.0, 0.1]), biases) == "a"


def test_the_first_principal_axis_is_the_longest():
    p = np.random.default_rng(0).normal(size=(50, 2)) * (1, 5)
    pca = principal_axes({str(k): each for k, each in enumerate(p)})
    assert abs(pca.components_[0, 1]) > 0.99
    assert pca.explained_variance_ratio_.sum() == pytest.approx(1)


def test_the_best_of_each_period_leaves_the_swing_up_and_the_rest_out():
    distances = np.array([0, 0, 0, 0, 5, 2, 7, 9, 4, 4, 3, 4, -1])  # three whole periods of four
    assert best_per_period(distances, period=4) == pytest.approx([2, 3])


def test_success_rises_with_the_threshold():
    distances = np.array([0.1, 0.5, 0.9, 1.3])
    assert success_rate(distances, np.array([0.0, 0.5, 1.0, 2.0])) == pytest.approx([0, 0.25, 0.75, 1])
