"""Autoencoder: a cloth mask becomes z, three numbers, and z a mask again (paper,
"Network Structure of DPMPB").
"""

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from clothlab._validation import (
    Checked,
    check_array,
    check_number,
    setting,
    settings_or_default,
)
from clothlab.masks import HEIGHT, WIDTH, check_masks, iou
from clothlab.method.training import best_device, minimise, training

# Five 3×3 convolutions of stride 2; the paper does not give their widths
_CHANNELS = (1, 8, 16, 32, 64, 128)
_HIDDEN = 256


class Autoencoder(nn.Module):
    """128×96 binary image → five convolutions → 256 → z (3) → the mirror image of all
    that.

    Every layer but the last has batch normalisation and ReLU; the last has a sigmoid. z
    has no ReLU, which would cut each axis in half, and a normalisation without a scale:
    unit variance on each axis, so that distances mean the same for every training. Each
    batch's own mean and variance also shake z, which keeps neighbours in z alike.
    """

    def __init__(self, latent_size: int = 3):
        super().__init__()
        self.latent_size = check_number("latent_size", latent_size, int, at_least=1)
        height, width = HEIGHT // 32, WIDTH // 32
        flat = _CHANNELS[-1] * height * width
        encoder: list[nn.Module] = []
        for a, b in itertools.pairwise(_CHANNELS):
            encoder += [
                nn.Conv2d(a, b, 3, stride=2, padding=1, bias=False),
                nn.BatchNorm2d(b),
                nn.ReLU(inplace=True),
            ]
        encoder += [
            nn.Flatten(),
            nn.Linear(flat, _HIDDEN, bias=False),
            nn.BatchNorm1d(_HIDDEN),
            nn.ReLU(inplace=True),
        ]
        encoder += [
            nn.Linear(_HIDDEN, latent_size, bias=False),
            nn.BatchNorm1d(latent_size, affine=False),
        ]
        self.encoder = nn.Sequential(*encoder)

        decoder: list[nn.Module] = []
        for a, b in ((latent_size, _HIDDEN), (_HIDDEN, flat)):
            decoder += [
                nn.Linear(a, b, bias=False),
                nn.BatchNorm1d(b),
                nn.ReLU(inplace=True),
            ]
        decoder += [nn.Unflatten(1, (_CHANNELS[-1], height, width))]
        for a, b in zip(_CHANNELS[:1:-1], _CHANNELS[-2:0:-1], strict=True):
            decoder += [
                nn.ConvTranspose2d(
                    a, b, 3, stride=2, padding=1, output_padding=1, bias=False
                )
            ]
            decoder += [nn.BatchNorm2d(b), nn.ReLU(inplace=True)]
        decoder += [
            nn.ConvTranspose2d(
                _CHANNELS[1], 1, 3, stride=2, padding=1, output_padding=1
            )
        ]
        self.decoder = nn.Sequential(*decoder)

    def forward(self, images: Tensor) -> Tensor:
        """Reconstruct images `[B, 1, H, W]`, 0 or 1: logits of the same shape."""
        return self.decoder(self.encoder(images))

    def fingerprint(self) -> str:
        """Hash of the weights, by which a model knows the autoencoder whose z it was
        trained on.
        """
        digest = hashlib.sha256()
        for name, tensor in self.state_dict().items():
            digest.update(name.encode() + tensor.numpy().tobytes())
        return digest.hexdigest()[:16]


@dataclass(frozen=True)
class AutoencoderTraining(Checked):
    """How the autoencoder is trained.

    The paper gives Adam and no more; the rest is this project's choice.
    """

    epochs: int = setting(60, at_least=1)
    batch_size: int = setting(64, at_least=2)  # images
    # At the start; it falls to zero along a cosine
    learning_rate: float = setting(2e-3, above=0)
    latent_size: int = setting(3, at_least=1)  # D_z


def train_autoencoder(
    images: ArrayLike,
    settings: AutoencoderTraining | None = None,
    *,
    seed: int = 0,
    device: str | None = None,
    progress: bool = True,
) -> tuple[Autoencoder, list[float]]:
    """Train on cloth masks `[B, H, W]`, empty ones included, since a cloth may show its
    back.

    Returns the model in evaluation mode on the CPU, and the mean binary cross entropy
    of each epoch [nat per pixel].
    """
    settings = settings_or_default(settings, AutoencoderTraining)
    images = check_masks(images)
    size, device = settings.batch_size, device or best_device()
    if images.ndim != 3 or len(images) < size:
        raise ValueError(
            f"training takes images [B, H, W], one batch of {size} or more, got {list(images.shape)}"
        )
    with training(seed):
        model = Autoencoder(settings.latent_size).to(device)
        model = model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        data = torch.as_tensor(images).unsqueeze(1).to(device)

        def loss(index: Tensor) -> Tensor:
            batch = data[index.to(device)].float()
            return nn.functional.binary_cross_entropy_with_logits(model(batch), batch)

        def batches() -> Sequence[Tensor]:
            return torch.randperm(len(data))[: len(data) // size * size].split(size)

        bar = "autoencoder" if progress else None
        losses = list(
            minimise(
                model.parameters(),
                loss,
                batches,
                settings.epochs,
                settings.learning_rate,
                bar=bar,
            )
        )
    return model.cpu().eval(), losses


@torch.inference_mode()
def encode(model: Autoencoder, images: ArrayLike) -> np.ndarray:
    """Compress one mask `[H, W]` or several `[B, H, W]` to z, `[D_z]` or `[B, D_z]`,
    float32.
    """
    images = check_masks(images)
    batch = torch.as_tensor(images.reshape(-1, 1, HEIGHT, WIDTH).astype(np.float32))
    z = torch.cat([model.encoder(part) for part in batch.split(256)])
    return z.reshape(*images.shape[:-2], model.latent_size).numpy()


@torch.inference_mode()
def decode(model: Autoencoder, z: ArrayLike) -> np.ndarray:
    """Probability of cloth at each pixel, `[H, W]` or `[B, H, W]`, float32, from z,
    `[D_z]` or `[B, D_z]`.
    """
    shape = (model.latent_size,) if np.ndim(z) == 1 else ("B", model.latent_size)
    z = check_array("z", z, shape, np.float32)
    batch = torch.as_tensor(z.reshape(-1, model.latent_size))
    images = torch.cat(
        [torch.sigmoid(model.decoder(part)) for part in batch.split(256)]
    )
    return images.reshape(*z.shape[:-1], HEIGHT, WIDTH).numpy()


def known_target(model: Autoencoder, mask: ArrayLike, images: ArrayLike) -> np.ndarray:
    """The target mask `[H, W]`; or the most similar of recorded images `[B, H, W]`, if
    the autoencoder cannot draw it.

    Its reconstruction then has an IoU below 0.6 with it, and less than that image: its
    z is that of another shape.
    """
    own = iou(decode(model, encode(model, mask)) > 0.5, mask)
    if own < 0.6 and (overlap := iou(images, mask)).max() > own:
        return np.asarray(images)[overlap.argmax()]
    return check_masks(mask)
