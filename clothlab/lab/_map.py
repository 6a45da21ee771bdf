"""The map of p as a control of a notebook."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from clothlab.lab._plane import Plane
from clothlab.lab._widget import javascript

if TYPE_CHECKING:
    from sklearn.decomposition import PCA


class PBMap(anywidget.AnyWidget):
    """The plane of p, in which a click or the arrow keys choose a place.

    The dots are the trained materials.

    Args:
        biases: trained p of each material, `{name: [D_p]}`.
        labels: names of the dots, such as `{name: cloth.label}`.
        p: chosen at first `[D_p]`.
        reference: p from which a line leads to the chosen one `[D_p]`, if any.
        symbol: of what is chosen, if it is not p: "z" for a map of images.
        axes: a fitted PCA of two components, whose plane is drawn; by default that of
            `biases`.
    """

    _esm = javascript("text", "map", "map_widget")
    about = traitlets.Dict().tag(sync=True)
    # Place of the chosen p, PC1 and PC2
    chosen = traitlets.List(traitlets.Float()).tag(sync=True)

    def __init__(
        self,
        biases: Mapping[str, np.ndarray],
        labels: Mapping[str, str],
        *,
        p: ArrayLike,
        reference: ArrayLike | None = None,
        symbol: str = "p",
        axes: "PCA | None" = None,
    ):
        self._plane = Plane(biases, labels, symbol, axes)
        line = [] if reference is None else [self._plane.at(reference)]
        about = self._plane.map | {"line": line}
        super().__init__(about=about, chosen=self._plane.at(p))

    @property
    def value(self) -> np.ndarray:
        """The chosen p `[D_p]`."""
        return self._plane.p(self.chosen)
