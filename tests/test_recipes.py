"""Recipes of the stored weights: for the arm that they say, from recordings that there are."""

import pytest

from clothlab import artifacts
from clothlab.arm import get_arm
from clothlab.recipes import RECIPES


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_is_for_the_arm_whose_weights_it_names(name):
    learned = artifacts.load(f"{name}-0")
    assert learned.arm.name == RECIPES[name].arm == name.removesuffix("-paper")
    assert learned.sees_with == name
    assert len(learned.losses) == RECIPES[name].model.epochs


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_the_paper_s_amount_comes_first_and_is_part_of_the_larger(arm):
    paper, more = (RECIPES[name].recordings for name in (f"{arm}-paper", arm))
    assert more[: len(paper)] == paper
    assert len(more) > len(paper)


def test_all_recordings_of_a_recipe_are_loaded():
    trials = RECIPES["torque-paper"].load_trials()
    assert sum(map(len, trials)) == 4500
    assert {trial.arm for trial in trials} <= {"torque", get_arm("torque")}


def test_recordings_that_are_not_here_are_asked_for(monkeypatch, tmp_path):
    (tmp_path / "trials").mkdir()
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    with pytest.raises(KeyError, match="trials"):
        RECIPES["torque"].load_trials()
