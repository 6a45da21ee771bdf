"""The other reading of C_damp: which cloths it makes, and how p is judged."""

import numpy as np
import pytest

from clothlab.simulation.cloth import CLOTHS
from studies.other_reading import BOTH, DAMPER, DRAG, READINGS, cloth_of, named

OWN = np.repeat(np.arange(9), 2)  # the cloth of each of the 18 runs


@pytest.mark.parametrize("name", CLOTHS)
def test_c_damp_acts_in_one_place(name):
    cloth = CLOTHS[name]
    assert cloth_of(DRAG, name) == cloth
    assert cloth_of(DAMPER, name).spring_damping == cloth.damping
    assert cloth_of(DAMPER, name).damping == 0
    assert cloth_of(BOTH, name).spring_damping == cloth.damping
    assert cloth_of(BOTH, name).damping == 0.05
    assert {cloth_of(each, name).mass for each in READINGS} == {cloth.mass}


def test_a_run_that_its_own_p_predicts_best_names_both_constants():
    losses = np.ones((18, 9))
    losses[np.arange(18), OWN] = 0
    assert named(losses).tolist() == [1, 1]


def test_a_p_with_the_right_mass_alone_names_the_mass():
    losses = np.ones((18, 9))
    losses[np.arange(18), (OWN + 3) % 9] = 0  # the next C_damp, the same C_mass
    assert named(losses).tolist() == [0, 1]


def test_one_p_for_all_is_chance():
    losses = np.ones((18, 9))
    losses[:, 4] = 0
    assert named(losses) == pytest.approx([1 / 3, 1 / 3])
