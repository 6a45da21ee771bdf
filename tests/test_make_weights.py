"""Training of the stored weights, tiny: what is trained on what, and what it is stored as."""

import shutil
from dataclasses import replace

import make_weights
import numpy as np
import pytest

from clothlab import artifacts
from clothlab.dpmpb import to_sequences
from clothlab.recipes import RECIPES, recipe_of

NAME = "torque-feeling"


@pytest.fixture
def data(tmp_path, monkeypatch):
    """A folder with the eyes alone."""
    eye = "weights/autoencoder-torque.safetensors"
    (tmp_path / "weights").mkdir()
    shutil.copy(artifacts.data_folder() / eye, tmp_path / eye)
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    return tmp_path


def test_only_those_without_borrowed_eyes_train_an_autoencoder():
    found = make_weights.autoencoders(list(RECIPES))
    assert [name for name, _ in found] == ["torque-paper", "muscle-paper", "torque", "muscle", "table"]
    assert make_weights.autoencoders(["muscle"]) == [("muscle", RECIPES["muscle"].autoencoder)]


def test_a_robot_that_feels_learns_with_the_eyes_of_one_that_does_not(monkeypatch, data, trial):
    recipe = RECIPES[NAME]
    brief = replace(recipe, model=replace(recipe.model, epochs=1, sequence_length=4))
    monkeypatch.setitem(RECIPES, NAME, brief)
    monkeypatch.setattr(artifacts, "load_trials", lambda name: [trial])
    autoencoder, _ = artifacts.load_autoencoder("torque")
    runs = [to_sequences(autoencoder, each) for each in brief.load_trials()]
    make_weights.train_one(NAME, runs, 0, progress=False)
    learned = artifacts.load(f"{NAME}-0")
    assert (learned.arm.name, learned.sees_with, learned.model.state_size) == ("torque-feeling", "torque", 9)
    assert recipe_of(learned) is brief
    assert np.array_equal(learned.sequences(trial).s, runs[0].s)  # whichever of the two arms recorded it
    assert (data / f"weights/dpmpb-{NAME}-0.safetensors").is_file()
