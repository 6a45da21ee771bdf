"""Cameras as MuJoCo has them: a pinhole."""

import numpy as np


def focal_length(fovy: float, height: float = 1.0) -> float:
    """Focal length of a pinhole camera with the vertical field of view `fovy` [degree].

    Its unit is that of the picture's `height`.
    """
    return float(0.5 * height / np.tan(np.deg2rad(fovy) / 2))
