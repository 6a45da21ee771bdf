"""Images to aim at, and how well the network understands them."""

from collections.abc import Sequence

import numpy as np

from clothlab.method.autoencoder import Autoencoder, decode, encode
from clothlab.simulation.vision import chamfer_distance, mask_from_file
from clothlab.trials import Trial

REFERENCE_EVERY = (
    20  # of the recorded images, one in so many is compared with drawn ones
)
# [byte] of an upload; the server would take messages of up to 10 MB
LARGEST_FILE = 1 << 20
_RECORDED_TARGETS = 7  # how many recorded images the gallery has


def reference_images(trials: Sequence[Trial]) -> np.ndarray:
    """Some of the recorded images `[N, H, W]`, with cloth in each."""
    images = np.concatenate([trial.images[::REFERENCE_EVERY] for trial in trials])
    return images[images.any(axis=(1, 2))]


def reconstruction_distance(mask: np.ndarray, reconstruction: np.ndarray) -> float:
    """Chamfer distance [pixel] between a mask and its reconstruction; infinite where no
    cloth is left.
    """
    reconstruction = reconstruction > 0.5
    return chamfer_distance(mask, reconstruction) if reconstruction.any() else np.inf


def usual_reconstruction_distance(
    autoencoder: Autoencoder, images: np.ndarray
) -> float:
    """The same of images `[N, H, W]`, 99th percentile [pixel]: beyond it, an image is
    unlike any of these.
    """
    distances = map(
        reconstruction_distance,
        images,
        decode(autoencoder, encode(autoencoder, images)),
    )
    return float(np.percentile(list(distances), 99))


def recorded_targets(images: np.ndarray) -> dict[str, np.ndarray]:
    """A few of the images `[N, H, W]`, from large to small, `{name: mask [H, W]}`."""
    chosen = images[images.sum(axis=(1, 2)).argsort()[::-1]][
        :: -(-len(images) // _RECORDED_TARGETS)
    ]
    return {f"recorded {k + 1}": image for k, image in enumerate(chosen)}


def uploaded_mask(content: bytes, size: int) -> np.ndarray:
    """Read a target `[H, W]`, bright where cloth is, from a file of `size` [byte]; a
    large one has no content.
    """
    if size > LARGEST_FILE:
        raise ValueError(
            f"this file is larger than {LARGEST_FILE / 1e6:.0f} MB: make the picture smaller"
        )
    return mask_from_file(content)
