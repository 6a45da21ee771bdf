"""The map of p: a plane through the trained ones."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from clothlab.analysis import outline, principal_axes

if TYPE_CHECKING:
    from sklearn.decomposition import PCA

_MARGIN = 1.2  # how much wider than the trained p the map is


class Plane:
    """The two principal axes of the trained p, on which the map is drawn.

    Args:
        biases: trained p of each material, `{name: [D_p]}`.
        labels: names of their dots on the map; by default those of the materials.
        symbol: of what is drawn, if it is not p.
        axes: a PCA of two components to draw on, if not that of `biases`.
    """

    def __init__(
        self,
        biases: Mapping[str, np.ndarray],
        labels: Mapping[str, str],
        symbol: str = "p",
        axes: "PCA | None" = None,
    ):
        self._axes = axes or principal_axes(dict(biases))
        places = [self.at(p) for p in biases.values()]
        dots = []
        for name, place in zip(biases, places, strict=True):
            label = labels.get(name, name)
            dots.append({"name": name, "label": label, "at": place})
        # As plain data, which the browser draws; `reach` is half of the width shown
        self.map = {
            "dots": dots,
            "reach": _MARGIN * float(np.abs(places).max()),
            "axes": [f"PC1 of {symbol}", f"PC2 of {symbol}"],
        }

    def at(self, p: ArrayLike) -> list[float]:
        """Where p `[D_p]` is on the map: PC1 and PC2."""
        return self._axes.transform(np.asarray(p)[None])[0].tolist()

    def region(self, p: ArrayLike, covariance: ArrayLike) -> list[list[float]]:
        """Edge of the 90 % region around p `[D_p]`, places of PC1 and PC2."""
        axes = self._axes.components_
        across = axes @ np.asarray(covariance) @ axes.T
        return outline(self.at(p), across).round(4).tolist()

    def p(self, at: ArrayLike) -> np.ndarray:
        """p `[..., D_p]` of places `[..., 2]` on the map."""
        places = np.asarray(at, dtype=float)
        p = self._axes.inverse_transform(places.reshape(-1, 2))
        return p.reshape(*places.shape[:-1], -1)
