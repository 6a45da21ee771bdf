"""Files come over the network where there is no clone: whole and unaltered, or with one
sentence why not.
"""

import gc
from email.message import Message
from pathlib import Path

import numpy as np
import pytest
from shared import serving

from clothlab import __version__, _store, data
from clothlab.data import _writing
from clothlab.trials import load_trial, save_trial


@pytest.fixture(scope="module")
def served(tmp_path_factory, trial, squares):
    """A folder `data/` that is served, its address, and what was asked of it."""
    folder = tmp_path_factory.mktemp("served")
    for name, mask in squares.items():
        _writing.save_target(mask, name, data=folder)
    save_trial(trial, folder / "trials" / "train" / "one.npz")
    save_trial(trial[:5], folder / "trials" / "train" / "two.npz")
    save_trial(trial[:3], folder / "trials" / "train-more" / "00.npz")
    _store.write_checksums(folder)

    with serving(folder) as (address, asked):
        yield folder, address, asked


@pytest.fixture(scope="module")
def squares():
    first = np.zeros((96, 128), bool)
    first[30:50, 40:70] = True
    return {"target-1": first, "drawn/bar": np.roll(first, 9, axis=0)}


@pytest.fixture
def cache(served, monkeypatch, tmp_path):
    """As in an installed wheel: no clone, a list of hashes, and an empty cache."""
    folder, address, asked = served
    asked.clear()
    monkeypatch.delenv("CLOTHLAB_DATA", raising=False)
    monkeypatch.setenv("CLOTHLAB_DATA_URL", address)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(_store, "_CLONE", tmp_path / "no clone")
    monkeypatch.setattr(_store, "_PACKAGED", folder / "SHA256SUMS")
    monkeypatch.setattr(_store, "_cache", lambda: tmp_path / "cache" / "clothlab")
    return tmp_path / "cache" / "clothlab"


def test_a_file_is_fetched_when_it_is_first_asked_for(served, cache, squares):
    _, _, asked = served
    assert _store.data_folder() == cache
    assert np.array_equal(data.load_target("target-1"), squares["target-1"])
    assert np.array_equal(data.load_target("target-1"), squares["target-1"])
    assert asked == ["targets/target-1.png"], "once"


def test_a_set_is_fetched_whole_and_in_order(served, cache):
    _, _, asked = served
    assert [len(trial) for trial in data.load_trials("train")] == [12, 5]
    assert asked == ["trials/train/one.npz", "trials/train/two.npz"]
    assert list(data.load_targets("drawn")) == ["drawn/bar"]


def test_names_are_known_before_anything_is_fetched(served, cache):
    with pytest.raises(KeyError, match=r"choose from target-1"):
        data.load_target("target-9")
    with pytest.raises(KeyError, match=r"choose from train, train-more, mine"):
        data.load_trials("evaluation")
    assert served[2] == []


def test_a_file_altered_on_the_way_is_refused_and_not_kept(served, cache, monkeypatch):
    folder, _, _ = served
    whole = (folder / "targets" / "target-1.png").read_bytes()
    try:
        (folder / "targets" / "target-1.png").write_bytes(whole + b"more")
        with pytest.raises(ValueError, match=r"hash of downloaded file .* not match"):
            data.load_target("target-1")
    finally:
        (folder / "targets" / "target-1.png").write_bytes(whole)
    assert not (cache / "targets" / "target-1.png").exists()
    assert data.load_target("target-1").any()


def test_a_file_altered_in_the_cache_is_fetched_again(served, cache, squares):
    data.load_target("target-1")
    (cache / "targets" / "target-1.png").write_bytes(b"spoilt")
    assert _store.check_data()["targets/target-1.png"] == "altered"
    assert np.array_equal(data.load_target("target-1"), squares["target-1"])


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", ["no server", "no such file"])
def test_what_cannot_be_fetched_is_said_in_one_sentence(
    served, cache, monkeypatch, fault
):
    address = "http://127.0.0.1:9" if fault == "no server" else f"{served[1]}/nowhere"
    monkeypatch.setenv("CLOTHLAB_DATA_URL", address)
    with pytest.raises(ConnectionError) as caught:
        data.load_target("target-1")
    assert str(caught.value).startswith(
        f"cannot fetch targets/target-1.png from {address}/ ("
    )
    assert "set CLOTHLAB_DATA to the folder data/ of a clone" in str(caught.value)
    del caught
    gc.collect()  # pooch leaves the answer of a server that lacks a file open


def test_recordings_beyond_the_papers_amount_have_to_be_made(served, cache):
    with pytest.raises(ValueError, match=r"00.npz is missing: record it with"):
        data.load_trials("train-more")
    assert served[2] == []


def test_ones_own_files_lie_beside_the_fetched_ones(served, cache, trial, squares):
    save_trial(trial[:3], _store.own_trials() / "a.npz")
    _writing.save_target(squares["target-1"], "mine")
    assert [len(each) for each in data.load_trials("mine")] == [3]
    assert list(data.load_targets()) == ["mine", "target-1"]
    with pytest.raises(ValueError, match="fetched files keep their hashes"):
        _store.write_checksums()


def test_the_state_of_the_cache_is_told_and_what_is_not_there_yet_is_no_fault(
    served, cache
):
    assert _store.fetchable("targets/") == [
        "targets/drawn/bar.png",
        "targets/target-1.png",
    ]
    assert len(_store.fetchable()) == 4
    data.load_target("target-1")
    assert _store.check_data() == {
        "targets/drawn/bar.png": "left to fetch",
        "targets/target-1.png": "ok",
        "trials/train-more/00.npz": "left to `make data`",
        "trials/train/one.npz": "left to fetch",
        "trials/train/two.npz": "left to fetch",
    }


def test_with_a_clone_or_a_named_folder_nothing_is_ever_fetched(
    served, cache, monkeypatch, tmp_path
):
    folder, _, asked = served
    monkeypatch.setattr(_store, "_CLONE", tmp_path)  # which holds nothing
    with pytest.raises(KeyError, match=r"unknown target"):
        data.load_target("target-1")
    monkeypatch.setattr(_store, "_CLONE", folder)
    (folder / "SHA256SUMS").rename(folder / "kept")
    try:
        monkeypatch.setattr(_store, "_PACKAGED", folder / "kept")
        assert data.load_target("target-1").any()
        monkeypatch.setattr(_store, "_CLONE", tmp_path / "no clone")
        monkeypatch.setenv("CLOTHLAB_DATA", str(folder))
        assert data.load_target("target-1").any()
        assert len(load_trial(folder / "trials" / "train" / "one.npz")) == 12
    finally:
        (folder / "kept").rename(folder / "SHA256SUMS")
    assert asked == []


def test_the_address_is_that_of_the_repository_unless_another_is_named(monkeypatch):
    about = Message()
    about["Project-URL"] = "Documentation, https://docs.example"
    about["Project-URL"] = "Repository, https://git.example/clothlab"
    monkeypatch.setattr(_store, "metadata", lambda name: about)
    monkeypatch.delenv("CLOTHLAB_DATA_URL", raising=False)
    stored = f"https://git.example/clothlab/raw/v{__version__}/data/"
    assert _store.address() == stored
    monkeypatch.setenv("CLOTHLAB_DATA_URL", "https://mirror.example/files")
    assert _store.address() == "https://mirror.example/files/"


def test_the_cache_is_the_users_and_of_this_version(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    folder = _store._cache()
    assert folder.is_relative_to(Path.home())
    assert folder.name == __version__
