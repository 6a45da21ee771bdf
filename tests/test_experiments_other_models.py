"""Other models: they know what they are said to know, and learn from what they are given."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab import artifacts
from clothlab.experiments import other_models
from clothlab.experiments.other_models import Retraining, retrained, with_constants, without_p
from clothlab.learning.dpmpb import stretches


@pytest.fixture(autouse=True)
def one_epoch(monkeypatch):
    whole = other_models.train_dpmpb
    monkeypatch.setattr(
        other_models, "train_dpmpb", lambda runs, recipe, **how: whole(runs, replace(recipe, epochs=1), **how)
    )


@pytest.fixture(scope="module")
def learned():
    return artifacts.load("torque-0")


@pytest.fixture(scope="module")
def runs(learned):
    return [learned.sequences(trial[:60]) for trial in artifacts.load_trials("train")[::2]]


def test_without_p_all_materials_are_one(learned, runs):
    blind = without_p(learned, runs, 0)
    assert blind.model.bias_size == 0
    assert all(p.shape == (0,) for p in blind.biases.values())


def test_it_is_stored_like_any_other(learned, runs, tmp_path):
    (tmp_path / "weights").mkdir()
    blind = without_p(learned, runs, 0)
    artifacts.save_autoencoder(learned.autoencoder, [0.0], "torque", data=tmp_path)
    artifacts.save(blind, data=tmp_path)
    again = artifacts.load("torque-0", data=tmp_path)
    for name, value in blind.model.state_dict().items():
        assert torch.equal(again.model.state_dict()[name], value)


def test_with_constants_p_is_what_the_cloth_is_made_of(learned, runs):
    told = with_constants(learned, runs, 0)
    p = np.array([told.biases[name] for name in sorted(told.biases)])
    assert np.allclose(p.mean(0), 0, atol=1e-6)
    assert np.allclose(p.std(0), 1, atol=1e-6)
    light, heavy = (told.biases[name] for name in ("damp0.03-mass0.05", "damp0.03-mass0.15"))
    assert light[0] == heavy[0]
    assert light[1] < heavy[1]


def test_the_recipes_other_settings_stay(learned, runs):
    told = with_constants(learned, runs, 0)
    assert len(told.losses) == 1
    assert told.autoencoder_name == learned.autoencoder_name


def test_retraining_lowers_the_error_on_its_own_runs_and_leaves_the_first_model_alone(learned, runs):
    own = [learned.sequences(artifacts.load_trials("evaluation")[0])]
    before = {name: value.clone() for name, value in learned.model.state_dict().items()}

    def error(model):
        s, u, _ = stretches(own, 30, 5)
        p = torch.as_tensor(learned.biases[own[0].material])
        with torch.no_grad():
            return model.loss(model(s[:, :-1], u, p.expand(len(s), -1))[0], s[:, 1:]).item()

    wiser = retrained(learned, runs, own, Retraining(updates=30, batch_size=16))
    assert error(wiser) < error(learned.model)
    for name, value in learned.model.state_dict().items():
        assert torch.equal(before[name], value)


def test_the_same_seed_gives_the_same_model(learned, runs):
    settings = Retraining(updates=2, batch_size=4)
    first, second, other = (retrained(learned, runs, runs[:1], settings, seed=k) for k in (1, 1, 2))
    pairs = [(name, first.state_dict()[name], second.state_dict()[name]) for name in first.state_dict()]
    assert all(torch.equal(a, b) for _, a, b in pairs)
    assert not all(torch.equal(value, other.state_dict()[name]) for name, value in first.state_dict().items())
