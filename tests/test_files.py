"""An interrupted write loses nothing, and leaves nothing that looks like a file."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from clothlab._files import reading, write_bytes


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "results.json"
    write_bytes(path, b"old")
    return path


def test_what_is_written_can_be_read_in_folders_that_were_not_there(tmp_path):
    path = tmp_path / "a" / "b" / "c.json"
    write_bytes(str(path), b"new")
    assert path.read_bytes() == b"new"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions")
def test_permissions_are_those_of_the_file_before_or_of_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_bytes(tmp_path / "new", b"new")
        (tmp_path / "old").touch(mode=0o600)
        write_bytes(tmp_path / "old", b"new")
    finally:
        os.umask(before)
    modes = [(tmp_path / name).stat().st_mode & 0o777 for name in ("new", "old")]
    assert modes == [0o640, 0o600]


def test_a_file_system_without_permissions_is_written_to(path, monkeypatch):
    def refused(*_):
        raise PermissionError

    monkeypatch.setattr(os, "chmod", refused)
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"


def test_what_a_link_leads_to_is_written(path):
    link = path.with_name("link")
    link.symlink_to(path)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert path.read_bytes() == b"new"


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(path, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_file_and_names_it(path, full_disk):
    with (
        full_disk(),
        pytest.raises(
            OSError,
            match=r"cannot write this file \(File too large\): '.*results.json'",
        ),
    ):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_of_two_writers_one_wins_whole(path):
    contents = [bytes([n]) * 100_000 for n in range(8)]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda content: write_bytes(path, content), contents))
    assert path.read_bytes() in contents
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("where", [".", "results.json/x"])
def test_a_place_where_no_file_can_be_is_refused(path, where):
    with pytest.raises(OSError, match=r"cannot write this file"):
        write_bytes(path.parent / where, b"new")
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_whatever_a_reader_says_of_a_damaged_file_is_one_kind_of_error(path):
    expected = r"results.json is damaged or holds no results: 'format'"
    with pytest.raises(ValueError, match=expected), reading(path, "results"):
        raise KeyError("format")
    with pytest.raises(FileNotFoundError), reading(path, "results"):
        path.with_name("none.json").read_bytes()


def test_of_all_who_write_a_new_file_one_gets_its_name(tmp_path):
    def write(content: bytes) -> bool:
        try:
            write_bytes(tmp_path / "new", content, new=True)
        except FileExistsError:
            return False
        return True

    contents = [bytes([n]) * 1000 for n in range(8)]
    with ThreadPoolExecutor(8) as threads:
        written = list(threads.map(write, contents))
    assert sum(written) == 1
    assert (tmp_path / "new").read_bytes() == contents[written.index(True)]
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
