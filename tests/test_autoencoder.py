"""Laws of the autoencoder: what z is, and that a mask survives the way there and back."""

import numpy as np
import pytest
import torch

from clothlab.learning.autoencoder import Autoencoder, AutoencoderTraining, decode, encode, iou, train_autoencoder

BRIEF = AutoencoderTraining(epochs=2, batch_size=12)


@pytest.fixture(scope="module")
def untrained():
    torch.manual_seed(0)
    return Autoencoder().eval()


@pytest.fixture(scope="module")
def trained(trial):
    return train_autoencoder(np.concatenate([trial.images] * 4), BRIEF, progress=False)


def test_training_lowers_the_loss_and_ends_in_evaluation_mode(trained):
    model, losses = trained
    assert losses[-1] < losses[0]
    assert len(losses) == BRIEF.epochs
    assert not model.training


def test_the_same_seed_trains_the_same_autoencoder_and_another_seed_another(trial, trained):
    images = np.concatenate([trial.images] * 4)
    again, _ = train_autoencoder(images, BRIEF, progress=False)
    other, _ = train_autoencoder(images, BRIEF, seed=1, progress=False)
    assert again.fingerprint() == trained[0].fingerprint() != other.fingerprint()


def test_training_leaves_the_random_numbers_of_others_alone(trial):
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    train_autoencoder(trial.images, AutoencoderTraining(epochs=1, batch_size=12), progress=False)
    assert torch.equal(torch.rand(3), expected)


def test_shapes_on_the_way_to_z_and_back(untrained, trial):
    for images, shape in ((trial.images[0], (3,)), (trial.images[:5], (5, 3)), (trial.images[:0], (0, 3))):
        z = encode(untrained, images)
        assert z.shape == shape
        assert z.dtype == np.float32
        restored = decode(untrained, z)
        assert restored.shape == images.shape
        assert ((restored >= 0) & (restored <= 1)).all()


def test_one_image_has_the_z_that_it_has_among_others(untrained, trial):
    assert encode(untrained, trial.images[3]) == pytest.approx(encode(untrained, trial.images)[3], abs=1e-5)


def test_zero_and_one_of_any_type_have_one_z(untrained, trial):
    image = trial.images[0]
    for kind in (np.uint8, np.float64):
        assert np.array_equal(encode(untrained, image.astype(kind)), encode(untrained, image))


def test_z_has_unit_scale_whatever_the_weights():
    images = torch.rand(64, 1, 96, 128, generator=torch.Generator().manual_seed(0)).round()
    z = Autoencoder().train().encoder(images)
    assert torch.allclose(z.mean(0), torch.zeros(3), atol=1e-5)
    assert torch.allclose(z.std(0, correction=0), torch.ones(3), atol=0.05)


def test_z_may_have_another_size(trial):
    model = Autoencoder(latent_size=5).eval()
    assert decode(model, encode(model, trial.images[:2])).shape == (2, 96, 128)


def test_a_fingerprint_changes_with_any_weight(untrained):
    before = untrained.fingerprint()
    assert len(before) == 16
    last = untrained.decoder[-1].bias
    with torch.no_grad():
        last += 1
        assert untrained.fingerprint() != before
        last -= 1
    assert untrained.fingerprint() == before


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (np.zeros((48, 64), bool), r"cloth images are \[..., 96, 128\], got the shape \[48, 64\]"),
        (np.full((96, 128), 255, np.uint8), "0 and 1 only"),
        (np.full((96, 128), 0.5), "0 and 1 only"),
        (None, "cloth images are"),
    ],
)
def test_what_is_no_mask_has_no_z(untrained, images, message):
    with pytest.raises(ValueError, match=message):
        encode(untrained, images)


@pytest.mark.parametrize(
    "z",
    [np.zeros(4), np.zeros((2, 4)), np.full(3, np.nan), [np.inf] * 3, [1e39] * 3, 0.0, None, "z", np.zeros((1, 1, 3))],
)
def test_what_is_no_z_has_no_image(untrained, z):
    with pytest.raises(ValueError, match=r"z is \[(B, )?3\] and finite, got"):
        decode(untrained, z)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (np.zeros((63, 96, 128), bool), r"one batch of 64 or more, got \[63, 96, 128\]"),
        (np.zeros((96, 128), bool), r"got \[96, 128\]"),
        (np.full((64, 96, 128), 255, np.uint8), "0 and 1 only"),
        (np.full((64, 96, 128), np.nan), "0 and 1 only"),
        ([], "cloth images are"),
    ],
)
def test_training_takes_masks_one_batch_of_them_at_least(images, message):
    with pytest.raises(ValueError, match=message):
        train_autoencoder(images)


def test_iou_of_known_cases(square):
    nothing = np.zeros_like(square)
    assert iou(square, square) == 1
    assert iou(square, ~square) == 0
    assert iou(nothing, nothing) == 1
    assert iou(square, np.roll(square, 15, axis=1)) == pytest.approx(1 / 3)
    assert iou(np.stack([square, nothing]), square).tolist() == [1, 0]
