"""Cloth masks: their size, how an input is judged to be one, how two are compared."""

import numpy as np
from numpy.typing import ArrayLike

# [pixel], the paper's 128×96 image.
HEIGHT = 96
WIDTH = 128

# {"image": cloth mask [H, W], "robot": robot state [D_r]}
Observation = dict[str, np.ndarray]


def check_masks(images: ArrayLike) -> np.ndarray:
    """Return masks as bool `[..., H, W]`.

    A ValueError for another shape, or for a grey picture or reconstruction.
    """
    what = f"cloth images are [..., {HEIGHT}, {WIDTH}]"
    try:
        images = np.asarray(images)
    except (TypeError, ValueError, RuntimeError):
        # Rows of different lengths, or a tensor that requires grad.
        kind = type(images).__name__
        raise ValueError(f"{what} of 0 and 1, got {kind}") from None

    # Another size, or numbers between 0 and 1.
    if images.shape[-2:] != (HEIGHT, WIDTH):
        raise ValueError(f"{what}, got the shape {list(images.shape)}")
    if images.dtype == bool:
        return images
    if images.dtype.kind not in "iuf" or not np.isin(images, (0, 1)).all():
        raise ValueError(
            "a cloth image holds 0 and 1 only: `picture > 127` makes one of a grey "
            "picture, `image > 0.5` of a reconstruction"
        )
    return images.astype(bool)


def check_mask(mask: ArrayLike) -> np.ndarray:
    """Return one mask as bool `[H, W]`.

    A ValueError as in `check_masks`, or if there is no cloth in it.
    """
    mask = check_masks(mask)
    if mask.ndim != 2:
        raise ValueError(
            f"one cloth image is [{HEIGHT}, {WIDTH}], got the shape {list(mask.shape)}"
        )
    if not mask.any():
        raise ValueError("no cloth in the image: the mask is empty")
    return mask


def iou(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Intersection over union `[...]`, float64, of masks `[..., H, W]`.

    1 where both are empty.
    """
    a = check_masks(a)
    b = check_masks(b)
    union = (a | b).sum(axis=(-2, -1))
    common = (a & b).sum(axis=(-2, -1))
    return np.where(union == 0, 1.0, common / np.maximum(union, 1))
