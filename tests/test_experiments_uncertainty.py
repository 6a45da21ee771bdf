"""What the record of uncertainty counts, of runs that are known."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab.experiments import uncertainty
from clothlab.experiments.uncertainty import ALL, EVERY, KINDS, Record, Run, Settings
from clothlab.simulation.cloth import CLOTHS

NAME = "damp0.03-mass0.15"


@pytest.fixture(scope="module")
def biases():
    return uncertainty.trained("torque-0").biases


@pytest.fixture(scope="module")
def record(biases):
    right, other = biases[NAME], biases["damp0.07-mass0.05"]

    def made(steps_wrong, off, wide, unfamiliar, cloth=NAME):
        newton = np.array([other] * steps_wrong + [right] * (4 - steps_wrong))
        return Run(
            cloth=cloth,
            model=0,
            seed=0,
            newton=newton,
            momentum=np.array([other] * 4),
            milliseconds=np.ones(2),
            estimate=right[None] + (off, 0.0),
            bare=np.array([0.01 * np.eye(2)]),
            covariance=np.array([wide * np.eye(2)]),
            surprise=np.zeros(1),
            unfamiliar=np.array([unfamiliar]),
            outside=np.array([True]),
        )

    runs = (made(0, 0.0, 0.01, False), made(2, 0.5, 1.0, True), made(0, 0.0, 1.0, True, "long"))
    return Record(Settings(models=(0,), lengths=(20,)), (), runs)


def test_regions_cover_what_they_hold(record):
    assert record.coverage() == pytest.approx([1.0])
    assert record.coverage(calibrated=False) == pytest.approx([0.5])  # half a unit off, with a deviation of 0.1


def test_a_rule_passes_from_where_it_stays_right(record):
    assert list(record.right("newton")) == [0.5, 0.5, 1, 1]
    assert record.seconds_to("newton") == pytest.approx(3 * EVERY * 0.2)
    assert record.seconds_to("newton", share=0.5) == pytest.approx(EVERY * 0.2)
    assert record.seconds_to("momentum") is None


def test_alarms_are_counted_by_cloth(record):
    assert record.alarms("trained") == {NAME: pytest.approx([0.5])}
    assert record.alarms("trained", or_outside=True) == {NAME: pytest.approx([1.0])}
    assert record.alarms("another size") == {"long": pytest.approx([1.0])}
    with pytest.raises(KeyError, match="unknown kind of cloths 'silk'; choose from trained, between"):
        record.of("silk")


def test_every_cloth_is_of_one_kind_and_lies_where_its_kind_says():
    assert len(ALL) == sum(map(len, KINDS.values()))
    dampings, masses = ({getattr(c, what) for c in CLOTHS.values()} for what in ("damping", "mass"))
    for cloth in KINDS["between"].values():
        assert min(dampings) < cloth.damping < max(dampings)
        assert min(masses) < cloth.mass < max(masses)
        assert cloth.mass not in masses
    for cloth in KINDS["beyond"].values():
        assert not (min(dampings) <= cloth.damping <= max(dampings) and min(masses) <= cloth.mass <= max(masses))


def test_development_and_evaluation_share_no_seed():
    settings = Settings()
    numbers = range(len(ALL))
    assert len(ALL) <= 30
    known = {settings.development_seed + 30 * r + n for r in range(settings.known_repeats) for n in numbers}
    judged = {settings.first_seed + 200 * m + 30 * r + n for m in settings.models for r in range(5) for n in numbers}
    assert not known & judged
    assert len(judged) == 5 * 5 * len(ALL)


def test_a_run_that_is_kept_is_not_made_again(tmp_path, monkeypatch):
    settings = Settings(models=(0,), cloths=(NAME,), known=(NAME, "damp0.07-mass0.05", "damp0.05-mass0.05"), repeats=1)
    settings = replace(settings, known_repeats=2, lengths=(14,))
    first = uncertainty.run(settings, folder=tmp_path)
    monkeypatch.setattr(uncertainty, "run_one", lambda *_: 1 / 0)
    again = uncertainty.run(settings, folder=tmp_path)
    assert np.array_equal(first.runs[0].newton, again.runs[0].newton)
    assert first.runs[0].newton.shape == (2, 2)
    assert first.runs[0].bare.shape == first.runs[0].covariance.shape == (1, 2, 2)
