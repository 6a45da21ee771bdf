"""Training configurations: for the arm that they say, from recordings that there are."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab import data
from clothlab.method.autoencoder import AutoencoderTraining
from clothlab.weights import fingerprint, save_autoencoder
from studies._runs import config_of
from studies.datasets import DATASETS
from studies.training_configs import TRAINING_CONFIGS


@pytest.mark.parametrize("name", TRAINING_CONFIGS)
def test_stored_weights_are_those_of_their_configuration(name):
    learned, config = data.load(f"{name}-0"), TRAINING_CONFIGS[name]
    assert learned.arm.name == config.arm
    assert len(learned.losses) == config.model.epochs
    assert config_of(learned) is config
    assert {DATASETS[each].arm for each in config.recordings} == {config.arm}


@pytest.mark.parametrize(("arm", "steps"), [("torque", 4500), ("muscle", 3200)])
def test_a_larger_training_begins_with_the_paper_s_recordings(arm, steps, monkeypatch):
    small, large = TRAINING_CONFIGS[f"{arm}-paper"], TRAINING_CONFIGS[arm]
    papers = small.load_trials()
    assert sum(map(len, papers)) == steps
    there = {name: data.load_trials(name) for name in small.recordings}
    # What is left to `make data` is not here.
    monkeypatch.setattr(data, "load_trials", lambda name: there.get(name, [name]))
    first = large.load_trials()[: len(papers)]
    for one, other in zip(first, papers, strict=True):
        assert np.array_equal(one.commands, other.commands)
    assert set(large.recordings) > set(small.recordings)


def test_recordings_that_are_not_here_are_asked_for(monkeypatch, tmp_path):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    with pytest.raises(KeyError, match="unknown trials 'train'"):
        TRAINING_CONFIGS["torque"].load_trials()


def test_an_autoencoder_and_a_model_on_top_of_it_are_trained_and_found_again(
    monkeypatch, tmp_path, trial
):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    monkeypatch.setattr(data, "load_trials", lambda name: [trial])
    config = TRAINING_CONFIGS["torque"]
    config = replace(
        config,
        autoencoder=AutoencoderTraining(epochs=1, batch_size=12),
        model=replace(config.model, epochs=1, sequence_length=4),
    )
    autoencoder, losses = config.train_autoencoder()
    assert len(losses) == 1
    weights = tmp_path / "weights"
    save_autoencoder(
        autoencoder, losses, weights / f"autoencoder-{config.name}.safetensors"
    )
    trained = config.train_model(seed=3)
    trained.save(weights / f"model-{trained.name}.safetensors", whole=False)
    learned = data.load("torque-3")
    assert fingerprint(learned.autoencoder) == fingerprint(autoencoder)
    assert list(learned.biases) == [trial.cloth.name]
    assert np.array_equal(learned.to_run(trial).s, config.encoded_runs()[0].s)
