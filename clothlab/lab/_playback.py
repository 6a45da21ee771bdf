"""A recorded run of the panel: what it showed, step by step, in a file.

It is shown again without computing anything.
"""

import base64
import html
import json
import lzma
from pathlib import Path
from typing import Any

import cv2
import ipywidgets
import numpy as np

from clothlab import _store
from clothlab._alt_text import AltText
from clothlab._files import OtherKindError, reading, write_bytes
from clothlab.lab._clock import LoopCallbacks
from clothlab.lab._controls import WRAPPED
from clothlab.lab._messages import Messages
from clothlab.lab._pictures import encoded, masks, still
from clothlab.lab._widget import Widget
from clothlab.simulation.env import CONTROL_PERIOD

RECORDING = Path("demonstration") / "torque.json.xz"  # in the folder of data
# What a panel sends the browser
_SHOWN = ("about", "state", "target", "frame", "ellipse")
_MOST_BYTES = 2**26  # of a recorded run's text, several times what two minutes need
# What is seen of a run, and its width [pixel]
_PICTURES = {"the robot": 384, "what the camera sees": 256, "the target": 256}
_QUALITY = 60  # of JPEG, of 100
# Those of `_SHOWN` that are new at a step, and `caption`, what to say meanwhile
_Frame = dict[str, Any]


class SessionRecording:
    """Keeps what a panel shows."""

    def __init__(self, panel: Any):
        self._panel = panel
        self._last: dict[str, str] = {}  # as JSON, what was shown last
        self.shots: list[str] = []  # JSON

    def take(self, caption: str) -> None:
        """Keep how things stand now, as far as it is new."""
        news = []
        for name in _SHOWN:
            value = getattr(self._panel, name)
            if name == "frame":
                value = value | {"scene": _smaller(value["scene"])}
            text = json.dumps(value, default=_packed)
            if self._last.get(name) != text:
                news.append(f'"{name}":{text}')
            self._last[name] = text
        news.append(f'"caption":{json.dumps(caption)}')
        self.shots.append("{" + ",".join(news) + "}")

    def save(self, path: Path) -> None:
        """Write all that was kept, whole or not at all."""
        text = '{"shots":[\n' + ",\n".join(self.shots) + "\n]}\n"
        write_bytes(path, lzma.compress(text.encode(), preset=9))


def load_recording(path: Path | None = None) -> list[_Frame]:
    """Read a recorded run, by default the one that belongs to the data."""
    if path is None:
        path = _store.data_folder() / RECORDING
    if not path.is_file():
        raise FileNotFoundError(
            f"there is no recorded run in {path}: `make demonstration` makes one"
        )
    with reading(path, "recorded run"):
        unpack = lzma.LZMADecompressor()
        text = unpack.decompress(path.read_bytes(), max_length=_MOST_BYTES + 1)
        if len(text) > _MOST_BYTES:
            raise OtherKindError(f"it unpacks to more than {_MOST_BYTES / 1e6:.0f} MB")
        return json.loads(text, object_hook=_unpacked)["shots"]


class RecordedRun(Widget, ipywidgets.VBox):
    """Plays the recorded run up to a step, without a session.

    Args:
        stop: the last step, counted from 1; by default it is played to its end.
        shown: the step that is seen at first.
    """

    def __init__(self, stop: int | None = None, shown: int = 1):
        self.errors: list[str] = []

        # How things stood at each step, and its masks [T, H, W], seen and aimed at
        self._moments = _moments(load_recording())[:stop]
        pairs = [masks(moment["frame"], moment["target"]) for moment in self._moments]
        self.images, self.targets = np.swapaxes(pairs, 0, 1)

        # Pictures in a row, and below them what plays them
        self._pictures = []
        figures = []
        for title, width in _PICTURES.items():
            layout = {"width": "100%", "margin": "0"}
            picture = ipywidgets.Image(layout=layout)
            self._pictures.append(picture)
            figures.append(_figure(title, picture, width))
        about = {"value": shown, "description": "step"}
        about |= {"min": 1, "max": len(self._moments)}
        interval = round(1000 * CONTROL_PERIOD)  # [ms]
        play = ipywidgets.Play(interval=interval, repeat=True, **about)
        self.slider = ipywidgets.IntSlider(**about)
        self._caption = ipywidgets.HTML(layout={"flex": "1 1 200px"})
        above = ipywidgets.Box(figures, layout=WRAPPED)
        below = ipywidgets.Box([play, self.slider, self._caption], layout=WRAPPED)

        # The button moves the slider, in the browser, and the slider the pictures
        messages = Messages()
        self.errors = messages.errors
        guarded = messages.guarded
        take = LoopCallbacks().take
        ipywidgets.jslink((play, "value"), (self.slider, "value"))
        self.slider.observe(lambda _: take(guarded, self._show), "value")
        super().__init__([above, below])
        self.add_class("clothlab-widget")
        self._show()

    def still(self) -> tuple[bytes, AltText]:
        """The moment that is shown."""
        moment = self._moments[self.slider.value - 1]
        return still(moment["frame"], moment["target"])

    def _show(self) -> None:
        step = self.slider.value - 1
        moment = self._moments[step]
        frame = moment["frame"]
        files = (frame["scene"], frame["seen"], encoded(self.targets[step]))
        for picture, file in zip(self._pictures, files, strict=True):
            picture.value = file
        caption = f"{_clock_time(step)}: {moment['caption']}"
        self._caption.value = html.escape(caption)


def _moments(shots: list[_Frame]) -> list[_Frame]:
    """How things stood at each step, of what was new at each."""
    moments = []
    moment: _Frame = {}
    for news in shots:
        moment = moment | news
        moments.append(moment)
    return moments


def _figure(title: str, picture: ipywidgets.Image, width: int) -> ipywidgets.VBox:
    """A picture with a title, of this width [pixel] where there is room for it.

    Small ones share a row sooner.
    """
    least = round(0.9 * width if width > 300 else 0.75 * width)
    layout = {
        "flex": f"{width} 1 {least}px",
        "max_width": f"{width}px",
        "overflow": "visible",
        "padding": "0 6px 0 0",  # or two black masks side by side look like one
    }
    return ipywidgets.VBox([ipywidgets.Label(title), picture], layout=layout)


def _clock_time(steps: int) -> str:
    minutes, seconds = divmod(int(steps * CONTROL_PERIOD), 60)
    return f"{minutes}:{seconds:02}"


def _smaller(jpeg: bytes) -> bytes:
    """The same picture in fewer bytes: a recording has hundreds of them."""
    picture = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR))
    _, smaller = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return smaller.tobytes()


def _packed(value: object) -> dict[str, str]:
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode()}
    raise TypeError(f"a panel shows no {type(value).__name__}")


def _unpacked(value: dict[str, Any]) -> Any:
    if value.keys() == {"bytes"}:
        return base64.b64decode(value["bytes"])
    return value
