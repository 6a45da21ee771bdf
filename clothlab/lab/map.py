"""The map of p: a plane through the trained ones, and the widget that shows it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from clothlab.analysis import outline, principal_axes
from clothlab.lab.widget import javascript

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
        if not isinstance(labels, Mapping):
            kind = type(labels).__name__
            raise ValueError(
                f"labels are {{name of a material: what its dot is called}}, got {kind}"
            )
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
        """p `[D_p]` of a place on the map `[2]`."""
        return self._axes.inverse_transform(np.asarray(at, float)[None])[0]


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
