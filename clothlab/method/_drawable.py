"""Which image to aim at: one that the autoencoder can draw."""

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_masks
from clothlab.masks import iou
from clothlab.method.autoencoder import Autoencoder, decode, encode

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
    return check_masks(mask)
