"""What lies in `data/`: read whole or refused in one sentence, never half, never silently something else."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from clothlab import artifacts
from clothlab._files import write_bytes
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.control import ControlPolicy
from clothlab.learning.dpmpb import DPMPB
from clothlab.learning.trained import Trained
from clothlab.trials import Trial, load_trial, save_trial

FILES: dict[str, Callable[[Path], object]] = {
    "trials/train/one.npz": lambda data: artifacts.load_trials("train", data=data),
    "targets/drawn/bar.png": lambda data: artifacts.load_target("drawn/bar", data=data),
    "targets/target-1.png": lambda data: artifacts.load_target("target-1", data=data),
    "weights/autoencoder-torque.safetensors": lambda data: artifacts.load_autoencoder("torque", data=data),
    "weights/dpmpb-torque-0.safetensors": lambda data: artifacts.load("torque-0", data=data),
    "results/simulation.json": lambda data: artifacts.load_results("simulation", data=data),
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
def trained() -> Trained:
    biases = {"a": np.array([1.0, 2.0]), "b": np.array([-1.0, 0.5])}
    autoencoder, model = shaken(Autoencoder()), shaken(DPMPB(7, 2))
    return Trained("torque-0", artifacts.get_arm("torque"), autoencoder, model, biases, np.array([0.3, 0.2]), "torque")


@pytest.fixture(scope="module")
def _data(tmp_path_factory, trial, trained) -> Path:
    data = tmp_path_factory.mktemp("data")
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    save_trial(trial, data / "trials" / "train" / "one.npz")
    artifacts.save_target(mask, "target-1", data=data)
    artifacts.save_target(mask.T[:96, :96].repeat(2, axis=1)[:, :128], "drawn/bar", data=data)
    artifacts.save_autoencoder(trained.autoencoder, [0.5, 0.4], "torque", data=data)
    artifacts.save(trained, data=data)
    artifacts.save_results({"iou": 0.8}, "simulation", data=data)
    artifacts.write_checksums(data)
    return data


@pytest.fixture
def data(_data, tmp_path) -> Path:
    """A small `data/` with one file of each kind, to spoil."""
    return Path(shutil.copytree(_data, tmp_path / "data"))


def assert_same_weights(a: torch.nn.Module, b: torch.nn.Module) -> None:
    ours, theirs = a.state_dict(), b.state_dict()
    assert list(ours) == list(theirs)
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def contents(data: Path) -> dict[str, bytes]:
    return {path.relative_to(data).as_posix(): path.read_bytes() for path in data.rglob("*") if path.is_file()}


def test_weights_survive_the_round_trip(data, trained, trial):
    read = artifacts.load("torque-0", data=str(data))
    assert_same_weights(read.model, trained.model)
    assert_same_weights(read.autoencoder, trained.autoencoder)
    assert np.array_equal(encode(read.autoencoder, trial.images), encode(trained.autoencoder, trial.images))
    s, u, p = torch.ones(1, 4, 7), torch.ones(1, 4, 2), torch.ones(2)
    assert torch.equal(read.model(s, u, p)[0], trained.model(s, u, p)[0])
    assert not torch.allclose(read.model(s, u, p)[0], DPMPB(7, 2)(s, u, p)[0])
    assert {name: p.tolist() for name, p in read.biases.items()} == {"a": [1.0, 2.0], "b": [-1.0, 0.5]}
    assert read.losses == pytest.approx([0.3, 0.2])
    assert (read.name, read.arm, read.autoencoder_name) == ("torque-0", trained.arm, "torque")
    for network in (read.model, read.autoencoder):
        assert not network.training
        assert not any(parameter.requires_grad for parameter in network.parameters())


def test_everything_else_survives_too(data, square, trial):
    assert np.array_equal(artifacts.load_target("target-1", data=data), square)
    assert list(artifacts.load_targets(data=data)) == ["target-1"]
    assert artifacts.load_results("simulation", data=data) == {"iou": 0.8}
    (read,) = artifacts.load_trials("train", data=data)
    assert np.array_equal(read.commands, trial.commands)
    _, losses = artifacts.load_autoencoder("torque", data=data)
    assert losses == pytest.approx([0.5, 0.4])


def test_what_belongs_together_makes_runs_and_controllers(trained, trial, square):
    run = trained.sequences(trial)
    assert run.s.shape == (12, trained.layout.size) == (12, 7)
    by_name, by_hand = trained.controller(square, "b"), trained.controller(square, [-1.0, 0.5])
    assert isinstance(by_name, ControlPolicy)
    assert np.array_equal(by_name.p, by_hand.p)
    lazy = replace(trained.arm, upper=(0.5, 0.0))
    assert trained.controller(square, "a", arm=lazy).upper.tolist() == [0.5, 0.0]
    with pytest.raises(KeyError, match=r"unknown material 'felt'; choose from a, b"):
        trained.controller(square, "felt")


def test_all_files_are_as_recorded(data):
    assert artifacts.check_data(data) == dict.fromkeys(sorted(FILES), "ok")


def test_sha256sum_agrees(data):
    lines = (data / "SHA256SUMS").read_text().splitlines()
    assert [line[66:] for line in lines] == sorted(FILES)
    assert all(len(line.split("  ")[0]) == 64 for line in lines)


@pytest.mark.parametrize("name", ["target-9", "", None, "../targets/target-1", "/etc/passwd"])
@pytest.mark.parametrize(
    ("load", "choices"),
    [
        (artifacts.load, "torque-0"),
        (artifacts.load_autoencoder, "torque"),
        (artifacts.load_target, "(target-1|drawn)"),
        (artifacts.load_trials, "train, mine"),
        (artifacts.load_results, "simulation"),
    ],
)
def test_unknown_names_list_the_choices(data, load, choices, name):
    with pytest.raises(KeyError, match=rf"unknown .*; choose from {choices}['\"]"):
        load(name, data=data)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("drawn/felt", "unknown target 'felt'; choose from bar"),
        ("drawn/", "unknown target ''; choose from bar"),
        ("drawn/target-1", "unknown target 'target-1'; choose from bar"),
        ("bar", "unknown target 'bar'; choose from target-1"),
        ("drawn", "unknown target 'drawn'; choose from target-1"),
        ("felt/bar", "unknown set of targets 'felt'; choose from drawn"),
        ("/bar", "unknown set of targets ''; choose from drawn"),
        ("drawn/../bar", r"unknown set of targets 'drawn/..'; choose from drawn"),
    ],
)
def test_an_unknown_target_lists_those_of_its_set(data, name, message):
    with pytest.raises(KeyError, match=f"{message}['\"]"):
        artifacts.load_target(name, data=data)


@pytest.mark.parametrize("name", ["felt", "", "..", "target-1", "drawn/bar", "drawn/", 3])
def test_an_unknown_set_of_targets_lists_the_sets(data, name):
    with pytest.raises(KeyError, match=r"unknown set of targets .*; choose from drawn['\"]"):
        artifacts.load_targets(name, data=data)


def test_sets_of_targets_are_kept_apart(data, square):
    artifacts.save_target(np.roll(square, 9, axis=0), "drawn/target-1", data=data)
    artifacts.save_target(np.roll(square, 5, axis=0), "held-out/torque_damp0.03-mass0.05_0", data=data)
    assert list(artifacts.load_targets(data=data)) == ["target-1"]
    drawn, held_out = (artifacts.load_targets(name, data=data) for name in ("drawn", "held-out"))
    assert list(drawn) == ["drawn/bar", "drawn/target-1"]
    assert list(held_out) == ["held-out/torque_damp0.03-mass0.05_0"]
    for name, mask in (drawn | held_out).items():
        assert np.array_equal(artifacts.load_target(name, data=data), mask)
    assert np.array_equal(drawn["drawn/target-1"], np.roll(square, 9, axis=0))
    assert np.array_equal(artifacts.load_target("target-1", data=data), square)


def test_a_set_that_is_gone_is_missed(data):
    shutil.rmtree(data / "targets" / "drawn")
    with pytest.raises(ValueError, match=r"targets/drawn/bar.png is missing"):
        artifacts.load_targets("drawn", data=data)
    (data / "SHA256SUMS").unlink()
    with pytest.raises(KeyError, match=r"unknown set of targets 'drawn'; choose from \(none\)"):
        artifacts.load_targets("drawn", data=data)


@pytest.mark.parametrize(
    ("name", "arm", "cloth"),
    [
        ("held-out/torque_damp0.03-mass0.05_4", "torque", "damp0.03-mass0.05"),
        ("development/muscle_hard-3_12", "muscle", "hard-3"),
        ("muscle_soft-2_0", "muscle", "soft-2"),
    ],
)
def test_a_recorded_target_says_with_which_arm_and_cloth(name, arm, cloth):
    assert artifacts.recorded_with(name) == (arm, cloth)


@pytest.mark.parametrize("name", ["target-1", "drawn/bar", "", None, "torque_soft-1", "torque_soft-1_x", "torque__0"])
def test_other_targets_say_that_they_do_not(name):
    with pytest.raises(ValueError, match=r"does not say what it was recorded with, as held-out/ARM_CLOTH_0 does"):
        artifacts.recorded_with(name)


@pytest.mark.parametrize("name", ["drawn/octopus_soft-1_0", "drawn/torque_felt_0"])
def test_a_target_recorded_with_something_unknown_lists_the_choices(name):
    with pytest.raises(KeyError, match=r"unknown (arm 'octopus'; choose from torque|cloth 'felt'; choose from damp)"):
        artifacts.recorded_with(name)


def test_where_nothing_was_made_yet_that_is_said(tmp_path):
    with pytest.raises(KeyError, match=r"choose from \(none yet: run `make data train`\)"):
        artifacts.load("torque-0", data=tmp_path)
    assert artifacts.load_trials("mine", data=tmp_path) == []
    assert artifacts.load_targets(data=tmp_path) == {}
    assert artifacts.check_data(tmp_path) == {}


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b/c", "a/", "/b", "", ".x", "x.png", None])
def test_a_name_that_leads_elsewhere_is_refused_and_nothing_is_written(data, trained, square, name):
    before = contents(data.parent)
    for save in (
        lambda: artifacts.save(replace(trained, name=name), data=data),
        lambda: artifacts.save_autoencoder(trained.autoencoder, [0.1], name, data=data),
        lambda: artifacts.save_target(square, name, data=data),
        lambda: artifacts.save_results({}, name, data=data),
    ):
        with pytest.raises(ValueError, match=r"the name of a \w+ has letters, digits, - and _ only"):
            save()
    assert contents(data.parent) == before


def test_only_targets_have_sets(data, trained):
    for save in (
        lambda: artifacts.save(replace(trained, name="a/b"), data=data),
        lambda: artifacts.save_autoencoder(trained.autoencoder, [0.1], "a/b", data=data),
        lambda: artifacts.save_results({}, "a/b", data=data),
    ):
        with pytest.raises(ValueError, match=r"letters, digits, - and _ only"):
            save()


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"something else"])
def test_a_damaged_file_is_refused_with_its_hash_and_without(data, file, recorded, damage):
    (data / file).write_bytes(damage((data / file).read_bytes()))
    assert artifacts.check_data(data)[file] == "altered"
    if not recorded:
        (data / "SHA256SUMS").unlink()
    words = (
        rf"data/{file} is damaged or was altered: restore it with `git checkout"
        if recorded
        else r"damaged|no picture|is not a"
    )
    with pytest.raises(ValueError, match=words):
        FILES[file](data)


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("instead", ["nothing", "folder", "dangling link"])
def test_a_file_that_is_gone_is_noticed(data, file, instead):
    (data / file).unlink()
    if instead == "folder":
        (data / file).mkdir()
    if instead == "dangling link":
        (data / file).symlink_to(data / "nowhere")
    assert artifacts.check_data(data)[file] == "missing"
    with pytest.raises(ValueError, match=rf"data/{file} is missing: restore it with `git checkout data/{file}`"):
        FILES[file](data)
    (data / "SHA256SUMS").unlink()
    if not file.startswith("trials"):  # what nobody recorded cannot be missed
        with pytest.raises(KeyError, match=r"unknown"):
            FILES[file](data)


def test_all_trials_and_all_targets_are_there_or_none(data, trial, square):
    save_trial(trial, data / "trials" / "train" / "two.npz")
    artifacts.save_target(square, "target-2", data=data)
    artifacts.write_checksums(data)
    (data / "trials" / "train" / "one.npz").unlink()
    (data / "targets" / "target-2.png").unlink()
    with pytest.raises(ValueError, match=r"trials/train/one.npz is missing"):
        artifacts.load_trials("train", data=data)
    with pytest.raises(ValueError, match=r"targets/target-2.png is missing"):
        artifacts.load_targets(data=data)


def test_only_the_first_trials_are_read_where_no_more_are_wanted(data, trial):
    save_trial(trial[:3], data / "trials" / "train" / "zwei.npz")
    lengths = [[len(each) for each in artifacts.load_trials("train", first=n, data=data)] for n in (0, 1, 2, 9)]
    assert lengths == [[], [12], [12, 3], [12, 3]]
    with pytest.raises(ValueError, match="first must be at least 0, got -1"):
        artifacts.load_trials("train", first=-1, data=data)


def test_trials_that_are_not_in_the_repository_are_recorded_anew(data, trial):
    path = data / "trials" / "train-more" / "00_one.npz"
    save_trial(trial, path)
    artifacts.write_checksums(data)
    path.unlink()
    with pytest.raises(ValueError, match=r"train-more/00_one.npz is missing: record it with `make data`"):
        artifacts.load_trials("train-more", data=data)


def test_a_file_that_nobody_recorded_is_read_and_reported(data, square):
    artifacts.save_target(np.roll(square, 3, axis=0), "mine", data=data)
    assert list(artifacts.load_targets(data=data)) == ["mine", "target-1"]
    assert artifacts.check_data(data)["targets/mine.png"] == "not recorded"


def test_trials_of_ones_own_are_read_but_not_recorded(data, trial):
    save_trial(trial, data / artifacts.OWN_TRIALS / "b.npz")
    save_trial(trial[:3], data / artifacts.OWN_TRIALS / "a.npz")
    artifacts.write_checksums(data)
    assert [len(each) for each in artifacts.load_trials("mine", data=data)] == [3, 12]
    assert not any("mine" in name for name in artifacts.check_data(data))


@pytest.fixture
def left_out(data, trial) -> Path:
    """A set of recordings that the repository leaves to `make data`."""
    folder = data / "trials" / "train-more"
    save_trial(trial, folder / "00.npz")
    save_trial(trial[:5], folder / "01.npz")
    artifacts.write_checksums(data)
    return folder


def test_git_ignores_what_is_left_to_make_data():
    ignored = (Path(artifacts.__file__).parents[1] / ".gitignore").read_text().splitlines()
    assert f"data/{artifacts.LEFT_OUT.removesuffix('*')}" in ignored


def test_recordings_that_are_left_to_make_data_are_no_fault_where_they_are_not(data, left_out):
    assert set(artifacts.check_data(data).values()) == {"ok"}
    assert [len(trial) for trial in artifacts.load_trials("train-more", data=data)] == [12, 5]
    shutil.rmtree(left_out)
    verdict = artifacts.check_data(data)
    assert {name for name, word in verdict.items() if word != "ok"} == {f"trials/train-more/0{k}.npz" for k in (0, 1)}
    assert verdict["trials/train-more/00.npz"] == artifacts.LEFT_TO_MAKE
    with pytest.raises(ValueError, match=r"data/trials/train-more/00.npz is missing: record it with `make data`$"):
        artifacts.load_trials("train-more", data=data)
    with pytest.raises(KeyError, match=r"choose from train, train-more, mine"):
        artifacts.load_trials("train-less", data=data)


def test_half_of_such_a_set_is_not_loaded(data, left_out):
    (left_out / "01.npz").unlink()
    with pytest.raises(ValueError, match=r"data/trials/train-more/01.npz is missing: record it with `make data`"):
        artifacts.load_trials("train-more", data=data)


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b + b" "])
def test_a_damaged_file_of_such_a_set_is_refused_like_any_other(data, left_out, damage):
    (left_out / "01.npz").write_bytes(damage((left_out / "01.npz").read_bytes()))
    assert artifacts.check_data(data)["trials/train-more/01.npz"] == "altered"
    words = r"01.npz is damaged or was altered: record it with `make data`, or record a change .* clothlab checksums`"
    with pytest.raises(ValueError, match=words):
        artifacts.load_trials("train-more", data=data)


def test_hashes_of_what_is_left_to_make_data_are_kept_and_no_others(data, left_out, trial):
    before = (data / "SHA256SUMS").read_text()
    shutil.rmtree(left_out)
    artifacts.write_checksums(data)
    assert (data / "SHA256SUMS").read_text() == before
    (data / "targets" / "target-1.png").unlink()
    save_trial(trial[:5], left_out / "00.npz")
    artifacts.write_checksums(data)
    changed = set(before.splitlines()) ^ set((data / "SHA256SUMS").read_text().splitlines())
    assert sorted(line[66:] for line in changed) == ["targets/target-1.png", *["trials/train-more/00.npz"] * 2]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda lines: [*lines, ""],
        lambda lines: ["", *lines],
        lambda lines: [line.replace("  ", " *") for line in lines],
        lambda lines: [line[:64].upper() + line[64:] for line in lines],
        lambda lines: [line + "\r" for line in lines],
    ],
)
def test_hashes_count_however_they_are_written(data, spoil):
    lines = (data / "SHA256SUMS").read_text().splitlines()
    (data / "SHA256SUMS").write_text("\n".join(spoil(lines)) + "\n")
    assert set(artifacts.check_data(data).values()) == {"ok"}
    for file, load in FILES.items():
        content = (data / file).read_bytes()
        (data / file).write_bytes(content + b" ")
        with pytest.raises(ValueError, match=r"was altered"):
            load(data)
        (data / file).write_bytes(content)
        load(data)


@pytest.mark.parametrize(
    "spoil", [lambda line: line[:40], lambda line: line[:64], lambda line: "x" * 64 + line[64:], lambda line: "hm"]
)
def test_a_damaged_list_of_hashes_spoils_only_what_it_no_longer_records(data, spoil):
    lines = (data / "SHA256SUMS").read_text().splitlines()
    lines[1] = spoil(lines[1])  # the line of the target
    (data / "SHA256SUMS").write_text("\n".join(lines))
    verdict = artifacts.check_data(data)
    assert verdict["SHA256SUMS"] == "damaged"
    lost = sorted(FILES)[1]
    assert lost.startswith("targets")
    assert [name for name, word in verdict.items() if word == "not recorded"] == [lost]
    for file, load in FILES.items():
        if file != lost:
            load(data)
    with pytest.raises(ValueError, match=r"data/SHA256SUMS is damaged: restore it with `git checkout"):
        FILES[lost](data)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00binary", b"\n\n"])
def test_a_list_of_hashes_may_be_anything_without_harm(data, content):
    (data / "SHA256SUMS").write_bytes(content)
    assert set(artifacts.check_data(data)) >= set(FILES)
    artifacts.write_checksums(data)
    assert set(artifacts.check_data(data).values()) == {"ok"}


def test_a_full_disk_is_an_error_and_loses_nothing(data, trained, square, full_disk):
    before = contents(data)
    for save in (
        lambda: artifacts.save(trained, data=data),
        lambda: artifacts.save_autoencoder(trained.autoencoder, [0.1], "torque", data=data),
        lambda: artifacts.save_target(~square, "target-1", data=data),
        lambda: artifacts.save_results({"iou": 0.9}, "simulation", data=data),
        lambda: artifacts.write_checksums(data),
    ):
        with full_disk(), pytest.raises(OSError, match=r"File too large"):
            save()
    assert contents(data) == before


def rewritten(path: Path, about: dict | None = None, **change: torch.Tensor | None) -> None:
    """Write weights with tensors changed, left out where they are None, and other words about them."""
    with safe_open(path, "pt") as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()} | change  # noqa: SIM118
        told = json.loads(file.metadata()["clothlab"]) | (about or {})
    metadata = {"clothlab": json.dumps({key: value for key, value in told.items() if value is not None})}
    kept = {key: tensor for key, tensor in tensors.items() if tensor is not None}
    save_file(kept, path, metadata if about != {"clothlab": None} else None)


WRONG_TENSORS = [
    {"more": torch.zeros(1)},
    {"losses": None},
    {"losses": torch.zeros(2, 2)},
    {"losses": torch.tensor([torch.nan])},
]
WRONG_WORDS = [{"clothlab": None}, {"format": 2}, {"format": None}, {"kind": "other"}, {"kind": None}]


@pytest.mark.parametrize(
    ("tensors", "about"),
    [
        *((tensors, None) for tensors in WRONG_TENSORS),
        *(({}, about) for about in WRONG_WORDS),
        ({"s_mean": None}, None),
        ({"s_mean": torch.zeros(15)}, None),
        ({"lstm.weight_hh_l1": torch.full((120, 30), torch.nan)}, None),
        ({"p": None}, None),
        ({"p": torch.zeros(3, 2)}, None),
        ({"p": torch.zeros(2)}, None),
        ({"p": torch.zeros(2, 3)}, None),
        ({"p": torch.full((2, 2), torch.inf)}, None),
        ({}, {"arm": "octopus"}),
        ({}, {"arm": "muscle"}),
        ({}, {"arm": None}),
        ({}, {"materials": None}),
        ({}, {"materials": 5}),
        ({}, {"materials": ["a"]}),
        ({}, {"sees_with": None}),
        ({}, {"autoencoder": None}),
    ],
)
def test_weights_that_are_not_a_model_are_refused_by_name(data, tensors, about):
    (data / "SHA256SUMS").unlink()
    rewritten(data / "weights" / "dpmpb-torque-0.safetensors", about, **tensors)
    with pytest.raises(ValueError, match=r"dpmpb-torque-0.safetensors is damaged or holds no dpmpb weights: .+"):
        artifacts.load("torque-0", data=data)


@pytest.mark.parametrize(
    ("tensors", "about"),
    [
        *((tensors, None) for tensors in WRONG_TENSORS),
        *(({}, about) for about in WRONG_WORDS),
        ({"encoder.0.weight": None}, None),
        ({"encoder.0.weight": torch.zeros(8, 1, 5, 5)}, None),
        ({"encoder.1.running_var": torch.full((8,), torch.nan)}, None),
        ({}, {"latent_size": None}),
        ({}, {"latent_size": 0}),
        ({}, {"latent_size": "three"}),
        ({}, {"latent_size": 5}),
    ],
)
def test_weights_that_are_not_an_autoencoder_are_refused_by_name(data, tensors, about):
    (data / "SHA256SUMS").unlink()
    rewritten(data / "weights" / "autoencoder-torque.safetensors", about, **tensors)
    with pytest.raises(
        ValueError, match=r"autoencoder-torque.safetensors is damaged or holds no autoencoder weights: .+"
    ):
        artifacts.load_autoencoder("torque", data=data)


def test_weights_of_another_kind_under_a_name_are_refused(data):
    shutil.copy(data / "weights" / "autoencoder-torque.safetensors", data / "weights" / "dpmpb-torque-9.safetensors")
    with pytest.raises(ValueError, match=r"dpmpb-torque-9.safetensors is damaged or holds no dpmpb weights"):
        artifacts.load("torque-9", data=data)


def test_a_model_with_another_autoencoder_is_refused_and_both_are_named(data, trained):
    artifacts.save_autoencoder(Autoencoder(), [0.5], "torque", data=data)
    artifacts.write_checksums(data)
    with pytest.raises(
        ValueError, match=r"'torque-0' were trained with another autoencoder than the 'torque' that lies"
    ):
        artifacts.load("torque-0", data=data)
    artifacts.save_autoencoder(trained.autoencoder, [0.5], "torque", data=data)
    artifacts.write_checksums(data)
    artifacts.load("torque-0", data=data)


def test_a_model_without_its_autoencoder_lists_what_is_there(data):
    (data / "SHA256SUMS").unlink()
    (data / "weights" / "autoencoder-torque.safetensors").rename(data / "weights" / "autoencoder-other.safetensors")
    with pytest.raises(KeyError, match=r"unknown autoencoder weights 'torque'; choose from other"):
        artifacts.load("torque-0", data=data)


@pytest.mark.parametrize(
    "change",
    [
        lambda trained: {"losses": [np.nan]},
        lambda trained: {"losses": [[0.1]]},
        lambda trained: {"losses": None},
        lambda trained: {"biases": {"a": np.array([np.nan, 0])}},
        lambda trained: {"biases": {"a": np.zeros(3)}},
        lambda trained: {"biases": {"a": np.zeros(2), "b": np.zeros(3)}},
        lambda trained: {"biases": {}},
    ],
)
def test_what_could_not_be_loaded_again_is_not_saved(data, trained, change):
    before = contents(data)
    with pytest.raises(ValueError, match=r"(losses|p) is \["):
        artifacts.save(replace(trained, **change(trained)), data=data)
    assert contents(data) == before


def test_a_training_that_diverged_is_not_saved(data):
    before = contents(data)
    diverged = Autoencoder()
    torch.nn.init.constant_(diverged.decoder[-1].bias, torch.nan)
    with pytest.raises(ValueError, match=r"decoder.18.bias are not finite|numbers of .* are not finite"):
        artifacts.save_autoencoder(diverged, [0.5], "torque", data=data)
    assert contents(data) == before


@pytest.mark.parametrize(
    ("results", "error"),
    [({"x": np.nan}, ValueError), ({"x": float("inf")}, ValueError), ({"x": np.zeros(2)}, TypeError)],
)
def test_results_that_json_cannot_hold_are_refused(data, results, error):
    before = contents(data)
    with pytest.raises(error, match=r"JSON"):
        artifacts.save_results(results, "simulation", data=data)
    assert contents(data) == before


@pytest.mark.parametrize("content", [b"{", b"[]", b"3", b"null", b"{}", b'{"format": 2}', b"\xff"])
def test_a_file_that_holds_no_results_is_refused(data, content):
    write_bytes(data / "results" / "other.json", content)
    with pytest.raises(ValueError, match=r"other.json is damaged or holds no results"):
        artifacts.load_results("other", data=data)


def test_a_target_is_a_mask_of_the_right_size_with_cloth_in_it(data):
    before = contents(data)
    for wrong in (np.zeros((96, 128), bool), np.ones((48, 64)), np.full((96, 128), 0.3), None):
        with pytest.raises(ValueError, match=r"cloth image|no cloth"):
            artifacts.save_target(wrong, "target-1", data=data)
    assert contents(data) == before
    for name, picture in (("small", np.full((48, 64), 255)), ("empty", np.zeros((96, 128)))):
        cv2.imwrite(str(data / "targets" / f"{name}.png"), picture.astype(np.uint8))
        with pytest.raises(
            ValueError,
            match=rf"{name}.png is damaged or holds no target: (a target has 128×96 pixels, this|no cloth in)",
        ):
            artifacts.load_target(name, data=data)


def test_the_folder_is_the_one_that_is_named(data, monkeypatch, tmp_path):
    monkeypatch.setenv("CLOTHLAB_DATA", str(data))
    assert artifacts.data_folder() == data
    assert artifacts.load("torque-0").name == "torque-0"
    assert artifacts.data_folder(tmp_path) == tmp_path, "an argument goes before the environment"
    monkeypatch.setenv("CLOTHLAB_DATA", "")
    assert artifacts.data_folder().name == "data"


@pytest.mark.parametrize("where", ["nowhere", "results/simulation.json"])
def test_a_missing_folder_is_named_with_what_would_help(data, monkeypatch, where, square):
    monkeypatch.setenv("CLOTHLAB_DATA", str(data / where))
    for use in (
        artifacts.load,
        artifacts.load_targets,
        artifacts.check_data,
        artifacts.write_checksums,
        lambda: artifacts.save_target(square, "x"),
        lambda: artifacts.load_trials("train", data=data / where),
    ):
        with pytest.raises(
            FileNotFoundError, match=rf"no data in .*{where}: clone the repository.* or set CLOTHLAB_DATA"
        ):
            use()


def test_a_trial_in_the_folder_is_the_trial_that_was_saved(data, trial):
    read = load_trial(data / "trials" / "train" / "one.npz")
    assert isinstance(read, Trial)
    assert np.array_equal(read.images, trial.images)


def test_recordings_go_where_the_environment_says_and_are_read_from_there(data, trial, tmp_path, monkeypatch):
    home = tmp_path / "home"
    monkeypatch.setenv("CLOTHLAB_DATA", str(data))
    assert artifacts.own_trials() == data / artifacts.OWN_TRIALS
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", "~/recordings")
    assert artifacts.own_trials() == home / "recordings"
    assert artifacts.own_trials(data) == data / artifacts.OWN_TRIALS, "who names a folder gets it"
    assert artifacts.load_trials("mine") == []
    save_trial(trial[:3], home / "recordings" / "first.npz")
    assert [len(each) for each in artifacts.load_trials("mine")] == [3]
    assert artifacts.load_trials("mine", data=data) == []
