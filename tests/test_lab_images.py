"""What the page's graphs make of images is what OpenCV makes of them."""

import numpy as np
import pytest
import torch

from clothlab._validation import HEIGHT, WIDTH
from clothlab.simulation import vision
from course.lab_images import SAMPLES, Images, chamfer_distance

SIZE = (HEIGHT, WIDTH)


def chamfer_cases():
    """Pairs of masks: scattered, wide shapes, and nearly the whole canvas."""
    rng = np.random.default_rng(0)
    for share in (0.001, 0.1, 0.7):
        yield rng.random((2, *SIZE)) < share
    wide, full = np.zeros((2, *SIZE), bool)
    wide[20:90, 10:120] = True
    full[1:, 2:] = True
    yield wide, np.roll(wide, 20, axis=0)
    yield full, wide


@pytest.mark.parametrize(("a", "b"), [*chamfer_cases()])
def test_chamfer_distances(a, b):
    found = chamfer_distance(*(torch.tensor(mask).float() for mask in (a, b)))
    assert found.item() == pytest.approx(vision.chamfer_distance(a, b), rel=1e-5)


class NoNetwork:
    """Makes z of an image, and nothing of that."""

    def encoder(self, images):
        return images.mean((2, 3))

    def decoder(self, z):
        return z[..., None, None].expand(-1, -1, *SIZE)


def test_a_mask_of_samples():
    rng = np.random.default_rng(0)
    spots = np.kron(rng.integers(0, 80, (HEIGHT // 4, WIDTH // 4)), np.ones((4, 4)))
    green = spots + rng.integers(0, 10, SIZE)
    blue = spots + rng.integers(0, 10, SIZE)
    picture = 200 - np.stack([np.zeros(SIZE), green, blue], axis=-1)
    expected = vision.cloth_mask(picture.astype(np.uint8))
    assert 0.1 < expected.mean() < 0.9

    # Samples whose means these are
    noise = rng.normal(size=(*SIZE, len(SAMPLES)))
    noise -= noise.mean(-1, keepdims=True)
    given = (torch.tensor(each[..., None] + noise) for each in (green, blue))
    mask, z, _ = Images(NoNetwork()).see(*given)
    assert (mask.numpy() == expected).mean() > 0.999  # where a mean is at the bound
    assert z.item() == pytest.approx(expected.mean(), abs=1e-3)
