"""Cloth masks: from camera pictures or files, and how much two of them differ.

Colour extraction and chamfer distance are the paper's: section "Experimental Setup".
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH, check_mask, check_masks

# {"image": cloth mask [H, W], "robot": robot state [D_r]}
Observation = dict[str, np.ndarray]

# Removes slivers a few pixels wide, which a cloth seen edge-on leaves and no three
# numbers could describe.
KERNEL = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))

# Red beyond both other channels is a hue test that survives shading; 40 of 255 clears
# the grey of arm and floor.
_REDNESS = 40


def cloth_mask(rgb: np.ndarray) -> np.ndarray:
    """Where the red front of the cloth is, `[H, W]`, bool.

    By colour extraction, binarisation, closing, opening and resizing of a picture
    `[h, w, 3]`, uint8, of the aspect 4:3. The mask is empty where no front shows.
    """
    rgb = np.asarray(rgb)
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or not rgb.size:
        raise ValueError(
            f"a picture is [height, width, 3] of uint8, got {rgb.shape} of {rgb.dtype}"
        )
    if rgb.shape[0] * WIDTH != rgb.shape[1] * HEIGHT:
        raise ValueError(
            f"a picture has the aspect 4:3, got {rgb.shape[1]}×{rgb.shape[0]}; "
            "crop it first"
        )

    # The colour of the front
    red, green, blue = cv2.split(rgb)
    redness = cv2.subtract(red, cv2.max(green, blue))
    mask: np.ndarray = cv2.threshold(redness, _REDNESS, 1, cv2.THRESH_BINARY)[1]

    # Holes and slivers go.
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, KERNEL)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, KERNEL)

    # A pixel of a smaller mask is cloth where more than half of it is.
    if mask.shape != (HEIGHT, WIDTH):
        size = (WIDTH, HEIGHT)
        grey = mask * np.uint8(255)
        smaller = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return np.asarray(smaller > 127)
    return mask.astype(bool)


def mask_from_file(content: bytes) -> np.ndarray:
    """Read a target `[H, W]` from a picture file of that size: bright is cloth."""
    picture = None
    if content:
        array = np.frombuffer(content, np.uint8)
        picture = cv2.imdecode(array, cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError("this file is not a picture: use PNG or JPEG")
    height, width = picture.shape
    if (height, width) != (HEIGHT, WIDTH):
        raise ValueError(
            f"a target has {WIDTH}×{HEIGHT} pixels, this picture {width}×{height}"
        )
    return check_mask(picture > 127)


def iou(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Intersection over union `[...]`, float64, of masks `[..., H, W]`.

    1 where both are empty.
    """
    a = check_masks(a)
    b = check_masks(b)
    union = (a | b).sum(axis=(-2, -1))
    common = (a & b).sum(axis=(-2, -1))
    return np.where(union == 0, 1.0, common / np.maximum(union, 1))


def chamfer_distance(a: ArrayLike, b: ArrayLike) -> float:
    """Symmetric chamfer distance [pixel] between two masks `[H, W]`.

    The mean distance from a pixel of one cloth to the nearest pixel of the other, in
    both directions, averaged (paper, section "Simulation Experiment").
    """
    a = check_mask(a)
    b = check_mask(b)
    from_a = _distance_to(b)[a].mean()
    from_b = _distance_to(a)[b].mean()
    return float((from_a + from_b) / 2)


def _distance_to(mask: np.ndarray) -> np.ndarray:
    """Distance [pixel] of every pixel to the nearest one of the mask, `[H, W]`."""
    return cv2.distanceTransform(
        (~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
