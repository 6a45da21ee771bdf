"""An interrupted write loses nothing, and leaves nothing that looks like a file."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from clothlab._files import LEFT_OVER, reading, sha256, write_bytes

KILLED_AT_ANY_MOMENT = """
import os, random, signal, sys, time
from pathlib import Path
from clothlab._files import write_bytes

path = Path(sys.argv[1])
random.seed(0)
for _ in range(20):
    child = os.fork()
    if child == 0:
        for n in range(1, 256):
            write_bytes(path, bytes([n]) * 1_000_000)
        os._exit(0)
    time.sleep(random.uniform(0.0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    content = path.read_bytes()
    assert len(content) == 1_000_000 and len(set(content)) == 1, "neither the old file nor a new one"
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "results.json"
    write_bytes(path, b"old")
    return path


def test_what_is_written_can_be_read_in_folders_that_were_not_there(tmp_path):
    path = tmp_path / "a" / "b" / "c.json"
    write_bytes(str(path), b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o644
    assert list(path.parent.iterdir()) == [path]


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(path, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_file_and_nothing_else(path, full_disk):
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_killed_in_the_middle_it_leaves_the_old_file_and_what_no_pattern_finds(path, kill_writes):
    kill_writes(path, 20)
    assert path.read_bytes() == b"old"
    left_over = set(path.parent.iterdir()) - {path}
    assert len(left_over) == 20
    assert {each.suffix for each in left_over} == {LEFT_OVER}
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"


def test_killed_at_any_moment_the_file_is_whole(path):
    write_bytes(path, b"o" * 1_000_000)
    subprocess.run([sys.executable, "-c", KILLED_AT_ANY_MOMENT, str(path)], check=True)


def test_of_two_writers_one_wins_whole(path):
    contents = [bytes([n]) * 100_000 for n in range(8)]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda content: write_bytes(path, content), contents))
    assert path.read_bytes() in contents
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("where", [".", "results.json/x"])
def test_a_place_where_no_file_can_be_is_refused(path, where):
    with pytest.raises(OSError, match=r"directory|exists"):
        write_bytes(path.parent / where, b"new")
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_whatever_a_reader_says_of_a_damaged_file_is_one_kind_of_error(path):
    with (
        pytest.raises(ValueError, match=r"results.json is damaged or holds no results: 'format'"),
        reading(path, "results"),
    ):
        raise KeyError("format")


def test_a_missing_file_is_not_a_damaged_one(path):
    with pytest.raises(FileNotFoundError), reading(path, "results"):
        path.with_name("none.json").read_bytes()


def test_the_hash_is_that_of_sha256sum(path):
    assert sha256(path) == "cba06b5736faf67e54b07b561eae94395e774c517a7d910a54369e1263ccfbd4"  # printf old | sha256sum
