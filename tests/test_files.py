"""What is written can be read, what is damaged is refused, and an interrupted write loses nothing."""

import json

import numpy as np
import pytest
import torch

from clothlab import artifacts
from clothlab._files import atomic_write
from clothlab.autoencoder import Autoencoder
from clothlab.dpmpb import DPMPB
from clothlab.trials import load_trial, save_trial


@pytest.fixture
def data(tmp_path, trial, square):
    """A small `data/` folder with one file of each kind."""
    save_trial(trial, tmp_path / "trials" / "train" / "one.npz")
    artifacts.save_target(square, "target-1", data=tmp_path)
    artifacts.save_autoencoder(Autoencoder(), [0.5, 0.4], "torque", data=tmp_path)
    artifacts.save_dpmpb(DPMPB(7, 2), {"a": np.array([1.0, 2.0])}, [0.3], "torque-0", data=tmp_path)
    artifacts.save_results({"iou": 0.8}, "simulation", data=tmp_path)
    artifacts.write_checksums(tmp_path)
    return tmp_path


def test_a_trial_survives_the_round_trip(trial, tmp_path):
    save_trial(trial, tmp_path / "trial.npz")
    read = load_trial(tmp_path / "trial.npz")
    for name in ("images", "robot", "commands"):
        assert np.array_equal(getattr(trial, name), getattr(read, name))
    assert (read.cloth, read.arm, read.policy, read.seed) == (trial.cloth, trial.arm, trial.policy, trial.seed)


def test_everything_else_survives_too(data, square):
    assert np.array_equal(artifacts.load_target("target-1", data=data), square)
    assert artifacts.load_results("simulation", data=data) == {"iou": 0.8}
    assert len(artifacts.load_trials("train", data=data)) == 1
    _, losses = artifacts.load_autoencoder("torque", data=data)
    assert losses == pytest.approx([0.5, 0.4])
    model, biases, losses = artifacts.load_dpmpb("torque-0", data=data)
    assert biases["a"] == pytest.approx([1.0, 2.0])
    torch.manual_seed(0)
    assert not model.training


def test_all_files_are_as_recorded(data):
    assert set(artifacts.check_data(data).values()) == {"ok"}


@pytest.mark.parametrize(
    "load",
    [
        lambda data: artifacts.load_target("target-9", data=data),
        lambda data: artifacts.load_autoencoder("target-9", data=data),
        lambda data: artifacts.load_dpmpb("target-9", data=data),
        lambda data: artifacts.load_trials("target-9", data=data),
        lambda data: artifacts.load_results("target-9", data=data),
    ],
)
def test_unknown_names_list_the_choices(data, load):
    with pytest.raises(
        KeyError, match=r"unknown .*'target-9'; choose from (target-1|torque|torque-0|train|simulation)"
    ):
        load(data)


@pytest.mark.parametrize(
    ("file", "load"),
    [
        ("trials/train/one.npz", lambda data: artifacts.load_trials("train", data=data)),
        ("targets/target-1.png", lambda data: artifacts.load_target("target-1", data=data)),
        ("weights/autoencoder-torque.safetensors", lambda data: artifacts.load_autoencoder("torque", data=data)),
        ("weights/dpmpb-torque-0.safetensors", lambda data: artifacts.load_dpmpb("torque-0", data=data)),
        ("results/simulation.json", lambda data: artifacts.load_results("simulation", data=data)),
    ],
)
def test_altered_and_truncated_files_are_refused(data, file, load):
    content = (data / file).read_bytes()
    (data / file).write_bytes(content[: len(content) // 2])
    assert artifacts.check_data(data)[file] == "altered"
    with pytest.raises(ValueError, match=f"data/{file} is damaged or was altered: restore it"):
        load(data)
    (data / "SHA256SUMS").unlink()  # with no hash to compare with, the content itself must still be refused
    with pytest.raises(ValueError):  # noqa: PT011 (each reader has its own words)
        load(data)


def test_missing_and_unrecorded_files_are_reported(data):
    (data / "targets" / "target-1.png").rename(data / "targets" / "mine.png")
    verdict = artifacts.check_data(data)
    assert verdict["targets/target-1.png"] == "missing"
    assert verdict["targets/mine.png"] == "not recorded"


def test_a_target_of_another_size_is_refused(data):
    import cv2

    cv2.imwrite(str(data / "targets" / "small.png"), np.full((48, 64), 255, np.uint8))
    with pytest.raises(ValueError, match=r"shape \(96, 128\), got \(48, 64\)"):
        artifacts.load_target("small", data=data)
    with pytest.raises(ValueError, match="no cloth"):
        artifacts.save_target(np.zeros((96, 128), bool), "empty", data=data)
    assert not (data / "targets" / "empty.png").exists()


def test_an_interrupted_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "results.json"
    path.write_text("old")

    def interrupted():
        with atomic_write(path) as temporary:
            temporary.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_trial_leaves_the_old_one(tmp_path, trial, monkeypatch):
    path = tmp_path / "trial.npz"
    save_trial(trial, path)
    before = path.read_bytes()

    def die(file, **_):
        file.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez_compressed", die)
    with pytest.raises(OSError, match="disk full"):
        save_trial(trial, path)
    assert path.read_bytes() == before


def test_trials_hold_no_pickles(data):
    with np.load(data / "trials" / "train" / "one.npz", allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["arm"] == "torque"
        assert file["images"].dtype == np.uint8


def test_arrays_that_do_not_belong_together_are_refused(trial):
    from dataclasses import replace

    with pytest.raises(ValueError, match="one row for each of the 12 images"):
        replace(trial, commands=trial.commands[:5])
    with pytest.raises(ValueError, match="finite"):
        replace(trial, robot=trial.robot * np.nan)
    with pytest.raises(ValueError, match="images are"):
        replace(trial, images=trial.images[:, :48])
