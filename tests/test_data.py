"""What lies in `data/`: read whole or refused in one sentence, never half, never
silently something else.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import clothlab
from clothlab import _store, data as stored
from clothlab.data import _writing
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.cloth_task import ControlPolicy
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import get_arm
from clothlab.trials import load_trial, save_trial
from clothlab.weights import ClothCheckpoint, fingerprint

FILES: dict[str, Callable[[Path], object]] = {
    "trials/train/one.npz": lambda data: stored.load_trials("train", data=data),
    "targets/drawn/bar.png": lambda data: stored.load_target("drawn/bar", data=data),
    "targets/target-1.png": lambda data: stored.load_target("target-1", data=data),
    "weights/autoencoder-torque.safetensors": lambda data: stored.load_autoencoder(
        "torque", data=data
    ),
    "weights/model-torque-0.safetensors": lambda data: stored.load(
        "torque-0", data=data
    ),
    "results/simulation.csv": lambda data: _store.load_results(
        "simulation", ".csv", data=data
    ),
}


def shaken(module: torch.nn.Module) -> torch.nn.Module:
    """Random numbers in all that is saved, buffers too, so that a forgotten one shows."""
    torch.manual_seed(1)
    with torch.no_grad():
        for tensor in module.state_dict().values():
            if tensor.is_floating_point():
                tensor += torch.rand(tensor.shape)
    return module.eval()


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
    _writing.save_target(mask, "target-1", data=data)
    _writing.save_target(np.roll(mask, 9, axis=0), "drawn/bar", data=data)
    _writing.save_autoencoder(trained.autoencoder, [0.5, 0.4], "torque", data=data)
    _writing.save(trained, data=data)
    _store.save_results(b"iou\n0.8", "simulation", ".csv", data=data)
    _store.write_checksums(data)
    return data


@pytest.fixture
def data(_data, tmp_path) -> Path:
    """A small `data/` with one file of each kind, to spoil."""
    return Path(shutil.copytree(_data, tmp_path / "data"))


def contents(data: Path) -> dict[str, bytes]:
    return {
        path.relative_to(data).as_posix(): path.read_bytes()
        for path in data.rglob("*")
        if path.is_file()
    }


def test_weights_survive_the_round_trip(data, trained, trial):
    read = stored.load("torque-0", data=str(data))
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
    assert np.array_equal(stored.load_target("target-1", data=data), square)
    assert list(stored.load_targets(data=data)) == ["target-1"]
    assert _store.load_results("simulation", ".csv", data=data) == b"iou\n0.8"
    (read,) = stored.load_trials("train", data=data)
    assert np.array_equal(read.commands, trial.commands)
    _, losses = stored.load_autoencoder("torque", data=data)
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
    assert _store.check_data(data) == dict.fromkeys(sorted(FILES), "ok")
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
        (partial(_store.load_results, suffix=".csv"), "simulation"),
    ],
)
def test_unknown_names_list_the_choices(data, load, choices):
    with pytest.raises(
        KeyError, match=rf"unknown .*'target-9'; choose from {choices}['\"]"
    ):
        load("target-9", data=data)


def test_sets_of_targets_are_kept_apart(data, square):
    _writing.save_target(np.roll(square, 5, axis=0), "drawn/target-1", data=data)
    assert list(stored.load_targets(data=data)) == ["target-1"]
    drawn = stored.load_targets("drawn", data=data)
    assert list(drawn) == ["drawn/bar", "drawn/target-1"]
    assert np.array_equal(drawn["drawn/target-1"], np.roll(square, 5, axis=0))
    assert np.array_equal(stored.load_target("target-1", data=data), square)


def test_where_nothing_was_made_yet_that_is_said(tmp_path):
    with pytest.raises(
        KeyError, match=r"choose from \(none yet: run `make data train`\)"
    ):
        stored.load("torque-0", data=tmp_path)
    assert stored.load_trials("mine", data=tmp_path) == []
    assert stored.load_targets(data=tmp_path) == {}
    assert _store.check_data(tmp_path) == {}


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", ""])
def test_a_name_that_leads_elsewhere_is_refused_and_nothing_is_written(
    data, trained, square, name
):
    before = contents(data.parent)
    for save in (
        lambda: _writing.save(replace(trained, name=name), data=data),
        lambda: _writing.save_autoencoder(trained.autoencoder, [0.1], name, data=data),
        lambda: _writing.save_target(square, name, data=data),
        lambda: _store.save_results(b"", name, ".csv", data=data),
    ):
        with pytest.raises(
            ValueError, match=r"the name of a \w+ has letters, digits, - and _ only"
        ):
            save()
    assert contents(data.parent) == before


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("recorded", [True, False])
def test_a_damaged_file_is_refused_with_its_hash_and_without(data, file, recorded):
    (data / file).write_bytes(
        (data / file).read_bytes()[: (data / file).stat().st_size // 2]
    )
    assert _store.check_data(data)[file] == "altered"
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
        FILES[file](data)


@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_gone_is_noticed(data, file):
    (data / file).unlink()
    assert _store.check_data(data)[file] == "missing"
    with pytest.raises(
        ValueError,
        match=rf"data/{file} is missing: restore it with `git checkout data/{file}`",
    ):
        FILES[file](data)


def test_a_file_that_nobody_recorded_is_read_and_reported(data, square):
    _writing.save_target(np.roll(square, 3, axis=0), "mine", data=data)
    assert list(stored.load_targets(data=data)) == ["mine", "target-1"]
    assert _store.check_data(data)["targets/mine.png"] == "not recorded"


def test_trials_of_ones_own_are_read_but_not_recorded(data, trial):
    save_trial(trial, data / _store.OWN_TRIALS / "b.npz")
    save_trial(trial[:3], data / _store.OWN_TRIALS / "a.npz")
    _store.write_checksums(data)
    assert [len(each) for each in stored.load_trials("mine", data=data)] == [3, 12]
    assert not any("mine" in name for name in _store.check_data(data))


@pytest.fixture
def left_out(data, trial) -> Path:
    """A set of recordings that the repository leaves to `make data`."""
    folder = data / "trials" / "train-more"
    save_trial(trial, folder / "00.npz")
    save_trial(trial[:5], folder / "01.npz")
    _store.write_checksums(data)
    return folder


def test_git_ignores_what_is_left_to_make_data():
    ignored = (
        (Path(clothlab.__file__).parents[1] / ".gitignore").read_text().splitlines()
    )
    assert f"data/{_store.LEFT_OUT.removesuffix('*')}" in ignored


def test_recordings_that_are_left_to_make_data_are_no_fault_where_they_are_not(
    data, left_out
):
    assert set(_store.check_data(data).values()) == {"ok"}
    assert [len(trial) for trial in stored.load_trials("train-more", data=data)] == [
        12,
        5,
    ]
    (left_out / "01.npz").unlink()
    verdict = _store.check_data(data)
    assert {name: word for name, word in verdict.items() if word != "ok"} == {
        "trials/train-more/01.npz": _store.Verdict.LEFT_TO_MAKE
    }
    with pytest.raises(
        ValueError,
        match=r"data/trials/train-more/01.npz is missing: record it with `make data`$",
    ):
        stored.load_trials("train-more", data=data)


def test_a_full_disk_is_an_error_that_names_the_file_and_loses_nothing(
    data, trained, square, full_disk
):
    before = contents(data)
    for name, save in {
        "model-torque-0.safetensors": lambda: _writing.save(trained, data=data),
        "target-1.png": lambda: _writing.save_target(~square, "target-1", data=data),
        "simulation.csv": lambda: _store.save_results(
            b"iou\n0.9", "simulation", ".csv", data=data
        ),
        "SHA256SUMS": lambda: _store.write_checksums(data),
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
        _writing.save(replace(trained, name=name, arm=arm), data=data)
        assert stored.load(name, data=data).arm == arm
    assert stored.load("torque-0", data=data).arm == trained.arm


def test_what_is_saved_is_loaded_at_once_with_its_autoencoder(trained, tmp_path):
    _writing.save(trained, data=tmp_path)
    read = stored.load(trained.name, data=tmp_path)
    assert fingerprint(read.autoencoder) == fingerprint(trained.autoencoder)


def test_weights_that_are_saved_again_have_their_new_hash(data, trained):
    other = replace(trained, model=shaken(DPMPB(7, 2)))
    other.model.s_mean += 1
    _writing.save(other, data=data)
    read = stored.load("torque-0", data=data)  # whose recorded hash has followed
    assert torch.equal(read.model.s_mean, other.model.s_mean)


def test_a_model_with_another_autoencoder_is_refused_and_both_are_named(data):
    _writing.save_autoencoder(Autoencoder(), [0.5], "torque", data=data)
    with pytest.raises(
        ValueError,
        match=r"'torque-0' were trained with another autoencoder than the 'torque' that lies",
    ):
        stored.load("torque-0", data=data)


def test_a_training_that_diverged_is_not_saved(data, trained):
    before = contents(data)
    diverged = Autoencoder()
    torch.nn.init.constant_(diverged.decoder[-1].bias, torch.nan)
    with pytest.raises(ValueError, match=r"numbers of .* are not finite"):
        _writing.save_autoencoder(diverged, [0.5], "torque", data=data)
    with pytest.raises(ValueError, match=r"numbers of losses are not finite"):
        _writing.save(replace(trained, losses=np.array([0.3, np.nan])), data=data)
    assert contents(data) == before


def test_a_target_is_a_mask_of_the_right_size_with_cloth_in_it(data):
    before = contents(data)
    for wrong in (
        np.zeros((96, 128), bool),
        np.ones((48, 64)),
        np.full((96, 128), 0.3),
    ):
        with pytest.raises(ValueError, match=r"cloth image|no cloth"):
            _writing.save_target(wrong, "target-1", data=data)
    assert contents(data) == before
    cv2.imwrite(str(data / "targets" / "small.png"), np.full((48, 64), 255, np.uint8))
    with pytest.raises(
        ValueError,
        match=r"small.png is damaged or holds no target: a target has 128×96 pixels",
    ):
        stored.load_target("small", data=data)


def test_the_folder_is_the_one_that_is_named(data, monkeypatch, tmp_path):
    monkeypatch.setenv("CLOTHLAB_DATA", str(data))
    assert _store.data_folder() == data
    assert stored.load("torque-0").name == "torque-0"
    assert _store.data_folder(tmp_path) == tmp_path, (
        "an argument goes before the environment"
    )
    monkeypatch.setenv("CLOTHLAB_DATA", "")
    assert _store.data_folder().name == "data"


@pytest.mark.parametrize("where", ["nowhere", "results/simulation.csv"])
def test_a_missing_folder_is_named_with_what_would_help(
    data, monkeypatch, where, square
):
    monkeypatch.setenv("CLOTHLAB_DATA", str(data / where))
    for use in (
        stored.load,
        _store.check_data,
        lambda: _writing.save_target(square, "x"),
    ):
        with pytest.raises(
            FileNotFoundError,
            match=rf"no data in .*{where}.*: clone .* or set CLOTHLAB_DATA",
        ):
            use()


def test_recordings_go_where_the_environment_says_and_are_read_from_there(
    data, trial, tmp_path, monkeypatch
):
    home = tmp_path / "home"
    monkeypatch.setenv("CLOTHLAB_DATA", str(data))
    assert _store.own_trials() == data / _store.OWN_TRIALS
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", "~/recordings")
    assert _store.own_trials() == home / "recordings"
    assert _store.own_trials(data) == data / _store.OWN_TRIALS, (
        "whoever names a folder gets it"
    )
    save_trial(trial[:3], home / "recordings" / "first.npz")
    assert [len(each) for each in stored.load_trials("mine")] == [3]
    assert stored.load_trials("mine", data=data) == []
    assert np.array_equal(
        load_trial(home / "recordings" / "first.npz").images, trial[:3].images
    )
