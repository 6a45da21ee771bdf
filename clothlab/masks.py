"""What is observed of a cloth, and how much two images of it have in common."""

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_masks

# {"image": cloth mask [H, W], "robot": robot state [D_r]}
Observation = dict[str, np.ndarray]


def iou(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Intersection over union `[...]`, float64, of masks `[..., H, W]`.

    1 where both are empty.
    """
    a = check_masks(a)
    b = check_masks(b)
    union = (a | b).sum(axis=(-2, -1))
    common = (a & b).sum(axis=(-2, -1))
    return np.where(union == 0, 1.0, common / np.maximum(union, 1))
