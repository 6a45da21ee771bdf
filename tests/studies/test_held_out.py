"""Trainings judged on recordings held out: how long each was."""

import pandas as pd
import pytest

import studies
from clothlab import data
from studies import EXPERIMENTS, held_out


def test_stored_rows_are_those_of_the_cases_with_their_updates():
    cases = pd.DataFrame(EXPERIMENTS["held_out"].cases())
    assert studies.load("held_out")[list(cases)].equals(cases)


def test_four_times_as_long_is_four_times_the_updates():
    updates = {
        case["kind"]: case["updates"] for case in EXPERIMENTS["held_out"].cases()
    }
    for kind in ("4 frames", "1 frame"):
        assert updates[f"{kind}, longer"] == 4 * updates[kind] == 1200


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
