"""More recordings of one cloth: what is learned from, that it is kept, and what is compared."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab import artifacts, experiments
from clothlab.experiments import more_of_one, practice
from clothlab.experiments.more_of_one import NONE, Record, Run, Settings, run
from clothlab.learning.dpmpb import train_dpmpb

CLOTH, OTHER = "damp0.03-mass0.15", "damp0.05-mass0.05"
SMALL = Settings(models=(0,), extra=(CLOTH,), repeats=1, recorded_steps=36, cloths=(CLOTH, OTHER), tries=2, steps=12)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """A few recorded steps of every cloth, and one epoch."""
    whole = artifacts.load_trials
    monkeypatch.setattr(
        artifacts, "load_trials", lambda name: [trial[:40] for trial in whole(name.removesuffix(artifacts.MORE))]
    )
    practice._seen.cache_clear()
    yield
    practice._seen.cache_clear()


@pytest.fixture
def learned_from(monkeypatch):
    """Which runs each training had."""
    seen = []

    def train(runs, settings, **how):
        seen.append([each.material for each in runs])
        return train_dpmpb(runs, replace(settings, epochs=1), **how)

    monkeypatch.setattr(more_of_one, "train_dpmpb", train)
    return seen


def test_one_cloth_gets_more_recordings_and_what_is_done_is_kept(tmp_path, monkeypatch, learned_from):
    record = run(SMALL, folder=tmp_path)
    (materials,) = learned_from
    others = {materials.count(name) for name in materials if name != CLOTH}
    assert others == {materials.count(CLOTH) - 2 * SMALL.repeats}
    assert [(each.extra, each.cloth) for each in record.runs] == [
        (extra, cloth) for extra in (NONE, CLOTH) for cloth in (CLOTH, OTHER) for _ in range(2)
    ]
    assert record.runs[0].seed == record.runs[4].seed != record.runs[1].seed
    assert not np.array_equal(record.errors(NONE), record.errors(CLOTH))
    experiments.save("more_of_one", record, data=tmp_path)
    assert np.array_equal(experiments.load("more_of_one", data=tmp_path).errors(CLOTH), record.errors(CLOTH))
    monkeypatch.setattr(more_of_one, "new_trial", lambda *job: pytest.fail("recorded again"))
    assert np.array_equal(run(SMALL, folder=tmp_path).errors(CLOTH), record.errors(CLOTH))
    assert len(learned_from) == 1


def test_errors_of_the_ratio_and_the_rate_are_those_of_the_runs_asked_for():
    runs = tuple(
        Run(extra, 0, cloth, 1, nearest, np.array(error))
        for extra, cloth, nearest, error in [
            (NONE, CLOTH, OTHER, (0.1, -0.1)),
            (NONE, OTHER, OTHER, (0.1, 0.1)),
            (CLOTH, CLOTH, CLOTH, (0.0, 0.0)),
        ]
    )
    record = Record(SMALL, runs)
    assert record.errors(NONE) == pytest.approx([0.2, 0.0])
    assert record.errors(NONE, CLOTH) == pytest.approx([0.2])
    assert (record.right(NONE), record.right(CLOTH, CLOTH)) == (0.5, 1.0)
    with pytest.raises(KeyError, match=r"of which there were more .silk.; choose from none, damp0.03"):
        record.errors("silk")


def test_a_cloth_that_nobody_knows_is_refused_at_once():
    with pytest.raises(KeyError, match="unknown cloth 'silk'"):
        Settings(extra=("silk",))
