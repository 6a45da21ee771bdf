"""Autoencoder.

A cloth mask becomes z, three numbers, and z becomes a mask again (paper, "Network Structure of DPMPB").
"""

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._validation import Checked, check_array, check_number, dimensions, setting
from clothlab.learning._training import best_device, fit, training
from clothlab.simulation.vision import HEIGHT, WIDTH, check_masks

CHANNELS = (1, 8, 16, 32, 64, 128)  # five 3×3 convolutions of stride 2; the paper does not give their widths
HIDDEN = 256
LARGEST_LATENT = 12_288  # as many as pixels


class Autoencoder(nn.Module):
    """128×96 binary image → five convolutions → 256 → z (3) → the mirror image of all that.

    Every layer but the last has batch normalisation and ReLU; the last has a sigmoid. On z the ReLU is left out, since
    it would cut each axis in half, and the batch normalisation has no scale of its own: z keeps unit variance on each
    axis, so that distances mean the same for every training. That each batch has its own mean and variance also shakes
    z a little, which keeps neighbours in z neighbours in the image.

    Args:
        latent_size: D_z.
    """

    def __init__(self, latent_size: int = 3):
        super().__init__()
        self.latent_size = latent_size = check_number(
            "latent_size", latent_size, int, at_least=1, at_most=LARGEST_LATENT
        )
        height, width = HEIGHT // 32, WIDTH // 32
        flat = CHANNELS[-1] * height * width
        encoder: list[nn.Module] = []
        for a, b in itertools.pairwise(CHANNELS):
            encoder += [nn.Conv2d(a, b, 3, stride=2, padding=1, bias=False), nn.BatchNorm2d(b), nn.ReLU(inplace=True)]
        encoder += [nn.Flatten(), nn.Linear(flat, HIDDEN, bias=False), nn.BatchNorm1d(HIDDEN), nn.ReLU(inplace=True)]
        encoder += [nn.Linear(HIDDEN, latent_size, bias=False), nn.BatchNorm1d(latent_size, affine=False)]
        self.encoder = nn.Sequential(*encoder)

        decoder: list[nn.Module] = []
        for a, b in ((latent_size, HIDDEN), (HIDDEN, flat)):
            decoder += [nn.Linear(a, b, bias=False), nn.BatchNorm1d(b), nn.ReLU(inplace=True)]
        decoder += [nn.Unflatten(1, (CHANNELS[-1], height, width))]
        for a, b in zip(CHANNELS[:1:-1], CHANNELS[-2:0:-1], strict=True):
            decoder += [nn.ConvTranspose2d(a, b, 3, stride=2, padding=1, output_padding=1, bias=False)]
            decoder += [nn.BatchNorm2d(b), nn.ReLU(inplace=True)]
        decoder += [nn.ConvTranspose2d(CHANNELS[1], 1, 3, stride=2, padding=1, output_padding=1)]
        self.decoder = nn.Sequential(*decoder)

    def forward(self, images: Tensor) -> Tensor:
        """Reconstruct images `[B, 1, H, W]`, 0 or 1: logits of the same shape."""
        return self.decoder(self.encoder(images))

    def fingerprint(self) -> str:
        """Hash of the weights, by which a model knows the autoencoder whose z it was trained on."""
        digest = hashlib.sha256()
        for name, tensor in self.state_dict().items():
            digest.update(name.encode() + tensor.numpy().tobytes())
        return digest.hexdigest()[:16]


@dataclass(frozen=True)
class AutoencoderTraining(Checked):
    """How the autoencoder is trained. The paper gives Adam and no more; the rest is this project's choice."""

    epochs: int = setting(60, at_least=1)
    batch_size: int = setting(64, at_least=2)  # images
    learning_rate: float = setting(2e-3, above=0)  # at the start; it falls to zero along a cosine


def train_autoencoder(
    images: ArrayLike,
    settings: AutoencoderTraining | None = None,
    *,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[Autoencoder, list[float]]:
    """Train on cloth masks.

    Args:
        images: masks `[B, H, W]`, bool; empty ones are welcome, since a cloth may show its back.
        settings: epochs, batch size, learning rate.
        seed: of weights and batches.
        device: where to train; by default a GPU where torch sees one.
        progress: show a progress bar.

    Returns:
        The model in evaluation mode on the CPU, and the mean binary cross entropy of each epoch [nat per pixel].

    Raises:
        ValueError: images that are no masks, or fewer than one batch of them.
    """
    settings, images = settings or AutoencoderTraining(), check_masks(images)
    if images.ndim != 3 or len(images) < settings.batch_size:
        raise ValueError(
            f"training takes images [B, H, W], one batch of {settings.batch_size} or more, got {list(images.shape)}"
        )
    with training(seed):
        return _train(images, settings, device or best_device(), progress)


def _train(
    images: np.ndarray, settings: AutoencoderTraining, device: str, progress: bool
) -> tuple[Autoencoder, list[float]]:
    model = Autoencoder().to(device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    data, size = torch.as_tensor(images).unsqueeze(1).to(device), settings.batch_size

    def loss(index: Tensor) -> Tensor:
        batch = data[index.to(device)].float()
        return nn.functional.binary_cross_entropy_with_logits(model(batch), batch)

    def batches() -> Sequence[Tensor]:
        return torch.randperm(len(data))[: len(data) // size * size].split(size)

    options = {"epochs": settings.epochs, "learning_rate": settings.learning_rate}
    losses = list(fit(model.parameters(), loss, batches, **options, bar="autoencoder" if progress else None))
    return model.cpu().eval(), losses


@torch.inference_mode()
def encode(model: Autoencoder, images: ArrayLike) -> np.ndarray:
    """Compress masks.

    Args:
        model: trained autoencoder.
        images: one mask `[H, W]` or several `[B, H, W]`.

    Returns:
        z, `[D_z]` or `[B, D_z]`, float32.

    Raises:
        ValueError: images of another size or kind.
    """
    images = check_masks(images)
    batch = torch.as_tensor(images.reshape(-1, 1, HEIGHT, WIDTH).astype(np.float32))
    z = torch.cat([model.encoder(part) for part in batch.split(256)])
    return z.reshape(*images.shape[:-2], model.latent_size).numpy()


@torch.inference_mode()
def decode(model: Autoencoder, z: ArrayLike) -> np.ndarray:
    """Restore images from z.

    Args:
        model: trained autoencoder.
        z: `[D_z]` or `[B, D_z]`.

    Returns:
        Probability of cloth at each pixel, `[H, W]` or `[B, H, W]`, float32.

    Raises:
        ValueError: z of another size, or not finite.
    """
    shape = (model.latent_size,) if dimensions(z) == 1 else ("B", model.latent_size)
    z = check_array("z", z, shape, np.float32)
    batch = torch.as_tensor(z.reshape(-1, model.latent_size))
    images = torch.cat([torch.sigmoid(model.decoder(part)) for part in batch.split(256)])
    return images.reshape(*z.shape[:-1], HEIGHT, WIDTH).numpy()


def iou(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Intersection over union of masks `[..., H, W]`; 1 where both are empty.

    Returns:
        `[...]`, float64.

    Raises:
        ValueError: images of another size or kind.
    """
    a, b = check_masks(a), check_masks(b)
    union = (a | b).sum(axis=(-2, -1))
    return np.where(union == 0, 1.0, (a & b).sum(axis=(-2, -1)) / np.maximum(union, 1))
