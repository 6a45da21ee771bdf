"""Recipes of the stored weights: for the arm that they say, from recordings that there are."""

import shutil
from dataclasses import replace

import pytest

from clothlab import artifacts
from clothlab.learning.autoencoder import AutoencoderTraining
from clothlab.simulation.arm import get_arm
from clothlab.training_configs import RECIPES, recipe_of, sees_with, train_eyes


def stored(name):
    hashes = (artifacts.data_folder() / artifacts.CHECKSUMS).read_text()
    return f"weights/dpmpb-{name}-0.safetensors" in hashes


def test_the_weights_that_the_notebooks_start_from_are_stored():
    assert {name for name in RECIPES if stored(name)} >= {"torque", "torque-paper", "muscle", "muscle-paper"}


@pytest.mark.parametrize("name", list(filter(stored, RECIPES)))
def test_a_recipe_is_for_the_arm_whose_weights_it_names(name):
    learned = artifacts.load(f"{name}-0")
    assert learned.arm.name == RECIPES[name].arm == {"table": "muscle-hand"}.get(name, name.removesuffix("-paper"))
    assert learned.autoencoder_name == sees_with(name)
    assert len(learned.losses) == RECIPES[name].model.epochs
    assert recipe_of(learned) is RECIPES[name]


@pytest.mark.parametrize("name", RECIPES)
def test_whoever_sees_with_another_one_s_eyes_has_the_same_camera_and_recordings(name):
    recipe, eye = RECIPES[name], RECIPES[sees_with(name)]
    assert not isinstance(eye.autoencoder, str)
    assert get_arm(recipe.arm).camera == get_arm(eye.arm).camera
    assert recipe.recordings == eye.recordings


def test_an_unknown_recipe_lists_the_choices():
    with pytest.raises(KeyError, match=r"unknown recipe 'pancakes'; choose from torque-paper, muscle-paper, torque"):
        sees_with("pancakes")
    with pytest.raises(KeyError, match=r"'muscle with torque'; choose from torque with torque-paper"):
        recipe_of(replace(artifacts.load("torque-0"), arm=get_arm("muscle")))


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


@pytest.fixture
def data(tmp_path, monkeypatch):
    """A folder with the eyes alone."""
    eye = "weights/autoencoder-torque.safetensors"
    (tmp_path / "weights").mkdir()
    shutil.copy(artifacts.data_folder() / eye, tmp_path / eye)
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    return tmp_path


def test_a_recipe_of_another_size_makes_weights_of_the_same_name(monkeypatch, data, trial):
    monkeypatch.setattr(artifacts, "load_trials", lambda name: [trial])
    small = replace(RECIPES["torque"], autoencoder=AutoencoderTraining(epochs=1, batch_size=12))
    before, _ = artifacts.load_autoencoder("torque")
    train_eyes("torque", small)
    after, losses = artifacts.load_autoencoder("torque")
    assert len(losses) == 1
    assert after.fingerprint() != before.fingerprint()
