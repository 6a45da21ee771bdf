"""A recorded run of the panel: what it showed, step by step, in a file, shown again
without computing anything.
"""

import base64
import html
import json
import lzma
from collections.abc import Mapping
from itertools import accumulate
from operator import or_
from pathlib import Path
from typing import Any

import cv2
import ipywidgets
import numpy as np

from clothlab import artifacts
from clothlab._files import OtherKindError, reading, write_bytes
from clothlab.alt_text import AltText
from clothlab.lab import _views as views
from clothlab.lab._clock import LoopCallbacks
from clothlab.lab._controls import WRAPPED
from clothlab.lab._messages import Messages
from clothlab.lab._widget import LifeSign, Widget
from clothlab.simulation.env import CONTROL_PERIOD

RECORDING = Path("demonstration") / "torque.json.xz"  # in the folder of data
# What a panel sends the browser
_SHOWN = ("about", "state", "target", "frame", "ellipse")
_MOST_BYTES = 2**26  # of a recorded run's text, several times what two minutes need
# Widths [pixel]
_PICTURES = {"the robot": 384, "what the camera sees": 256, "the target": 256}
_QUALITY = 60  # of JPEG, of 100
# Those of `_SHOWN` that are new at a step, and `caption`, what to say meanwhile
_Frame = Mapping[str, Any]


class SessionRecording:
    """Keeps what a panel shows."""

    def __init__(self, panel: Any):
        self._panel, self._last = panel, dict[str, str]()
        self.shots: list[str] = []

    def take(self, caption: str) -> None:
        """Keep how things stand now."""
        shown = {name: getattr(self._panel, name) for name in _SHOWN}
        shown["frame"] = shown["frame"] | {"scene": _smaller(shown["frame"]["scene"])}
        now = {
            name: json.dumps(value, default=_packed) for name, value in shown.items()
        }
        news = [
            f'"{name}":{text}'
            for name, text in now.items()
            if self._last.get(name) != text
        ]
        self._last = now
        self.shots.append(
            "{" + ",".join([*news, f'"caption":{json.dumps(caption)}']) + "}"
        )

    def save(self, path: Path) -> None:
        """Write all that was kept, whole or not at all."""
        text = '{"shots":[\n' + ",\n".join(self.shots) + "\n]}\n"
        write_bytes(path, lzma.compress(text.encode(), preset=9))


def load_recording(path: Path | None = None) -> list[_Frame]:
    """Read a recorded run, by default the one that belongs to the data."""
    path = artifacts.data_folder() / RECORDING if path is None else path
    if not path.is_file():
        raise FileNotFoundError(
            f"there is no recorded run in {path}: `make demonstration` makes one"
        )
    with reading(path, "recorded run"):
        text = lzma.LZMADecompressor().decompress(
            path.read_bytes(), max_length=_MOST_BYTES + 1
        )
        if len(text) > _MOST_BYTES:
            raise OtherKindError(f"it unpacks to more than {_MOST_BYTES / 1e6:.0f} MB")
        return json.loads(text, object_hook=_unpacked)["shots"]


class RecordedRun(Widget, ipywidgets.VBox):
    """Plays the recorded run up to a step, without a session; `shown` is the step that
    is seen at first.
    """

    def __init__(self, stop: int | None = None, shown: int = 0):
        self._moments = list(accumulate(load_recording(), or_))[:stop]
        masks = [
            views.masks(moment["frame"], moment["target"]) for moment in self._moments
        ]
        # [T, H, W], seen and aimed at
        self.images, self.targets = np.swapaxes(masks, 0, 1)
        self.errors: list[str] = []
        guarded, take = Messages(self.errors).guarded, LoopCallbacks().take
        self._pictures = [
            ipywidgets.Image(layout={"width": "100%", "margin": "0"}) for _ in _PICTURES
        ]
        about = {"value": shown, "max": len(self._moments) - 1, "description": "step"}
        button = ipywidgets.Play(
            interval=round(1000 * CONTROL_PERIOD), repeat=True, **about
        )
        self.slider, self._caption = (
            ipywidgets.IntSlider(**about),
            ipywidgets.HTML(layout={"flex": "1 1 200px"}),
        )
        ipywidgets.jslink((button, "value"), (self.slider, "value"))
        self.slider.observe(lambda _: take(guarded, self._show), "value")
        figures = [
            _figure(*about)
            for about in zip(_PICTURES, self._pictures, _PICTURES.values(), strict=True)
        ]
        rows = figures, [button, self.slider, self._caption]
        super().__init__(
            [LifeSign(), *(ipywidgets.Box(row, layout=WRAPPED) for row in rows)]
        )
        self.add_class("clothlab-widget")
        self._show()

    def still(self) -> tuple[bytes, AltText]:
        """The moment that is shown."""
        moment = self._moments[self.slider.value]
        return views.still(moment["frame"], moment["target"])

    def _show(self) -> None:
        step = self.slider.value
        frame, caption = self._moments[step]["frame"], self._moments[step]["caption"]
        files = frame["scene"], frame["seen"], views.encoded(self.targets[step])
        for picture, file in zip(self._pictures, files, strict=True):
            picture.value = file
        self._caption.value = html.escape(f"{_clock_time(step)}: {caption}")


def _figure(title: str, picture: ipywidgets.Image, width: int) -> ipywidgets.VBox:
    """A picture with a title, of this width [pixel] where there is room for it; small
    ones share a row sooner.
    """
    least = round(0.9 * width if width > 300 else 0.75 * width)
    share = {
        "flex": f"{width} 1 {least}px",
        "max_width": f"{width}px",
        "overflow": "visible",
    }
    share["padding"] = "0 6px 0 0"  # or two black masks side by side look like one
    return ipywidgets.VBox([ipywidgets.Label(title), picture], layout=share)


def _clock_time(steps: int) -> str:
    minutes, seconds = divmod(int(steps * CONTROL_PERIOD), 60)
    return f"{minutes}:{seconds:02}"


def _smaller(jpeg: bytes) -> bytes:
    """The same picture in fewer bytes: a recording has hundreds of them."""
    picture = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR))
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[
        1
    ].tobytes()


def _packed(value: object) -> dict[str, str]:
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode()}
    raise TypeError(f"a panel shows no {type(value).__name__}")


def _unpacked(value: dict[str, Any]) -> Any:
    return base64.b64decode(value["bytes"]) if value.keys() == {"bytes"} else value
