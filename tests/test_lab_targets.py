"""Images to aim at: what is taken for one, and how well it is understood."""

import numpy as np
import pytest

from clothlab.lab import targets
from clothlab.method.autoencoder import Autoencoder


def test_yardsticks_have_cloth_in_view(trial, monkeypatch):
    monkeypatch.setattr(targets, "REFERENCE_EVERY", 3)
    without = trial.images.copy()
    without[3] = False
    found = targets.reference_images([trial, type("Blank", (), {"images": without})])
    assert len(found) == 7
    assert np.array_equal(found[1], trial.images[3])
    assert found.any(axis=(1, 2)).all()


def test_nothing_is_further_from_the_truth_than_no_cloth(square):
    assert targets.reconstruction_distance(square, square.astype(float)) == 0
    # Five of thirty columns stick out, by 1 to 5 pixels
    moved = np.roll(square, 5, axis=1) * 0.9
    assert targets.reconstruction_distance(square, moved) == pytest.approx(
        sum(range(6)) / 30
    )
    assert targets.reconstruction_distance(square, square * 0.4) == np.inf


def test_the_usual_misunderstanding_is_of_the_worst_in_a_hundred(square, monkeypatch):
    shifts = range(100)
    monkeypatch.setattr(targets, "encode", lambda _, images: images)
    monkeypatch.setattr(
        targets,
        "decode",
        lambda _, z: [np.roll(square, k // 10, axis=1) for k in shifts],
    )
    usual = targets.usual_reconstruction_distance(
        Autoencoder(), np.repeat(square[None], 100, axis=0)
    )
    assert usual == targets.reconstruction_distance(square, np.roll(square, 9, axis=1))


def test_recorded_targets_are_a_few_from_large_to_small():
    images = np.zeros((20, 96, 128), bool)
    for k, image in enumerate(images):
        image[: 1 + (7 * k) % 20] = True
    sizes = [mask.sum() for mask in targets.recorded_targets(images).values()]
    assert 5 <= len(sizes) <= targets._RECORDED_TARGETS
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == images.sum(axis=(1, 2)).max()
