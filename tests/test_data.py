"""What lies in `data/`: read whole or refused in one sentence, never half, never
silently something else.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import torch
from shared import shaken

import clothlab
from clothlab import data as stored
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import get_arm
from clothlab.trials import load_trial, save_trial
from clothlab.weights import ClothCheckpoint, save_autoencoder

FILES: dict[str, Callable[[], object]] = {
    "trials/train/one.npz": lambda: stored.load_trials("train"),
    "targets/drawn/bar.png": lambda: stored.load_target("drawn/bar"),
    "targets/target-1.png": lambda: stored.load_target("target-1"),
    "weights/autoencoder-torque.safetensors": lambda: stored.load_autoencoder("torque"),
    "weights/model-torque-0.safetensors": lambda: stored.load("torque-0"),
    "results/simulation.csv": lambda: stored.load_table("simulation"),
}
TABLE = pd.DataFrame({"iou": [0.8], "p": [np.array([1.0, 2.0])]})


def save_target(mask: np.ndarray, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask.astype(np.uint8) * 255)


def save_weights(trained: ClothCheckpoint, data: Path) -> None:
    trained.save(data / f"weights/model-{trained.name}.safetensors", whole=False)


@pytest.fixture(scope="module")
def trained() -> ClothCheckpoint:
    biases = {"a": np.array([1.0, 2.0]), "b": np.array([-1.0, 0.5])}
    autoencoder, model = shaken(Autoencoder()), shaken(DPMPB(7, 2))
    return ClothCheckpoint(
        name="torque-0",
        arm=get_arm("torque"),
        autoencoder=autoencoder,
        autoencoder_name="torque",
        model=model,
        biases=biases,
        losses=np.array([0.3, 0.2]),
    )


@pytest.fixture(scope="module")
def _data(tmp_path_factory, trial, trained) -> Path:
    data = tmp_path_factory.mktemp("data")
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    save_trial(trial, data / "trials" / "train" / "one.npz")
    save_target(mask, data / "targets" / "target-1.png")
    save_target(np.roll(mask, 9, axis=0), data / "targets" / "drawn" / "bar.png")
    autoencoder = data / "weights" / "autoencoder-torque.safetensors"
    save_autoencoder(trained.autoencoder, [0.5, 0.4], autoencoder)
    save_weights(trained, data)
    stored.save_table(TABLE, "simulation", data=data)
    stored.write_checksums(data)
    return data


@pytest.fixture
def data(_data, tmp_path, monkeypatch) -> Path:
    """A small `data/` with one file of each kind, to spoil; it is in a clone, whose
    repository can't be reached.
    """
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("CLOTHLAB_DATA_URL", "http://127.0.0.1:9")
    (tmp_path / ".git").mkdir()
    return Path(shutil.copytree(_data, tmp_path / "data"))


def contents(data: Path) -> dict[str, bytes]:
    return {
        path.relative_to(data).as_posix(): path.read_bytes()
        for path in data.rglob("*")
        if path.is_file()
    }


def test_weights_survive_the_round_trip(data, trained, trial):
    read = stored.load("torque-0")
    for ours, theirs in (
        (read.model, trained.model),
        (read.autoencoder, trained.autoencoder),
    ):
        ours, theirs = ours.state_dict(), theirs.state_dict()
        assert list(ours) == list(theirs)
        assert all(torch.equal(ours[name], theirs[name]) for name in ours)
    assert np.array_equal(
        encode(read.autoencoder, trial.images),
        encode(trained.autoencoder, trial.images),
    )
    assert {name: p.tolist() for name, p in read.biases.items()} == {
        "a": [1.0, 2.0],
        "b": [-1.0, 0.5],
    }
    assert read.losses == pytest.approx([0.3, 0.2])
    assert (read.name, read.arm, read.autoencoder_name) == (
        "torque-0",
        trained.arm,
        "torque",
    )
    for network in (read.model, read.autoencoder):
        assert not network.training
        assert not any(parameter.requires_grad for parameter in network.parameters())


def test_everything_else_survives_too(data, square, trial):
    assert np.array_equal(stored.load_target("target-1"), square)
    assert list(stored.load_targets()) == ["target-1"]
    table = stored.load_table("simulation")
    assert table["iou"].tolist() == [0.8]
    assert table["p"][0].tolist() == [1.0, 2.0]
    (read,) = stored.load_trials("train")
    assert np.array_equal(read.commands, trial.commands)
    _, losses = stored.load_autoencoder("torque")
    assert losses == pytest.approx([0.5, 0.4])


def test_what_belongs_together_makes_runs_and_controllers(trained, trial, square):
    run = trained.to_run(trial)
    assert run.s.shape == (12, trained.layout.size) == (12, 7)
    by_name, by_hand = (
        trained.controller(square, "b"),
        trained.controller(square, [-1.0, 0.5]),
    )
    assert isinstance(by_name, ControlPolicy)
    assert np.array_equal(by_name.controller.p, by_hand.controller.p)
    lazy = replace(trained.arm, upper=(0.5, 0.0))
    limits = trained.controller(square, "a", arm=lazy).controller.limits
    assert limits.upper.tolist() == [0.5, 0.0]
    with pytest.raises(KeyError, match=r"unknown material 'felt'; choose from a, b"):
        trained.controller(square, "felt")


def test_all_files_are_as_recorded_and_sha256sum_agrees(data):
    assert stored.faults() == []
    lines = (data / "SHA256SUMS").read_text().splitlines()
    assert [line[64:] for line in lines] == [f"  {name}" for name in sorted(FILES)]


@pytest.mark.parametrize(
    ("load", "choices"),
    [
        (stored.load, "torque-0"),
        (stored.load_autoencoder, "torque"),
        (stored.load_target, "target-1"),
        (stored.load_targets, "drawn"),
        (stored.load_trials, "train, mine"),
        (stored.load_table, "simulation"),
    ],
)
def test_unknown_names_list_the_choices(data, load, choices):
    with pytest.raises(
        KeyError, match=rf"unknown .*'target-9'; choose from {choices}['\"]"
    ):
        load("target-9")


def test_sets_of_targets_are_kept_apart(data, square):
    save_target(np.roll(square, 5, axis=0), data / "targets" / "drawn" / "target-1.png")
    assert list(stored.load_targets()) == ["target-1"]
    drawn = stored.load_targets("drawn")
    assert list(drawn) == ["drawn/bar", "drawn/target-1"]
    assert np.array_equal(drawn["drawn/target-1"], np.roll(square, 5, axis=0))
    assert np.array_equal(stored.load_target("target-1"), square)


def test_where_nothing_was_made_yet_that_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    with pytest.raises(
        KeyError, match=r"choose from \(none yet: run `make data train`\)"
    ):
        stored.load("torque-0")
    assert stored.load_trials("mine") == []
    assert stored.load_targets() == {}
    assert stored.faults() == []


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("recorded", [True, False])
def test_a_damaged_file_is_refused_with_its_hash_and_without(data, file, recorded):
    (data / file).write_bytes(
        (data / file).read_bytes()[: (data / file).stat().st_size // 2]
    )
    assert [fault.split(":")[0] for fault in stored.faults()] == [
        f"data/{file} is damaged or was altered"
    ]
    if not recorded:
        (data / "SHA256SUMS").unlink()
        if file.endswith(".csv"):
            return  # any bytes are text
    words = (
        f"data/{file} is damaged or was altered: restore it with `git checkout"
        if recorded
        else "is damaged or"
    )
    with pytest.raises(ValueError, match=words):
        FILES[file]()


@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_gone_is_noticed(data, file):
    (data / file).unlink()
    sentence = f"data/{file} is missing: restore it with `git checkout data/{file}`"
    assert stored.faults() == [sentence]
    with pytest.raises(ValueError, match=sentence):
        FILES[file]()


@pytest.mark.parametrize("file", FILES)
def test_a_download_without_git_is_told_where_its_files_lie(data, file):
    (data.parent / ".git").rmdir()
    (data / file).unlink()
    address = f"http://127.0.0.1:9/{file}"
    assert stored.faults() == [f"data/{file} is missing: download it from {address}"]


def test_an_altered_file_is_refused_and_kept(data):
    target = data / "targets" / "target-1.png"
    save_target(~stored.load_target("target-1"), target)
    before = contents(data)
    advice = (
        "restore it with `git checkout data/targets/target-1.png`, or record a change "
        "that you made by `make checksums`"
    )
    with pytest.raises(ValueError, match=f"target-1.png is damaged or .*: {advice}"):
        stored.load_target("target-1")
    assert contents(data) == before
    stored.write_checksums()
    assert stored.load_target("target-1").any()


def test_a_file_that_nobody_recorded_is_read(data, square):
    save_target(np.roll(square, 3, axis=0), data / "targets" / "mine.png")
    assert list(stored.load_targets()) == ["mine", "target-1"]


def test_copies_that_jupyterlab_keeps_are_no_data(data, square):
    save_target(square, data / "targets" / ".ipynb_checkpoints" / "a-checkpoint.png")
    stored.write_checksums()
    assert "checkpoint" not in (data / "SHA256SUMS").read_text()
    with pytest.raises(KeyError, match=r"choose from drawn['\"]"):
        stored.load_targets(".ipynb_checkpoints")


def test_trials_of_ones_own_are_read_but_not_recorded(data, trial):
    save_trial(trial, data / stored.OWN_TRIALS / "b.npz")
    save_trial(trial[:3], data / stored.OWN_TRIALS / "a.npz")
    (data / stored.OWN_TRIALS / "._b.npz").write_bytes(b"of a Mac")
    stored.write_checksums()
    assert [len(each) for each in stored.load_trials("mine")] == [3, 12]
    assert "mine" not in (data / "SHA256SUMS").read_text()


@pytest.fixture
def left_out(data, trial) -> Path:
    """A set of recordings that the repository leaves to `make data`."""
    folder = data / "trials" / "train-more"
    save_trial(trial, folder / "00.npz")
    save_trial(trial[:5], folder / "01.npz")
    stored.write_checksums(data)
    return folder


def test_git_ignores_what_is_left_to_make_data():
    ignored = (
        (Path(clothlab.__file__).parents[1] / ".gitignore").read_text().splitlines()
    )
    assert f"data/{stored.LEFT_OUT.removesuffix('*')}" in ignored


def test_recordings_that_are_left_to_make_data_are_no_fault_where_they_are_not(
    data, left_out
):
    assert [len(trial) for trial in stored.load_trials("train-more")] == [12, 5]
    (left_out / "01.npz").unlink()
    assert stored.faults() == []
    with pytest.raises(
        ValueError,
        match=r"data/trials/train-more/01.npz is missing: record it with `make data`$",
    ):
        stored.load_trials("train-more")
    stored.write_checksums()
    assert "train-more/01.npz" in (data / "SHA256SUMS").read_text()


def test_a_full_disk_is_an_error_that_names_the_file_and_loses_nothing(
    data, trained, full_disk
):
    before = contents(data)
    for name, save in {
        "model-torque-0.safetensors": lambda: save_weights(trained, data),
        "simulation.csv": lambda: stored.save_table(TABLE, "simulation"),
        "SHA256SUMS": stored.write_checksums,
    }.items():
        with (
            full_disk(),
            pytest.raises(
                OSError, match=rf"cannot write this file \(File too large\).*/{name}"
            ),
        ):
            save()
    assert contents(data) == before


def test_a_changed_arm_is_saved_and_loaded_as_itself(data, trained):
    elsewhere = replace(trained.arm.camera, position=(2.0, -0.5, 1.0))
    for name, arm in {
        "shorter": replace(trained.arm, link_length=0.35),  # which has kept its name
        "own": replace(trained.arm, name="mine", camera=elsewhere),
    }.items():
        save_weights(replace(trained, name=name, arm=arm), data)
        assert stored.load(name).arm == arm
    assert stored.load("torque-0").arm == trained.arm


def test_a_model_with_another_autoencoder_is_refused_and_both_are_named(data):
    path = data / "weights" / "autoencoder-torque.safetensors"
    save_autoencoder(Autoencoder(), [0.5], path)
    stored.write_checksums()
    with pytest.raises(
        ValueError,
        match=r"'torque-0' were trained with another autoencoder than the 'torque' that lies",
    ):
        stored.load("torque-0")


def test_a_training_that_diverged_is_not_saved(data, trained):
    before = contents(data)
    diverged = Autoencoder()
    torch.nn.init.constant_(diverged.decoder[-1].bias, torch.nan)
    with pytest.raises(ValueError, match=r"numbers of .* are not finite"):
        save_autoencoder(diverged, [0.5], data / "weights" / "a.safetensors")
    with pytest.raises(ValueError, match=r"numbers of losses are not finite"):
        save_weights(replace(trained, losses=np.array([0.3, np.nan])), data)
    assert contents(data) == before


def test_a_target_has_the_size_of_an_image(data):
    cv2.imwrite(str(data / "targets" / "small.png"), np.full((48, 64), 255, np.uint8))
    with pytest.raises(
        ValueError,
        match=r"small.png is damaged or holds no target: a target has 128×96 pixels",
    ):
        stored.load_target("small")


def test_the_folder_is_the_one_that_is_named(data, monkeypatch, tmp_path):
    assert stored.data_folder() == data
    assert stored.load("torque-0").name == "torque-0"
    assert stored.data_folder(tmp_path) == tmp_path, (
        "an argument goes before the environment"
    )
    monkeypatch.setenv("CLOTHLAB_DATA", "")
    assert stored.data_folder().name == "data"


@pytest.mark.parametrize("where", ["nowhere", "results/simulation.csv"])
def test_a_missing_folder_is_named_with_what_would_help(data, monkeypatch, where):
    monkeypatch.setenv("CLOTHLAB_DATA", str(data / where))
    for use in (stored.load, stored.faults, stored.write_checksums):
        with pytest.raises(
            FileNotFoundError,
            match=rf"no data in .*{where}.*: clone .* or set CLOTHLAB_DATA",
        ):
            use()


def test_recordings_go_where_the_environment_says_and_are_read_from_there(
    data, trial, tmp_path, monkeypatch
):
    home = tmp_path / "home"
    assert stored.own_trials() == data / stored.OWN_TRIALS
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", "~/recordings")
    assert stored.own_trials() == home / "recordings"
    save_trial(trial[:3], home / "recordings" / "first.npz")
    assert [len(each) for each in stored.load_trials("mine")] == [3]
    assert np.array_equal(
        load_trial(home / "recordings" / "first.npz").images, trial[:3].images
    )
