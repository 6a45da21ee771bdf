"""Calls side by side: in order, and on one core each."""

import pytest
import torch

from studies._parallel import one_thread, side_by_side


def count_threads(word):
    return f"{word}{torch.get_num_threads()}"


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_answers_come_in_the_order_of_the_calls_from_one_core_each(workers):
    calls = [{"word": word} for word in "cab"]
    found = side_by_side(count_threads, calls, "words", workers=workers)
    assert list(found) == ["c1", "a1", "b1"]


def test_threads_are_given_back():
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        with one_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
