"""The doctor's look at `data/`: one line of advice for each fault, none for what is no
fault.
"""

import shutil

import pytest

from clothlab import _store
from clothlab.__main__ import check_files, pins_of
from clothlab.data import _writing


@pytest.fixture
def data(tmp_path, square, monkeypatch):
    """A small `data/` that `CLOTHLAB_DATA` names, with recordings that the repository
    leaves out.
    """
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    _writing.save_target(square, "a")
    _writing.save_target(square, "drawn/b")
    (tmp_path / "trials" / "train-more").mkdir(parents=True)
    (tmp_path / "trials" / "train-more" / "00.npz").write_bytes(b"00")
    _store.write_checksums()
    return tmp_path


def test_what_is_left_to_make_data_is_counted_and_is_no_fault(data, capsys):
    shutil.rmtree(data / "trials")
    assert check_files() == []
    assert capsys.readouterr().out.endswith(f"{data}: 2 ok, 1 left to `make data`\n")


def test_each_fault_comes_with_its_cure(data, square, capsys):
    (data / "trials" / "train-more" / "00.npz").write_bytes(b"other")
    (data / "targets" / "a.png").unlink()
    _writing.save_target(square, "c")
    assert check_files() == [
        "data/targets/a.png is missing: restore it with `git checkout data/targets/a.png`",
        "data/targets/c.png is not recorded: record its hash with `python -m clothlab checksums`",
        "data/trials/train-more/00.npz is altered: record it with `make data`",
    ]
    assert capsys.readouterr().out.endswith(
        ": 1 ok, 1 missing, 1 not recorded, 1 altered\n"
    )


def test_a_folder_that_is_not_there_or_empty_is_said(tmp_path, monkeypatch):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    assert check_files() == ["data/ is empty: git checkout data, or make data train"]
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path / "nowhere"))
    assert "no data in" in check_files()[0]


def test_a_pin_of_another_platform_or_python_is_none_of_this_machine():
    lock = "# a lock: x==1\nA_b==1.0\nc==2 ; sys_platform == 'none'\nd==3 ; python_full_version >= '3.11'\n-e .\n"
    assert pins_of(lock) == {"a-b": "1.0", "d": "3"}
