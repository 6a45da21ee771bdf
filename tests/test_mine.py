"""What a reader makes in one notebook is there in the next one, or the stored one is."""

import linecache
import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from clothlab import load, mine


@pytest.fixture
def kept(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.setenv("CLOTHLAB_MINE", str(tmp_path / "mine"))
    return tmp_path / "mine"


def test_what_is_kept_comes_back(kept, capsys):
    stored = load("torque-0")
    mine.keep_autoencoder(stored.autoencoder)
    mine.keep_checkpoint(stored)
    image = torch.zeros(1, 1, 96, 128)
    image[..., 20:60, 30:80] = 1
    with torch.no_grad():
        drawn = mine.autoencoder()(image)
        assert torch.equal(drawn, stored.autoencoder(image))
    assert not mine.autoencoder().training
    assert mine.checkpoint().name == "torque-0"
    assert np.array_equal(
        [*mine.checkpoint().biases.values()], [*stored.biases.values()]
    )
    assert "your own model (04), from mine/" in capsys.readouterr().out


def test_the_stored_one_takes_its_place_and_says_so(kept, capsys):
    assert mine.checkpoint().name == mine.STORED
    assert mine.autoencoder().latent_size == 3
    assert mine.functions("controller") is None
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("no ") for line in lines)
    assert not any(kept.iterdir())


def half(x):
    return np.divide(x, 2)


def test_functions_come_back_with_their_imports(kept):
    mine.keep_functions("halves", half, imports="import numpy as np")
    assert mine.functions("halves").half(3) == 1.5
    (kept / "halves.py").unlink()
    assert mine.functions("halves") is None


def test_a_class_of_a_notebook_s_cell_comes_back(kept):
    cell = "x = 1\n\n\nclass Twice:\n    def __call__(self, x):\n        return 2 * x\n"
    linecache.cache["<cell>"] = len(cell), None, cell.splitlines(True), "<cell>"
    made = {"__name__": "__main__"}
    exec(compile(cell, "<cell>", "exec"), made)
    mine.keep_functions("twice", half, made["Twice"], imports="import numpy as np")
    found = mine.functions("twice")
    assert found.Twice()(found.half(3)) == 3
    assert "x = 1" not in (kept / "twice.py").read_text()


def test_a_log_keeps_its_order_and_its_last_numbers(kept):
    mine.note("by hand", hoped=0.4, got=0.6)
    mine.note("the paper's", got=1.2)
    mine.note("by hand", got=np.float32(0.5))
    assert mine.log() == {"by hand": {"got": 0.5}, "the paper's": {"got": 1.2}}
    assert [*mine.log()] == ["by hand", "the paper's"]


def test_where_the_folder_is_empty_nothing_is_kept(monkeypatch):
    monkeypatch.setenv("CLOTHLAB_MINE", "")
    mine.note("by hand", got=np.float32(0.5))
    mine.keep_checkpoint(load("torque-0"))
    assert mine.folder() is None
    assert mine.log() == {}
    assert mine.checkpoint().name == mine.STORED


def test_where_nothing_can_be_written_a_line_says_so(monkeypatch, tmp_path, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setenv("CLOTHLAB_MINE", str(tmp_path / "file" / "mine"))
    stored = load("torque-0")
    mine.keep_autoencoder(stored.autoencoder)
    mine.keep_checkpoint(stored)
    mine.keep_functions("halves", half, imports="import numpy as np")
    mine.note("by hand", got=0.5)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert all(line.startswith("not kept, cannot write") for line in lines)
    assert all("Set CLOTHLAB_MINE to a folder" in line for line in lines)
    assert mine.log() == {}


@pytest.mark.slow
def test_letters_beyond_those_of_a_machine_come_back(kept):
    (kept / "angle.py").write_text("def angle():\n    return 'θ'\n", "utf-8")
    code = "from clothlab import mine; print(ascii(mine.functions('angle').angle()))"
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | ascii_only,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines()[-1] == r"'\u03b8'"


def test_the_folder_may_lie_at_home(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("CLOTHLAB_MINE", "~/mine")
    mine.note("target-1", hoped=20.0)
    assert (tmp_path / "mine" / "log.json").is_file()
