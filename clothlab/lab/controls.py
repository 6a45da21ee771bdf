"""Controls for notebooks: sliders, menus, maps and canvases, with a figure or film.

ipywidgets' `interact` and `Output` swallow errors of callbacks, and can make a notebook
that runs from top to bottom wait until its time limit. So a figure goes into an Image
here, and an error is shown, kept, and raised by `check`.
"""

import html
import inspect
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import ipywidgets
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from clothlab import plots
from clothlab.lab.canvas import TargetCanvas
from clothlab.lab.map import PBMap
from clothlab.lab.widget import LoopCallbacks, Widget, encoded

WRAPPED = {
    "display": "flex",
    "flex_flow": "row wrap",
    "width": "auto",
    "overflow": "visible",
}
_FIGURE = "480px"  # as narrow as a figure may get beside a map
_DRAWN = PBMap | TargetCanvas  # what stands beside the figure


class Control(Widget, ipywidgets.VBox):
    """Draws a figure or film at the beginning, and whenever a control is moved.

    Args:
        draw: called with a value for each control; returns a figure, or a film
            `[N, h, w, 3]` uint8, whose words are the first line of its docstring. Its
            defaults are where the controls begin.
        labels: what stands beside the controls; by default their names.
        controls: for each parameter of `draw` a list of choices, `(lowest, highest,
            step)` for a slider that acts when it is released, a `PBMap` or a
            `TargetCanvas`.
    """

    def __init__(
        self,
        draw: Callable[..., Figure | np.ndarray],
        *,
        labels: Mapping[str, str] | None = None,
        **controls: Any,
    ):
        self._draw = draw
        self._callbacks = LoopCallbacks()
        self._words = "No picture"
        self.errors: list[str] = []

        # What is moved
        parameters = inspect.signature(draw).parameters
        self.controls: dict[str, ipywidgets.DOMWidget] = {}
        for name, choices in controls.items():
            widget = choices
            if not isinstance(choices, _DRAWN):
                start = _start(name, parameters, choices)
                label = (labels or {}).get(name, name)
                widget = _widget(choices, start, label)
            self._redraw_when_moved(widget)
            self.controls[name] = widget

        # What is drawn: sliders and menus above, maps, canvases and the figure below
        self.picture = ipywidgets.Image(format="png")
        self.message = ipywidgets.HTML()
        drawn = [each for each in self.controls.values() if isinstance(each, _DRAWN)]
        others = [each for each in self.controls.values() if each not in drawn]
        figure = _figure(self.message, self.picture)
        beside = ipywidgets.Box([*drawn, figure], layout=WRAPPED)
        super().__init__([*others, beside])
        self.add_class("clothlab-widget")
        self._redraw()

    def still(self) -> tuple[bytes, str]:
        """What it shows now."""
        return self.picture.value, self._words

    def _redraw_when_moved(self, widget: ipywidgets.DOMWidget) -> None:
        trait = "chosen" if isinstance(widget, _DRAWN) else "value"
        widget.observe(lambda _: self._callbacks.call(self._redraw), trait)

    def _redraw(self) -> None:
        self.message.value = "computing …"
        values = {name: each.value for name, each in self.controls.items()}
        try:
            drawn = self._draw(**values)
            self.picture.value = encoded(drawn)
            if isinstance(drawn, Figure):
                self._words = plots.alt_text(drawn)
                plt.close(drawn)  # or the notebook would show it a second time
            else:
                self._words = (inspect.getdoc(self._draw) or "A film").split("\n")[0]
            self.message.value = ""
        except Exception as error:
            self.errors.append(traceback.format_exc())
            text = html.escape(traceback.format_exception_only(error)[-1])
            self.message.value = (
                f"<span role='alert' style='color:#b00020'>✗ {text}</span>"
            )


def _figure(message: ipywidgets.HTML, picture: ipywidgets.Image) -> ipywidgets.VBox:
    """A figure with the message above.

    It stands beside a map where there is room for it, else below.
    """
    # With the margins that the library gives it
    width = f"min(calc(100% - 4px), {_FIGURE})"
    layout = {"flex": f"1 1 {width}", "min_width": width, "overflow": "visible"}
    return ipywidgets.VBox([message, picture], layout=layout)


def _start(name: str, parameters: Mapping[str, inspect.Parameter], choices: Any) -> Any:
    """Where a control begins: the default of its parameter, one of the choices.

    Raises:
        ValueError: there is none, or it is no choice.
    """
    if name not in parameters:
        raise ValueError(
            f"what is drawn has no parameter {name!r}; it has {', '.join(parameters)}"
        )
    start = parameters[name].default
    if start is inspect.Parameter.empty:
        raise ValueError(f"parameter {name} needs a default: its control begins there")
    if isinstance(choices, tuple):
        low, high, _ = choices
        allowed = low <= start <= high
    else:
        values = [each[1] if isinstance(each, tuple) else each for each in choices]
        allowed = start in values
    if not allowed:
        raise ValueError(f"the default of {name}, {start!r}, is not among {choices}")
    return start


def _widget(choices: Any, start: Any, label: str) -> ipywidgets.DOMWidget:
    """A slider for `(lowest, highest, step)`, else a menu."""
    options = {
        "value": start,
        "description": label,
        "style": {"description_width": "150px"},
        "layout": {"width": "min(480px, calc(100% - 4px))"},
    }
    if not isinstance(choices, tuple):
        return ipywidgets.Dropdown(options=choices, **options)
    low, high, step = choices
    kind = ipywidgets.IntSlider if isinstance(step, int) else ipywidgets.FloatSlider
    return kind(min=low, max=high, step=step, continuous_update=False, **options)
