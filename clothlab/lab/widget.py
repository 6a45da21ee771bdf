"""What the widgets share: JavaScript, a picture, errors, and time in the kernel."""

import asyncio
import base64
import contextlib
import io
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure
from PIL import Image

# A saved notebook that is opened again has outputs and no kernel. JupyterLab then says
# "model not found" where a widget was, and asks no other representation of it. So these
# words are an output of their own, which a living widget hides; the delay keeps them
# from showing for the moment before it does.
REOPENED = (
    "<style>\n"
    "@keyframes clothlab-late { from { opacity: 0 } to { opacity: 1 } }\n"
    ".clothlab-reopened { animation: clothlab-late 0s 1s both; "
    "color: #b00020; font-weight: 600 }\n"
    ".jp-OutputArea:has(.clothlab, .clothlab-widget) .clothlab-reopened "
    "{ display: none }\n"
    "</style>\n"
    '<div class="clothlab-reopened">'
    "The controls above need a kernel: run the cells again.</div>"
)
_FILM_FPS = 20
_RECENT = 5  # ticks
_PAUSE = 0.005  # [s] at least between two ticks, in which callbacks act


def javascript(*parts: str) -> str:
    """Files of `static/` as one module: such a module can't import its neighbours."""
    folder = Path(__file__).parent / "static"
    return "\n".join((folder / f"{part}.js").read_text("utf-8") for part in parts)


def encoded(picture: np.ndarray | Figure, kind: str = ".png") -> bytes:
    """A figure, picture `[h, w, 3]` uint8 or image `[h, w]` of 0 to 1, as a file.

    Pictures `[N, h, w, 3]` become a PNG that plays them again and again. What shows no
    motion, such as paper, shows the one that differs most from the first.
    """
    if isinstance(picture, Figure):
        file = io.BytesIO()
        picture.savefig(file, format="png", dpi=80, bbox_inches="tight")
        return file.getvalue()
    if picture.ndim == 4:
        frames = [Image.fromarray(each) for each in picture]
        changed = [cv2.norm(each, picture[0]) for each in picture]
        still = frames[int(np.argmax(changed))]
        file = io.BytesIO()
        still.save(
            file,
            format="png",
            save_all=True,
            default_image=True,  # the first is a still, and no part of the film
            append_images=frames,
            duration=1000 / _FILM_FPS,
            loop=0,
            compress_level=3,
        )
        return file.getvalue()
    if picture.dtype != np.uint8:
        picture = (255 * picture.astype(float)).astype(np.uint8)
    if picture.ndim == 3:
        picture = picture[..., ::-1]  # OpenCV has blue first
    _, data = cv2.imencode(kind, picture)
    return data.tobytes()


class Widget:
    """Inherited before the library's widget class."""

    errors: list[str]  # tracebacks of callbacks

    def check(self) -> None:
        """Raise if a callback has failed.

        A notebook that ran through unseen errors would pass otherwise.
        """
        if self.errors:
            raise RuntimeError(
                f"{len(self.errors)} callbacks failed; the first:\n{self.errors[0]}"
            )

    def still(self) -> tuple[bytes, str]:
        """How it looks now, PNG, and that in a sentence.

        For pages on which no kernel answers.
        """
        raise NotImplementedError

    def _ipython_display_(self) -> None:
        """Show the widget, and below it what to do where its kernel has gone."""
        data, metadata = self._repr_mimebundle_()
        display(data, metadata=metadata, raw=True)
        display({"text/html": REOPENED, "text/plain": ""}, raw=True)

    def _repr_mimebundle_(
        self, **options: Any
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """The library's answer, and the picture where no widget can be shown."""
        bundle = super()._repr_mimebundle_(**options)  # type: ignore[misc]
        data, metadata = bundle if isinstance(bundle, tuple) else (bundle, {})
        picture, words = self.still()
        png = base64.b64encode(picture).decode()
        return data | {"image/png": png}, metadata | {"image/png": {"alt": words}}


class LoopCallbacks:
    """Lets callbacks act in the thread that made this, between two steps.

    JupyterLab calls the handlers of widgets in a thread of their own, in the middle of
    whatever the kernel does.
    """

    def __init__(self) -> None:
        self._thread = threading.get_ident()
        self._loop: asyncio.AbstractEventLoop | None = None
        # Outside a notebook there is no loop, and no other thread calls us
        with contextlib.suppress(RuntimeError):
            self._loop = asyncio.get_running_loop()

    def call(self, act: Callable, *arguments: object) -> None:
        """Call `act` now, or from another thread as soon as the kernel is free."""
        if self._loop is None or threading.get_ident() == self._thread:
            act(*arguments)
        else:
            self._loop.call_soon_threadsafe(act, *arguments)


class Clock:
    """Calls `tick` once a `period` [s], in the event loop, until it answers False.

    The argument of `tick` is by how much it comes late [s].
    """

    def __init__(self, tick: Callable[[float], bool], period: float):
        self._tick = tick
        self._period = period
        self._task: asyncio.Task | None = None
        self._recent = deque[bool](maxlen=_RECENT)

    @property
    def late(self) -> bool:
        """Whether one of the last few ticks came more than half a period late."""
        return any(self._recent)

    @property
    def running(self) -> bool:
        """Whether time goes by."""
        return self._task is not None and not self._task.done()

    def start(self) -> None:
        """Let time go by; twice is once."""
        if not self.running:
            self._recent.clear()
            self._task = asyncio.get_running_loop().create_task(self._run())

    def pause(self) -> None:
        """Stop time."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            # A tick, and how late it is
            behind = loop.time() - due
            self._recent.append(behind > self._period / 2)
            if not self._tick(behind):
                self._task = None
                return

            # Lost time is not made up for; callbacks act meanwhile
            due = max(due + self._period, loop.time() - 2 * self._period)
            await asyncio.sleep(max(_PAUSE, due - loop.time()))
