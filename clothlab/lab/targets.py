"""Images to aim at, and how well the network understands them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_mask
from clothlab.method.autoencoder import Autoencoder, decode, encode
from clothlab.simulation.vision import chamfer_distance, iou
from clothlab.trials import Trial

# Of the recorded images, one in so many is compared with drawn ones
REFERENCE_EVERY = 20
_RECORDED_TARGETS = 7  # how many recorded images the gallery has
_CANNOT_DRAW = 0.6  # IoU with its reconstruction below which an image is not drawn


def known_target(model: Autoencoder, mask: ArrayLike, images: ArrayLike) -> np.ndarray:
    """An image `[H, W]` to aim at that the autoencoder can draw.

    That is the target mask `[H, W]` itself where it can be drawn. If its reconstruction
    has little in common with it, its z is that of another shape; then the most similar
    of recorded images `[B, H, W]` takes its place, where that is more like it.
    """
    drawn = decode(model, encode(model, mask)) > 0.5
    own = iou(drawn, mask)
    if own < _CANNOT_DRAW:
        overlap = iou(images, mask)
        if overlap.max() > own:
            return np.asarray(images)[overlap.argmax()]
    return np.asarray(mask, bool)


class Aim(NamedTuple):
    """A target that a person chose, and what the network makes of it."""

    mask: np.ndarray  # [H, W], bool
    # What is aimed at: the mask, or a recorded image in its place, if that is more like
    # it than what the autoencoder makes of it
    known: np.ndarray  # [H, W], bool
    z: np.ndarray  # of what is aimed at [D_z]
    reconstruction: np.ndarray  # of the mask [H, W], 0 to 1
    distance: float  # chamfer distance of mask and reconstruction [pixel]
    overlap: float  # IoU of the mask and the recorded image that is most like it


def aim_at(mask: ArrayLike, autoencoder: Autoencoder, images: np.ndarray) -> Aim:
    """Look at a target `[H, W]` beside recorded images `[N, H, W]`."""
    mask = check_mask(mask)
    known = known_target(autoencoder, mask, images)
    reconstruction = decode(autoencoder, encode(autoencoder, mask))
    return Aim(
        mask=mask.copy(),
        known=known,
        z=encode(autoencoder, known),
        reconstruction=reconstruction,
        distance=reconstruction_distance(mask, reconstruction),
        overlap=float(iou(images, mask).max()),
    )


def reference_images(trials: Sequence[Trial]) -> np.ndarray:
    """Some of the recorded images `[N, H, W]`, with cloth in each."""
    images = np.concatenate([trial.images[::REFERENCE_EVERY] for trial in trials])
    with_cloth = images.any(axis=(1, 2))
    return images[with_cloth]


def reconstruction_distance(mask: np.ndarray, reconstruction: np.ndarray) -> float:
    """Chamfer distance [pixel] between a mask and its reconstruction.

    It is infinite where no cloth is left.
    """
    shape = reconstruction > 0.5
    return chamfer_distance(mask, shape) if shape.any() else np.inf


def usual_reconstruction_distance(
    autoencoder: Autoencoder, images: np.ndarray
) -> float:
    """The same of images `[N, H, W]`, 99th percentile [pixel].

    Beyond it, an image is unlike any of these.
    """
    reconstructions = decode(autoencoder, encode(autoencoder, images))
    distances = list(map(reconstruction_distance, images, reconstructions))
    return float(np.percentile(distances, 99))


def recorded_targets(images: np.ndarray) -> dict[str, np.ndarray]:
    """A few of the images `[N, H, W]`, from large to small, `{name: mask [H, W]}`."""
    from_small_to_large = images.sum(axis=(1, 2)).argsort()
    every = -(-len(images) // _RECORDED_TARGETS)
    chosen = images[from_small_to_large[::-1][::every]]
    return {f"recorded {k}": image for k, image in enumerate(chosen, 1)}
