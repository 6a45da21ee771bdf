"""A canvas as a control of a notebook, on which a target is drawn."""

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from clothlab._validation import HEIGHT, WIDTH, check_mask
from clothlab.lab.widget import javascript


class TargetCanvas(anywidget.AnyWidget):
    """An image to draw on, white where cloth is to be.

    Args:
        mask: with which it begins `[H, W]`.
    """

    _esm = javascript("target", "target_widget")
    size = traitlets.List([WIDTH, HEIGHT]).tag(sync=True)  # [pixel]
    # A byte for each pixel, 0 or 1; the browser sends a memoryview of them
    chosen = traitlets.CBytes().tag(sync=True)

    def __init__(self, mask: ArrayLike):
        super().__init__(chosen=check_mask(mask).tobytes())

    @property
    def value(self) -> np.ndarray:
        """What is drawn `[H, W]`, bool."""
        return np.frombuffer(self.chosen, bool).reshape(HEIGHT, WIDTH)
