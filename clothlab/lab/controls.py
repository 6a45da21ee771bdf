"""Controls for notebooks: a few sliders and menus with a figure below, and the map of p.

ipywidgets' `interact` and `Output` swallow errors of callbacks, and can make a notebook that runs from top to bottom
wait until its time limit. So a figure goes into an Image here, and an error is shown, kept, and raised by `check`.
"""

import html
import inspect
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import anywidget
import ipywidgets
import matplotlib.pyplot as plt
import numpy as np
import traitlets
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from clothlab.alt_text import AltText, describe
from clothlab.lab.clock import LoopCallbacks
from clothlab.lab.views import Plane, encoded, javascript
from clothlab.lab.widget import Widget
from clothlab.plots import image_grid


class PBMap(anywidget.AnyWidget):
    """The plane of p. A click, or the arrow keys, choose a place; the dots are the trained materials.

    Args:
        biases: trained p of each material, `{name: [D_p]}`.
        labels: what to call them, such as `{name: cloth.label}`; by default their names.
        p: chosen at first `[D_p]`; by default the first material's.
        reference: p from which a line leads to the chosen one `[D_p]`, if any.

    Attributes:
        chosen: place of the chosen p, PC1 and PC2.
        plane: the axes.
    """

    _esm = javascript("text", "map", "map_widget")
    about = traitlets.Dict().tag(sync=True)
    chosen = traitlets.List(traitlets.Float()).tag(sync=True)

    def __init__(
        self,
        biases: Mapping[str, np.ndarray],
        labels: Mapping[str, str] | None = None,
        *,
        p: ArrayLike | None = None,
        reference: ArrayLike | None = None,
    ):
        self.plane = Plane(biases, labels or {})
        start = self.plane.at(next(iter(biases.values())) if p is None else p)
        line = [] if reference is None else [self.plane.at(reference)]
        super().__init__(about=self.plane.map | {"line": line}, chosen=start)

    @property
    def p(self) -> np.ndarray:
        """The chosen p `[D_p]`; assign to choose another."""
        return self.plane.p(self.chosen)

    @p.setter
    def p(self, p: ArrayLike) -> None:
        self.chosen = self.plane.at(p)


class Control(Widget, ipywidgets.VBox):
    """Draws a figure anew whenever a control is moved, and once at the beginning.

    Args:
        draw: called with a value for each control; returns a figure, or a picture `[h, w, 3]` uint8. A parameter's
            default is where its control begins.
        labels: what stands beside the controls; by default their names.
        actions: buttons, `{label: function without arguments}`, after each of which it draws.
        controls: for each parameter of `draw` a list of choices, `{label: choice}`, `(lowest, highest, step)` for a
            slider that acts when it is released, a `PBMap`, or a widget with a value.

    Attributes:
        controls: the widgets, `{name: widget}`.
        buttons: those of the actions.
        errors: tracebacks of what went wrong, which a notebook's last cell raises with `check`.
    """

    def __init__(
        self,
        draw: Callable[..., Figure | np.ndarray],
        *,
        labels: Mapping[str, str] | None = None,
        actions: Mapping[str, Callable[[], object]] | None = None,
        **controls: Any,
    ):
        self._draw, self._callbacks, self.errors = draw, LoopCallbacks(), list[str]()
        self._words = AltText("No picture", ())
        starts = {name: each.default for name, each in inspect.signature(draw).parameters.items()}
        wide = {"style": {"description_width": "150px"}, "layout": {"width": "480px"}}
        self.controls: dict[str, ipywidgets.DOMWidget] = {}
        for name, choices in controls.items():
            options = wide | {"description": (labels or {}).get(name, name)}
            self.controls[name] = _widget(choices, starts.get(name, inspect.Parameter.empty), options)
        for widget in self.controls.values():
            widget.observe(
                lambda _: self._callbacks.take(self._redraw), "chosen" if isinstance(widget, PBMap) else "value"
            )
        self.buttons = [ipywidgets.Button(description=label) for label in actions or {}]
        for button, act in zip(self.buttons, (actions or {}).values(), strict=True):
            button.on_click(lambda _, act=act: self._callbacks.take(self._redraw, act))
        self.picture, self.message = ipywidgets.Image(format="png"), ipywidgets.HTML()
        maps = [each for each in self.controls.values() if isinstance(each, PBMap)]
        others = [each for each in self.controls.values() if each not in maps]
        drawn = ipywidgets.VBox([self.message, self.picture])
        super().__init__([*others, ipywidgets.HBox(self.buttons), ipywidgets.HBox([*maps, drawn])])
        self._redraw()

    def still(self) -> tuple[bytes, AltText]:
        """What it shows now."""
        return self.picture.value, self._words

    def _redraw(self, act: Callable[[], object] | None = None) -> None:
        self.message.value = "computing …"
        try:
            if act is not None:
                act()
            drawing = self._draw(
                **{name: each.p if isinstance(each, PBMap) else each.value for name, each in self.controls.items()}
            )
            self.picture.value = encoded(drawing)
            self._words = describe(drawing if isinstance(drawing, Figure) else image_grid([drawing]))
            if isinstance(drawing, Figure):
                plt.close(drawing)  # or the notebook would show it a second time
            self.message.value = ""
        except Exception as error:
            self.errors.append(traceback.format_exc())
            text = html.escape(traceback.format_exception_only(error)[-1])
            self.message.value = f"<span role='alert' style='color:#b00020'>✗ {text}</span>"


def _widget(choices: Any, start: Any, options: dict[str, Any]) -> ipywidgets.DOMWidget:
    """A slider for `(lowest, highest, step)`, a menu for other choices; widgets are taken as they are."""
    if isinstance(choices, ipywidgets.Widget):
        return choices
    first = {} if start is inspect.Parameter.empty else {"value": start}
    if isinstance(choices, tuple) and len(choices) == 3:
        low, high, step = choices
        kind = ipywidgets.IntSlider if all(isinstance(x, int) for x in choices) else ipywidgets.FloatSlider
        return kind(min=low, max=high, step=step, continuous_update=False, **({"value": low} | first | options))
    choices = list(choices.items()) if isinstance(choices, Mapping) else list(choices)
    return ipywidgets.Dropdown(options=choices, **(first | options))
