"""A checkpoint is one file that can lie anywhere, and comes back as what it was."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from shared import shaken

from clothlab import data
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.simulation.arm import TorqueArm
from clothlab.weights import Checkpoint, ClothCheckpoint


def equal(a: torch.nn.Module, b: torch.nn.Module) -> bool:
    """Whether two networks have the same layers, with the same numbers."""
    ours, theirs = a.state_dict(), b.state_dict()
    return list(ours) == list(theirs) and all(
        torch.equal(ours[name], theirs[name]) for name in ours
    )


@pytest.fixture
def swing() -> Checkpoint:
    """Of a robot without camera and arm."""
    model = shaken(DPMPB(2, 1, bias_size=1))
    model.step = 0.1
    model.state_names = ("angle [rad]", "speed [rad/s]")
    model.command_names = ("torque [N m]",)
    return Checkpoint(
        name="swing-0",
        model=model,
        biases={"light": np.float32([0.1]), "heavy": np.float32([1 / 3])},
        losses=np.array([0.5, 0.125]),
        settings=ModelTraining(epochs=2, bias_size=1, learning_rate=1e-3),
    )


@pytest.fixture
def cloth() -> ClothCheckpoint:
    model = shaken(DPMPB(7, 2)).eval()
    model.step = 0.2
    return ClothCheckpoint(
        name="torque-0",
        arm=replace(TorqueArm(), link_length=0.35),  # which has kept its name
        autoencoder=shaken(Autoencoder()).eval(),
        model=model,
        biases={"a": np.array([1.0, 2.0], np.float32)},
    )


def test_every_field_of_a_checkpoint_comes_back(swing, tmp_path):
    swing.save(tmp_path / "a" / "b" / "swing.safetensors")
    read = Checkpoint.load(str(tmp_path / "a" / "b" / "swing.safetensors"))
    assert equal(read.model, swing.model)
    assert not read.model.training
    assert not any(each.requires_grad for each in read.model.parameters())
    assert read.biases == {"light": np.float32([0.1]), "heavy": np.float32([1 / 3])}
    assert read.losses.tolist() == [0.5, 0.125]
    assert (read.name, read.settings) == (swing.name, swing.settings)
    for field in ("step", "state_names", "command_names"):
        assert getattr(read.model, field) == getattr(swing.model, field), field


def test_a_checkpoint_may_know_nothing_but_its_model(tmp_path):
    bare = Checkpoint(name="bare", model=DPMPB(2, 1, bias_size=0), biases={})
    bare.save(tmp_path / "bare.safetensors")
    read = Checkpoint.load(tmp_path / "bare.safetensors")
    assert equal(read.model, bare.model)
    assert read.biases == {}
    assert len(read.losses) == 0


def test_a_changed_arm_comes_back_as_itself_elsewhere(cloth, tmp_path):
    cloth.save(tmp_path / "here.safetensors")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "here.safetensors").rename(elsewhere / "there.safetensors")
    read = data.load(elsewhere / "there.safetensors")
    assert isinstance(read, ClothCheckpoint)
    assert read.arm == cloth.arm != TorqueArm()
    assert equal(read.autoencoder, cloth.autoencoder)
    assert equal(read.model, cloth.model)
    assert read.layout == cloth.layout
    assert read.model.step == 0.2


FRESH = """
import sys
import numpy as np
from clothlab import data
learned = data.load(sys.argv[1])
mask = np.zeros((96, 128), bool)
mask[30:50, 40:70] = True
controller = learned.controller(mask, "a", arm=learned.arm)
u = controller({"image": mask, "robot": np.zeros(4)})
print(learned.arm.link_length, *u.tolist())
"""


@pytest.mark.slow
def test_a_fresh_process_without_the_data_folder_goes_on(cloth, square, tmp_path):
    path = tmp_path / "cloth.safetensors"
    cloth.save(path)
    nowhere = os.environ | {"CLOTHLAB_DATA": str(tmp_path / "nowhere")}
    done = subprocess.run(
        [sys.executable, "-c", FRESH, str(path)],
        env=nowhere | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    length, *u = map(float, done.stdout.split())
    assert length == 0.35
    here = cloth.controller(square, "a")({"image": square, "robot": np.zeros(4)})
    assert u == pytest.approx(here.tolist(), abs=1e-4)


def test_a_model_that_diverged_is_not_written(swing, tmp_path):
    path = tmp_path / "swing.safetensors"
    with torch.no_grad():
        swing.model.fc_in[0].weight[0, 0] = torch.nan
    with pytest.raises(ValueError, match=r"model.fc_in.0.weight are not finite"):
        swing.save(path)
    assert not path.exists()


@pytest.mark.parametrize("name", ["log.csv", "folder"])
def test_a_file_of_weights_is_known_by_its_ending(swing, tmp_path, name):
    for use in (swing.save, Checkpoint.load):
        with pytest.raises(
            ValueError, match=r"a file of weights ends in \.safetensors"
        ):
            use(tmp_path / name)


def test_a_damaged_or_missing_file_and_one_of_others_are_named(swing, tmp_path):
    path = tmp_path / "swing.safetensors"
    swing.save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"swing.safetensors is damaged"):
        Checkpoint.load(path)
    with pytest.raises(FileNotFoundError):
        Checkpoint.load(tmp_path / "none.safetensors")
    save_file({"x": torch.zeros(1)}, tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match=r"other.safetensors is damaged or holds no"):
        Checkpoint.load(tmp_path / "other.safetensors")


def test_a_robot_without_an_arm_is_no_cloth_robot(swing, tmp_path):
    swing.save(tmp_path / "swing.safetensors")
    with pytest.raises(ValueError, match=r"holds no checkpoint"):
        ClothCheckpoint.load(tmp_path / "swing.safetensors")


def test_a_training_is_saved_with_its_settings_and_controls_as_before(tmp_path):
    rng = np.random.default_rng(0)
    runs = [Run(rng.normal(size=(40, 2)), rng.normal(size=(40, 1)), "a")]
    settings = ModelTraining(epochs=1, sequence_length=5)
    model, biases, losses = train_dpmpb(runs, settings, progress=False)
    trained = Checkpoint(
        name="toy", model=model, biases=biases, losses=losses, settings=settings
    )
    trained.save(tmp_path / "toy.safetensors")
    read = Checkpoint.load(tmp_path / "toy.safetensors")
    assert read.settings == settings
    assert np.array_equal(read.losses, losses)
    assert read.biases["a"].dtype == biases["a"].dtype
    assert np.array_equal(read.biases["a"], biases["a"])


def test_a_file_that_speaks_of_a_huge_network_is_refused_before_it_is_made(
    swing, tmp_path, monkeypatch
):
    path = tmp_path / "swing.safetensors"
    monkeypatch.setattr(swing.model, "state_size", 10**12)
    swing.save(path)
    with pytest.raises(ValueError, match=r"(?s)swing.safetensors is damaged.*mismatch"):
        Checkpoint.load(path)


def test_a_trial_of_another_arm_is_no_run_of_these_weights(cloth, trial, muscle_trial):
    assert cloth.to_run(trial).material == trial.cloth.name
    with pytest.raises(
        ValueError, match=r"of the muscle arm, .* of the torque arm: load"
    ):
        cloth.to_run(muscle_trial)


def test_what_a_person_prints_is_a_line_without_numbers(cloth, swing, trial):
    shown = {
        trial: "Trial of damp0.05-mass0.10 by random: 12 steps of 0.2 s, torque arm",
        cloth.to_run(
            trial
        ): "Run of damp0.05-mass0.10: 12 steps of 0.2 s, 7 states, 2 commands",
        cloth.model: "DPMPB: 7 states, 2 commands, 2 numbers in p",
        cloth.autoencoder: "Autoencoder: images of 128×96 pixels, 3 numbers in z",
        cloth: "ClothCheckpoint torque-0 of DPMPB: 7 states, 2 commands, 2 numbers in p, 1 materials",
        replace(
            swing, name=""
        ): "Checkpoint of DPMPB: 2 states, 1 commands, 1 numbers in p, 2 materials",
    }
    for value, line in shown.items():
        assert repr(value) == line
