"""A reader's tries: what is shown of them is computed from what is stored."""

import numpy as np
import pytest

from clothlab.analysis import crossed_interval
from studies import capstone

SCORES = np.arange(12.0).reshape(6, 2) ** 2  # points [task, throw]


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", str(tmp_path))
    return tmp_path


def test_a_try_is_shown_with_students_interval_of_its_points():
    capstone.keep("mine", SCORES, "development", steps=73, note="one thing changed")
    (row,) = capstone.kept_tries(73).itertuples()
    each = SCORES.mean(axis=1)
    assert (row.Index, row.set, row.name) == (1, "development", "mine")
    assert row.note == "one thing changed"
    assert row.each == pytest.approx(each)
    wanted = crossed_interval(each[:, None])
    assert (row.points, row.low, row.high) == pytest.approx(wanted, abs=0.06)


def test_the_same_points_under_the_same_name_are_no_new_try():
    for name in ("mine", "mine", "other"):
        capstone.keep(name, SCORES, "held-out", steps=73)
    capstone.keep("mine", SCORES[:1], "held-out", steps=17)
    assert list(capstone.kept_tries(73).name) == ["mine", "other"]
    assert len(capstone.kept_tries(17)) == 1


def test_rows_of_another_version_are_not_shown_and_tries_are_numbered_from_one(
    own_folder,
):
    old = "set,name,seed,steps,points,low,high,tasks,note\n"
    old += "development,old,0,73,81.3,69.8,91.2,6,\n"
    (own_folder / "tries.csv").write_text(old)
    assert capstone.kept_tries(73).empty
    capstone.keep("mine", SCORES, "development", steps=73)
    assert list(capstone.kept_tries(73).index) == [1]


def test_where_nothing_can_be_written_the_variable_is_named(own_folder, monkeypatch):
    (own_folder / "file").touch()
    monkeypatch.setenv("CLOTHLAB_RECORDINGS", str(own_folder / "file" / "mine"))
    with pytest.raises(OSError, match="set CLOTHLAB_RECORDINGS to a folder of yours"):
        capstone.keep("mine", SCORES, "development", steps=73)
    with pytest.raises(OSError, match="set CLOTHLAB_RECORDINGS to a folder of yours"):
        capstone.save_film([np.zeros((8, 8, 3), np.uint8)])
