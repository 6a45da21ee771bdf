"""Trainings judged on recordings held out: how long each was."""

import pandas as pd
import pytest

import studies
from clothlab import data
from studies import EXPERIMENTS, held_out


def test_stored_rows_are_those_of_the_cases_with_their_updates():
    cases = pd.DataFrame(EXPERIMENTS["held_out"].cases())
    assert studies.load("held_out")[list(cases)].equals(cases)


def test_memory_and_p_are_crossed_with_equal_updates_and_seeds():
    kinds = held_out.KINDS
    for ending, updates in (("", 300), (", longer", 900)):
        crossed = [kinds[name + ending] for name in ("p", "none")]
        crossed += [kinds[f"1 frame{name}{ending}"] for name in ("", ", none")]
        assert {each.updates for each in crossed} == {updates}
        assert {each.seeds for each in crossed} == {5}
        ways = {(each.frames, each.bias_size) for each in crossed}
        assert ways == {(0, 2), (0, 0), (1, 2), (1, 0)}


@pytest.mark.parametrize("kind", ["4 frames", "4 frames, longer"])
def test_a_training_has_the_updates_that_its_row_says(kind, monkeypatch):
    whole = data.load_trials
    monkeypatch.setattr(
        data, "load_trials", lambda name: [trial[:60] for trial in whole(name)[::8]]
    )
    had = []

    def minimise(groups, loss, batches, updates, rate):
        had.append(updates)
        return range(updates)

    monkeypatch.setattr(held_out, "minimise", minimise)
    EXPERIMENTS["held_out"].run([{"kind": kind, "seed": 0, "updates": 10}])
    assert had == [10]
