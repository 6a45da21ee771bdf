"""Files that are missing come over the network: whole and unaltered, or with one sentence
why not.
"""

import gc
import shutil
from email.message import Message

import cv2
import numpy as np
import pytest
from shared import serving

from clothlab import __version__, data
from clothlab.trials import save_trial


@pytest.fixture(scope="module")
def served(tmp_path_factory, trial, squares):
    """A folder `data/` that is served, its address, and what was asked of it."""
    folder = tmp_path_factory.mktemp("served")
    for name, mask in squares.items():
        path = folder / "targets" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), mask.astype(np.uint8) * 255)
    save_trial(trial, folder / "trials" / "train" / "one.npz")
    save_trial(trial[:5], folder / "trials" / "train" / "two.npz")
    save_trial(trial[:3], folder / "trials" / "train-more" / "00.npz")
    data.write_checksums(folder)

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
    monkeypatch.setattr(data, "_PACKAGED", folder / "SHA256SUMS")
    monkeypatch.setattr(data.pooch, "os_cache", lambda name: tmp_path / "cache" / name)
    return tmp_path / "cache" / "clothlab" / __version__


def test_a_file_is_fetched_when_it_is_first_asked_for(served, cache, squares):
    _, _, asked = served
    assert data.data_folder() == cache
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
        with pytest.raises(ValueError, match=r"target-1.png is missing") as caught:
            data.load_target("target-1")
        assert "does not match the known hash" in str(caught.value.__cause__)
    finally:
        (folder / "targets" / "target-1.png").write_bytes(whole)
    assert not (cache / "targets" / "target-1.png").exists()
    assert data.load_target("target-1").any()


def test_a_file_altered_here_is_refused_and_never_overwritten(served, cache):
    data.load_target("target-1")
    (cache / "targets" / "target-1.png").write_bytes(b"spoilt")
    sentence = "target-1.png is damaged or was altered: download it from http://127"
    with pytest.raises(ValueError, match=sentence):
        data.load_target("target-1")
    assert data.faults()[0].startswith("data/targets/target-1.png is damaged")
    assert (cache / "targets" / "target-1.png").read_bytes() == b"spoilt"
    assert served[2] == ["targets/target-1.png"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", ["no server", "no such file"])
def test_what_cannot_be_fetched_is_said_in_one_sentence(
    served, cache, monkeypatch, fault
):
    address = "http://127.0.0.1:9" if fault == "no server" else f"{served[1]}/nowhere"
    monkeypatch.setenv("CLOTHLAB_DATA_URL", address)
    sentence = f"missing: download it from {address}/targets/target-1.png"
    with pytest.raises(ValueError, match=sentence) as caught:
        data.load_target("target-1")
    del caught
    gc.collect()  # pooch leaves the answer of a server that lacks a file open


def test_recordings_beyond_the_papers_amount_have_to_be_made(served, cache):
    with pytest.raises(ValueError, match=r"00.npz is missing: record it with"):
        data.load_trials("train-more")
    assert served[2] == []


def test_ones_own_recordings_lie_beside_the_fetched_files(served, cache, trial):
    save_trial(trial[:3], data.own_trials() / "a.npz")
    assert [len(each) for each in data.load_trials("mine")] == [3]


def test_what_is_not_fetched_yet_is_no_fault(served, cache):
    data.load_target("target-1")
    assert data.faults() == []


def test_a_named_folder_is_mended_where_there_is_an_address(
    served, cache, monkeypatch, tmp_path, squares
):
    folder, _, asked = served
    own = tmp_path / "data"
    shutil.copytree(folder, own)
    monkeypatch.setattr(data, "_PACKAGED", tmp_path / "none")
    monkeypatch.setenv("CLOTHLAB_DATA", str(own))
    assert data.load_target("target-1").any()
    assert asked == []
    (own / "targets" / "target-1.png").unlink()
    assert np.array_equal(data.load_target("target-1"), squares["target-1"])
    assert asked == ["targets/target-1.png"]


def test_without_an_address_a_sentence_says_what_brings_a_file_back(
    served, cache, monkeypatch
):
    monkeypatch.delenv("CLOTHLAB_DATA_URL")
    monkeypatch.setattr(data, "metadata", lambda name: Message())
    with pytest.raises(ValueError, match=r"or set CLOTHLAB_DATA"):
        data.load_target("target-1")
    assert served[2] == []


def test_the_address_is_that_of_the_repository_unless_another_is_named(monkeypatch):
    about = Message()
    about["Project-URL"] = "Documentation, https://docs.example"
    about["Project-URL"] = "Repository, https://git.example/clothlab"
    monkeypatch.setattr(data, "metadata", lambda name: about)
    monkeypatch.delenv("CLOTHLAB_DATA_URL", raising=False)
    stored = f"https://git.example/clothlab/raw/v{__version__}/data/"
    assert data._address() == stored
    monkeypatch.setenv("CLOTHLAB_DATA_URL", "https://mirror.example/files")
    assert data._address() == "https://mirror.example/files/"


def test_a_repository_that_is_not_published_has_no_address(monkeypatch):
    about = Message()
    about["Project-URL"] = "Repository, "
    monkeypatch.setattr(data, "metadata", lambda name: about)
    monkeypatch.delenv("CLOTHLAB_DATA_URL", raising=False)
    assert data._address() == ""
