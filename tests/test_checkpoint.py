"""A checkpoint is one file that can lie anywhere, and comes back as what it was."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from clothlab import data
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.checkpoint import Checkpoint
from clothlab.method.data import Run
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.simulation.arm import TorqueArm


def shaken(network: torch.nn.Module) -> torch.nn.Module:
    """Random numbers in all that is saved, so that a forgotten tensor shows."""
    torch.manual_seed(1)
    with torch.no_grad():
        for tensor in network.state_dict().values():
            if tensor.is_floating_point():
                tensor += torch.rand(tensor.shape)
    return network


def equal(a: torch.nn.Module, b: torch.nn.Module) -> bool:
    """Whether two networks have the same layers, with the same numbers."""
    ours, theirs = a.state_dict(), b.state_dict()
    return list(ours) == list(theirs) and all(
        torch.equal(ours[name], theirs[name]) for name in ours
    )


@pytest.fixture
def swing() -> Checkpoint:
    """Of a robot without camera and arm."""
    return Checkpoint(
        name="swing-0",
        model=shaken(DPMPB(2, 1, bias_size=1)),
        biases={"light": np.array([0.1]), "heavy": np.array([1 / 3])},
        losses=np.array([0.5, 0.1]),
        settings=ModelTraining(epochs=2, bias_size=1, learning_rate=1e-3),
        step=0.1,
        state_names=("angle [rad]", "speed [rad/s]"),
        command_names=("torque [N m]",),
        arm={"length": 0.5},
    )


@pytest.fixture
def cloth() -> ClothCheckpoint:
    return ClothCheckpoint(
        name="torque-0",
        arm=replace(TorqueArm(), link_length=0.35),  # which has kept its name
        autoencoder=shaken(Autoencoder()).eval(),
        model=shaken(DPMPB(7, 2)).eval(),
        biases={"a": np.array([1.0, 2.0], np.float32)},
    )


def test_every_field_of_a_checkpoint_comes_back(swing, tmp_path):
    swing.save(tmp_path / "a" / "b" / "swing.safetensors")
    read = Checkpoint.load(str(tmp_path / "a" / "b" / "swing.safetensors"))
    assert equal(read.model, swing.model)
    assert not read.model.training
    assert not any(each.requires_grad for each in read.model.parameters())
    assert {name: p.tolist() for name, p in read.biases.items()} == {
        "light": [0.1],
        "heavy": [1 / 3],
    }
    assert read.losses.tolist() == [0.5, 0.1]
    for field in ("name", "settings", "step", "state_names", "command_names", "arm"):
        assert getattr(read, field) == getattr(swing, field), field
    assert read.autoencoder is None


@pytest.mark.parametrize("name", ["log.csv", "folder"])
def test_a_file_of_another_kind_is_told_by_its_name(tmp_path, name):
    with pytest.raises(ValueError, match=r"a checkpoint's file ends in \.safetensors"):
        Checkpoint.load(tmp_path / name)


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
    assert read.step == 0.2
    assert read.state_names == cloth.layout.names
    assert read.command_names == TorqueArm.command_names


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


def test_without_the_simulation_an_arm_stays_what_the_file_says(cloth, tmp_path):
    path = tmp_path / "cloth.safetensors"
    cloth.save(path)
    read = Checkpoint.load(path)
    assert read.arm["class"] == "TorqueArm"
    assert read.arm["link_length"] == 0.35
    read.save(path)
    assert data.load(path).arm == cloth.arm


def test_stored_weights_are_loaded_by_name_and_saved_anywhere(tmp_path):
    stored = data.load("torque-0")
    stored.save(tmp_path / "mine.safetensors")
    read = data.load(str(tmp_path / "mine.safetensors"))
    assert equal(read.model, stored.model)
    assert read.autoencoder.fingerprint() == stored.autoencoder.fingerprint()
    assert read.arm == stored.arm
    # To the last bit: a closed loop makes much of rounding.
    s, u = torch.randn(1, 9, 7), torch.randn(1, 9, 2)
    p = torch.as_tensor(stored.biases["damp0.05-mass0.10"])
    assert torch.equal(read.model(s, u, p)[0], stored.model(s, u, p)[0])
    assert read.autoencoder_name == stored.autoencoder_name == "torque"
    for material, p in stored.biases.items():
        assert np.array_equal(read.biases[material], p)


def test_a_full_disk_leaves_the_old_checkpoint(swing, tmp_path, full_disk):
    path = tmp_path / "swing.safetensors"
    swing.save(path)
    with full_disk(), pytest.raises(OSError, match=r"cannot write this file.*swing"):
        replace(swing, step=0.2).save(path)
    assert Checkpoint.load(path).step == 0.1
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"losses": np.array([0.1, np.nan])}, "numbers of losses are not finite"),
        ({"arm": {"length": np.inf}}, "what is said of weights is plain data"),
    ],
)
def test_what_could_not_be_read_is_not_written(swing, tmp_path, change, message):
    with pytest.raises(ValueError, match=message):
        replace(swing, **change).save(tmp_path / "swing.safetensors")
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_diverged_is_not_written(swing, tmp_path):
    torch.nn.init.constant_(swing.model.fc_in[0].bias, torch.nan)
    with pytest.raises(ValueError, match=r"numbers of model.fc_in.0.bias are not"):
        swing.save(tmp_path / "swing.safetensors")
    assert list(tmp_path.iterdir()) == []


def test_double_precision_comes_back_and_no_random_number_is_drawn(swing, tmp_path):
    swing.model.double()
    torch.manual_seed(3)
    expected = torch.rand(1)
    torch.manual_seed(3)
    swing.save(tmp_path / "swing.safetensors")
    assert torch.equal(torch.rand(1), expected)
    read = Checkpoint.load(tmp_path / "swing.safetensors")
    assert read.model.s_mean.dtype == torch.float64
    assert equal(read.model, swing.model)


def test_a_file_has_the_ending_by_which_it_is_known(swing, tmp_path):
    with pytest.raises(
        ValueError, match=r"file ends in .safetensors, got '.*swing.pt'"
    ):
        swing.save(tmp_path / "swing.pt")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": None}, "model is a DPMPB"),
        ({"biases": {"light": [1.0, 2.0]}}, r"p of light is \[1\] and finite"),
        (
            {"state_names": ("angle",)},
            "2 states of the model need as many names, or none, got 1: angle",
        ),
    ],
)
def test_what_does_not_belong_together_is_refused(swing, change, message):
    with pytest.raises(ValueError, match=message):
        replace(swing, **change)


def test_an_arm_that_does_not_fit_the_model_is_refused(cloth):
    with pytest.raises(
        ValueError, match="7 states of the model need as many names, or none, got 15"
    ):
        replace(cloth, arm="muscle")
    with pytest.raises(ValueError, match="autoencoder is an Autoencoder, got NoneType"):
        replace(cloth, autoencoder=None)


def rewritten(path, change, **tensors):
    """The file with other words about it, and other numbers in it."""
    with safe_open(path, "pt") as file:
        held = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
        words = json.loads(file.metadata()["clothlab"]) | change
    held = {name: each for name, each in (held | tensors).items() if each is not None}
    save_file(held, path, {"clothlab": json.dumps(words)})


@pytest.mark.parametrize(
    ("change", "tensors", "message"),
    [
        ({}, {"losses": None}, "is damaged or holds no checkpoint: 'losses'"),
        ({}, {"model.s_std": torch.zeros(2)}, "is damaged .* not all above 0"),
        ({"sizes": [3, 1, 1]}, {}, "is no checkpoint .* layers are not those of DPMPB"),
        ({"format": 2}, {}, "is no checkpoint .* its format is 2, .* reads 1"),
        ({"kind": "model"}, {}, "is no checkpoint .* it holds model weights"),
    ],
)
def test_a_file_that_is_none_is_refused_by_name(
    swing, tmp_path, change, tensors, message
):
    path = tmp_path / "swing.safetensors"
    swing.save(path)
    rewritten(path, change, **tensors)
    with pytest.raises(ValueError, match=rf"swing.safetensors {message}"):
        Checkpoint.load(path)


def test_a_damaged_or_missing_file_is_named(swing, tmp_path):
    path = tmp_path / "swing.safetensors"
    swing.save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(ValueError, match=r"swing.safetensors is damaged or holds no"):
        Checkpoint.load(path)
    with pytest.raises(FileNotFoundError, match=r"none.safetensors"):
        Checkpoint.load(tmp_path / "none.safetensors")


def test_a_robot_without_an_arm_is_no_cloth_robot(swing, tmp_path):
    bare = replace(swing, arm=None, autoencoder=Autoencoder())
    bare.save(tmp_path / "bare.safetensors")
    with pytest.raises(ValueError, match=r"it has no arm; `Checkpoint.load` reads it"):
        data.load(tmp_path / "bare.safetensors")


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
