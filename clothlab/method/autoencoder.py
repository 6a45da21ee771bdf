"""Autoencoder: a cloth mask becomes z, three numbers, and z a mask again.

Source: the paper, "Network Structure of DPMPB".
"""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR
from tqdm.auto import trange

from clothlab.method.model import numbers, one_thread, usual_torch

# Of a cloth image [pixel]: the paper's 128×96.
HEIGHT = 96
WIDTH = 128
# Five 3×3 convolutions of stride 2; the paper does not give their widths.
_CHANNELS = (1, 8, 16, 32, 64, 128)
_HIDDEN = 256
_SMALL = (HEIGHT // 32, WIDTH // 32)  # the image after five convolutions [pixel]
_FLAT = _CHANNELS[-1] * _SMALL[0] * _SMALL[1]
_AT_ONCE = 256  # images that are encoded or decoded together


class Autoencoder(nn.Module):
    """128×96 binary image → five convolutions → 256 → z (3) → the mirror image.

    Every layer but the last has batch normalisation and ReLU; the last has a sigmoid. z
    has no ReLU, which would cut each axis in half, and a normalisation without a scale:
    unit variance on each axis, so that distances mean the same for every training. Each
    batch's own mean and variance also shake z, which keeps neighbours in z alike.
    """

    def __init__(self, latent_size: int = 3):
        super().__init__()
        self.latent_size = latent_size
        self.encoder = _encoder(latent_size)
        self.decoder = _decoder(latent_size)

    def __repr__(self) -> str:
        """Return one line, "Autoencoder: images of 128×96 pixels, 3 numbers in z"."""
        pixels = f"images of {WIDTH}×{HEIGHT} pixels"
        return f"{type(self).__name__}: {pixels}, {self.latent_size} numbers in z"

    def forward(self, images: Tensor) -> Tensor:
        """Reconstruct images `[B, 1, H, W]`, 0 or 1: logits of the same shape."""
        return self.decoder(self.encoder(images))


def _encoder(latent_size: int) -> nn.Sequential:
    """An image `[B, 1, H, W]` to z `[B, D_z]`."""
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(_CHANNELS):
        layers += [
            nn.Conv2d(inputs, outputs, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        ]
    layers += [
        nn.Flatten(),
        *_dense(_FLAT, _HIDDEN),
        nn.Linear(_HIDDEN, latent_size, bias=False),
        nn.BatchNorm1d(latent_size, affine=False),
    ]
    return nn.Sequential(*layers)


def _decoder(latent_size: int) -> nn.Sequential:
    """z `[B, D_z]` to the logits of an image `[B, 1, H, W]`."""
    layers: list[nn.Module] = [
        *_dense(latent_size, _HIDDEN),
        *_dense(_HIDDEN, _FLAT),
        nn.Unflatten(1, (_CHANNELS[-1], *_SMALL)),
    ]
    *widening, last = itertools.pairwise(reversed(_CHANNELS))
    for inputs, outputs in widening:
        layers += [
            _enlarge(inputs, outputs, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        ]
    layers.append(_enlarge(*last, bias=True))
    return nn.Sequential(*layers)


def _dense(inputs: int, outputs: int) -> list[nn.Module]:
    """A fully connected layer with batch normalisation and ReLU."""
    return [
        nn.Linear(inputs, outputs, bias=False),
        nn.BatchNorm1d(outputs),
        nn.ReLU(inplace=True),
    ]


def _enlarge(inputs: int, outputs: int, *, bias: bool) -> nn.Module:
    """A convolution backwards, which doubles height and width."""
    return nn.ConvTranspose2d(
        inputs, outputs, 3, stride=2, padding=1, output_padding=1, bias=bias
    )


@dataclass(frozen=True)
class AutoencoderTraining:
    """How it is trained. The paper gives Adam and no more; the rest is our choice."""

    epochs: int = 60
    batch_size: int = 64  # images
    learning_rate: float = 2e-3  # falls to zero along a cosine
    latent_size: int = 3  # D_z


@usual_torch()
def train_autoencoder(
    images: np.ndarray,
    settings: AutoencoderTraining = AutoencoderTraining(),
    *,
    seed: int = 0,
    progress: bool = True,
) -> tuple[Autoencoder, list[float]]:
    """Train on cloth masks, empty ones included: a cloth may show its back.

    Args:
        images: masks, `[B, H, W]`, at least a batch of them.
        settings: of the training.
        seed: of the first weights and of the order of the images.
        progress: show a progress bar.

    Returns:
        The model in evaluation mode, and the mean binary cross entropy of each epoch
        [nat per pixel].

    Raises:
        ValueError: there are too few images, or some are no masks.
    """
    device = "cuda" if torch.cuda.is_available() else "cpu"
    data = torch.as_tensor(_masks(images)).unsqueeze(1).to(device)
    if len(data) < settings.batch_size:
        raise ValueError(
            f"training takes a batch of {settings.batch_size} images or more, got "
            f"{len(data)}"
        )
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        # On a processor convolutions are faster with the channels last.
        last: Any = {"memory_format": torch.channels_last}
        model = Autoencoder(settings.latent_size).to(device).to(**last)
        losses = _descend(model, data, settings, progress)
    return model.cpu().eval(), losses


def _descend(
    model: Autoencoder, data: Tensor, settings: AutoencoderTraining, progress: bool
) -> list[float]:
    """Train on images `[B, 1, H, W]` in place: the mean loss of each epoch."""
    # Full batches only: what is left over waits for another epoch.
    batches = len(data) // settings.batch_size
    whole = batches * settings.batch_size
    optimizer = Adam(model.parameters(), lr=settings.learning_rate, fused=True)
    schedule = CosineAnnealingLR(optimizer, settings.epochs * batches)

    losses = []
    bar = trange(settings.epochs, unit="epoch", disable=not progress)
    for _ in bar:
        total = 0.0
        for index in torch.randperm(len(data))[:whole].split(settings.batch_size):
            batch = data[index].float()
            loss = nn.functional.binary_cross_entropy_with_logits(model(batch), batch)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item()
        losses.append(total / batches)
        bar.set_postfix(loss=f"{losses[-1]:.4f}")
    return losses


@torch.inference_mode()
def encode(model: Autoencoder, images: ArrayLike) -> np.ndarray:
    """Compress one mask `[H, W]`, or several `[B, H, W]`: z `[D_z]` or `[B, D_z]`."""
    images = _masks(images)
    flat = torch.as_tensor(images.reshape(-1, 1, HEIGHT, WIDTH).astype(np.float32))
    with one_thread():
        z = torch.cat([model.encoder(part) for part in flat.split(_AT_ONCE)])
    return z.reshape(*images.shape[:-2], model.latent_size).numpy()


@torch.inference_mode()
def decode(model: Autoencoder, z: ArrayLike) -> np.ndarray:
    """Probability of cloth at each pixel `[..., H, W]`, from z `[..., D_z]`."""
    z = numbers("z", z, (*np.shape(z)[:-1], model.latent_size))
    flat = z.reshape(-1, model.latent_size).split(_AT_ONCE)
    with one_thread():
        logits = torch.cat([model.decoder(part) for part in flat])
    return logits.sigmoid().reshape(*z.shape[:-1], HEIGHT, WIDTH).numpy()


def _masks(images: ArrayLike) -> np.ndarray:
    """Masks `[..., H, W]`, refused if they have another size or shades of grey."""
    images = np.asarray(images)
    if images.shape[-2:] != (HEIGHT, WIDTH):
        raise ValueError(
            f"cloth images are [..., {HEIGHT}, {WIDTH}], got the shape "
            f"{list(images.shape)}"
        )
    if images.dtype != bool and not np.isin(images, (0, 1)).all():
        raise ValueError(
            "a cloth image holds 0 and 1 only: `picture > 127` makes one of a grey "
            "picture, `image > 0.5` of a reconstruction"
        )
    return images
