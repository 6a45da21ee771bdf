"""Laws of the autoencoder: what z is, and that a mask survives the way there and back."""

import numpy as np
import pytest
import torch

from clothlab.lab.targets import known_target
from clothlab.method.autoencoder import (
    Autoencoder,
    AutoencoderTraining,
    decode,
    encode,
    train_autoencoder,
)
from clothlab.simulation.vision import iou
from clothlab.weights import fingerprint

BRIEF = AutoencoderTraining(epochs=2, batch_size=12)


@pytest.fixture(scope="module")
def untrained():
    torch.manual_seed(0)
    return Autoencoder().eval()


@pytest.mark.slow
def test_training_lowers_the_loss_and_follows_its_seed(trial):
    images = np.concatenate([trial.images] * 4)
    model, losses = train_autoencoder(images, BRIEF, progress=False)
    again, _ = train_autoencoder(images, BRIEF, progress=False)
    other, _ = train_autoencoder(images, BRIEF, seed=1, progress=False)
    assert len(losses) == BRIEF.epochs
    assert losses[-1] < losses[0]
    assert not model.training
    assert fingerprint(again) == fingerprint(model) != fingerprint(other)


def test_shapes_on_the_way_to_z_and_back(untrained, trial):
    for images, shape in (
        (trial.images[0], (3,)),
        (trial.images[:5], (5, 3)),
        (trial.images[:0], (0, 3)),
    ):
        z = encode(untrained, images)
        assert z.shape == shape
        assert z.dtype == np.float32
        restored = decode(untrained, z)
        assert restored.shape == images.shape
        assert ((restored >= 0) & (restored <= 1)).all()
    model = Autoencoder(latent_size=5).eval()
    assert decode(model, encode(model, trial.images[:2])).shape == (2, 96, 128)


def test_one_image_has_the_z_that_it_has_among_others_and_as_numbers(untrained, trial):
    assert encode(untrained, trial.images[3]) == pytest.approx(
        encode(untrained, trial.images)[3], abs=1e-5
    )
    for kind in (np.uint8, np.float64):
        assert np.array_equal(
            encode(untrained, trial.images[0].astype(kind)),
            encode(untrained, trial.images[0]),
        )


def test_z_has_unit_scale_whatever_the_weights():
    images = torch.rand(
        64, 1, 96, 128, generator=torch.Generator().manual_seed(0)
    ).round()
    z = Autoencoder().train().encoder(images)
    assert torch.allclose(z.mean(0), torch.zeros(3), atol=1e-5)
    assert torch.allclose(z.std(0, correction=0), torch.ones(3), atol=0.05)


def test_what_is_no_mask_has_no_z_and_what_is_no_z_no_image(untrained):
    with pytest.raises(
        ValueError, match=r"cloth images are \[..., 96, 128\], got the shape \[48, 64\]"
    ):
        encode(untrained, np.zeros((48, 64), bool))
    with pytest.raises(ValueError, match="0 and 1 only"):
        encode(untrained, np.full((96, 128), 0.5))
    for z in (np.zeros(4), np.zeros((2, 4)), np.full(3, np.nan)):
        with pytest.raises(ValueError, match=r"z is \[(2, )?3\] and finite, got"):
            decode(untrained, z)
    with pytest.raises(ValueError, match=r"a batch of 64 images or more, got 63"):
        train_autoencoder(np.zeros((63, 96, 128), bool))


def test_iou_of_known_cases(square):
    nothing = np.zeros_like(square)
    assert iou(square, ~square) == 0
    assert iou(square, np.roll(square, 15, axis=1)) == pytest.approx(1 / 3)
    assert iou(np.stack([square, nothing]), np.stack([square, nothing])).tolist() == [
        1,
        1,
    ]


def test_a_target_that_cannot_be_drawn_is_replaced_by_the_recorded_image_most_like_it(
    trial, monkeypatch
):
    images, wanted = trial.images[:5], np.roll(trial.images[3], 1, axis=1)
    for drawn, aim in ((0.0, images[3]), (1.0, wanted)):
        monkeypatch.setattr("clothlab.lab.targets.encode", lambda model, mask: mask)
        monkeypatch.setattr(
            "clothlab.lab.targets.decode", lambda model, z, drawn=drawn: drawn * z
        )
        assert np.array_equal(known_target(None, wanted, images), aim)
