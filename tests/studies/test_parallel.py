"""Jobs side by side: in order, on one core each, and not done again unless code,
arguments or inputs change.
"""

import numpy as np
import pytest
import torch

from clothlab import _store
from clothlab.data import _writing
from studies import _parallel
from studies._parallel import Job, one_thread, run_jobs, version


def write_down(folder, word):
    """Say that it was done, and on how many cores."""
    with (folder / "done.txt").open("a") as file:
        file.write(word)
    return f"{word}{torch.get_num_threads()}"


def jobs(folder, *words, inputs=()):
    return [Job(write_down, {"folder": folder, "word": word}, inputs) for word in words]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_answers_come_in_the_order_of_the_jobs_from_one_core_each(tmp_path, workers):
    assert list(run_jobs("words", jobs(tmp_path, "c", "a", "b"), workers=workers)) == [
        "c1",
        "a1",
        "b1",
    ]


def test_what_is_kept_is_not_done_again(tmp_path):
    for words in ("ab", "abc", "c"):
        answers = list(
            run_jobs("words", jobs(tmp_path, *words), keep=tmp_path / "kept")
        )
        assert answers == [f"{word}1" for word in words]
    assert (tmp_path / "done.txt").read_text() == "abc"
    list(run_jobs("other words", jobs(tmp_path, "a"), keep=tmp_path / "kept"))
    assert (tmp_path / "done.txt").read_text() == "abca"


def test_it_is_done_again_when_its_inputs_or_the_code_change(
    tmp_path, square, monkeypatch
):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))

    def done():
        work = jobs(tmp_path, "a", inputs=("targets/x",))
        return list(run_jobs("words", work, keep=tmp_path / "kept"))

    for name, mask in (("x", square), ("y", square), ("x", np.roll(square, 1, axis=0))):
        _writing.save_target(mask, name)
        _store.write_checksums()
        done()
        done()
    assert (
        tmp_path / "done.txt"
    ).read_text() == "aa"  # for the first x and for the other one, not for y
    monkeypatch.setattr(_parallel, "code_version", lambda: "another")
    done()
    assert (tmp_path / "done.txt").read_text() == "aaa"


def test_a_worker_with_other_code_refuses(tmp_path, monkeypatch):
    theirs = version()
    monkeypatch.setattr(_parallel, "code_version", lambda: "another")
    with pytest.raises(
        RuntimeError, match="has other versions of clothlab, or of what it needs"
    ):
        _parallel._call(write_down, "words", {"folder": tmp_path, "word": "a"}, theirs)


def test_threads_are_given_back(monkeypatch):
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        with one_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
