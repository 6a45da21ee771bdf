"""The live panel: a thin layer of widgets over `clothlab.session.LiveSession`."""

import asyncio
import io
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import anywidget
import cv2
import ipywidgets
import numpy as np
import traitlets

from clothlab import artifacts, plots
from clothlab.analysis import principal_axes
from clothlab.arm import ARMS
from clothlab.cloth import CLOTHS, FOAMS
from clothlab.env import CONTROL_PERIOD
from clothlab.session import DRIVERS, LiveSession, Moment, mask_from_file
from clothlab.vision import HEIGHT, WIDTH

__all__ = ["LivePanel", "LiveView", "PBMap", "TargetCanvas"]

STATIC = Path(__file__).parent / "static"
HISTORY = 150  # steps that the traces show, 30 s
ELLIPSE_EVERY = 10  # steps; matplotlib takes a third of a step for it
PATIENCE = 5.0  # [s] without a sign from the browser, after which the page is taken to be closed
KNOWN_ERRORS = (ValueError, KeyError, OSError)  # what a person can do wrong; anything else is a fault of ours


class PBMap(anywidget.AnyWidget):
    """The plane of p after PCA. A click, or the arrow keys, sets `chosen`."""

    _esm = STATIC / "pb_map.js"
    materials = traitlets.List().tag(sync=True)  # of {name, at: [PC1, PC2]}
    reach = traitlets.Float(1.0).tag(sync=True)  # half of the width shown
    labels = traitlets.List(["PC1 of p", "PC2 of p"]).tag(sync=True)
    current = traitlets.List([0.0, 0.0]).tag(sync=True)
    trail = traitlets.List().tag(sync=True)
    chosen = traitlets.List(allow_none=True, default_value=None).tag(sync=True)


class TargetCanvas(anywidget.AnyWidget):
    """A target to draw on, 128×96. `shown` puts an image there; `drawn` is what a person made of it."""

    _esm = STATIC / "target_canvas.js"
    shown = traitlets.Bytes(b"").tag(sync=True)  # one byte a pixel, 0 or 1
    drawn = traitlets.Bytes(b"").tag(sync=True, from_json=lambda view, _: bytes(view))  # the browser sends a memoryview
    brush = traitlets.Float(4.0).tag(sync=True)  # radius [pixel]
    erase = traitlets.Bool(False).tag(sync=True)

    @property
    def mask(self) -> np.ndarray:
        """What was drawn, `[H, W]`, bool; empty before the first stroke."""
        if len(self.drawn) != HEIGHT * WIDTH:
            return np.zeros((HEIGHT, WIDTH), bool)
        return np.frombuffer(self.drawn, np.uint8).reshape(HEIGHT, WIDTH).astype(bool)


class LiveView(anywidget.AnyWidget):
    """Pictures and traces. The browser acknowledges each frame once it is drawn; until then none is sent."""

    _esm = STATIC / "live_view.js"
    scene = traitlets.Bytes(b"").tag(sync=True)  # JPEG
    seen = traitlets.Bytes(b"").tag(sync=True)  # PNG
    decoded = traitlets.Bytes(b"").tag(sync=True)  # PNG
    traces = traitlets.List().tag(sync=True)  # of {title, unit, lines: [{name, values}], marks, limit}
    frame = traitlets.Int(0).tag(sync=True)
    acknowledged = traitlets.Int(0).tag(sync=True)


class LivePanel:
    """Everything under one panel, in real time.

    Attributes:
        session: what is steered.
        errors: tracebacks of faults in callbacks, which a notebook's last cell raises with `check`.
        late: how many steps began more than half a period late.
        steps: how many steps were made since the panel was built.
    """

    _active: "LivePanel | None" = None

    def __init__(self, session: LiveSession | None = None):
        """Build it; an earlier panel of this kernel is closed.

        Args:
            session: a session; by default a new one with the torque arm.
        """
        if LivePanel._active is not None:
            LivePanel._active.close()
        LivePanel._active = self
        self.session = session or LiveSession()
        self.errors: list[str] = []
        self.late = self.steps = 0
        self._task: asyncio.Task | None = None
        self._shown_at = 0.0
        self._filling = False
        self._build()
        self._refill()

    # -- running ---------------------------------------------------------------------------------------------------

    @property
    def running(self) -> bool:
        """Whether time goes by."""
        return self._task is not None and not self._task.done()

    def start(self) -> None:
        """Let time go by, 5 steps a second."""
        if not self.running:
            self._task = asyncio.get_event_loop().create_task(self._run())

    def pause(self) -> None:
        """Stop time."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def step(self) -> None:
        """Make a single step."""
        self._advance(solve=True)
        self._show(force=True)

    def reset(self) -> None:
        """Let the cloth hang still again."""
        self.session.reset()
        self._history.clear()
        self._trail.clear()
        self._show(force=True)

    def close(self) -> None:
        """Leave nothing behind: no task, no widget, no OpenGL context."""
        self.pause()
        self.session.close()
        self.box.close()
        if LivePanel._active is self:
            LivePanel._active = None

    def check(self) -> None:
        """Raise if a callback has failed, so that a notebook that ran through unseen errors does not pass.

        Raises:
            RuntimeError: with the traceback of the first fault.
        """
        if self.errors:
            raise RuntimeError(f"{len(self.errors)} callbacks failed; the first:\n{self.errors[0]}")

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        due = self._shown_at = loop.time()
        while True:
            behind = loop.time() - due
            self.late += behind > CONTROL_PERIOD / 2
            if not self._guarded(self._advance)(solve=behind < CONTROL_PERIOD):
                return
            self._show()
            if loop.time() - self._shown_at > PATIENCE:
                self._say("paused: the page does not answer")
                return
            due = max(due + CONTROL_PERIOD, loop.time() - 2 * CONTROL_PERIOD)  # lost time is not made up for
            await asyncio.sleep(max(0.005, due - loop.time()))  # callbacks of the widgets run meanwhile

    def _advance(self, solve: bool) -> bool:
        moment = self.session.step(solve=solve)
        self._history.append(moment)
        self._trail.append(self._pca.transform(moment.p[None])[0].tolist())
        self.steps += 1
        return True

    # -- showing ---------------------------------------------------------------------------------------------------

    def _show(self, force: bool = False) -> None:
        """Send a frame, unless the browser has not drawn the last one yet: then this one is dropped."""
        view = self.view
        if view.acknowledged != view.frame and not force:
            return
        if self.running:
            self._shown_at = asyncio.get_event_loop().time()
        moment = self._history[-1] if self._history else None
        with view.hold_sync():
            view.scene = _encoded(".jpg", cv2.cvtColor(self.session.picture(), cv2.COLOR_RGB2BGR))
            if moment is not None:
                view.seen = _encoded(".png", moment.image * np.uint8(255))
                view.decoded = _encoded(".png", (255 * moment.reconstruction).astype(np.uint8))
            view.traces = self._traces(list(self._history))
            view.frame += 1
        if self.steps % ELLIPSE_EVERY == 0 or force:
            self._draw_ellipse()
        with self.map.hold_sync():
            self.map.current = self._pca.transform(self.session.p[None])[0].tolist()
            self.map.trail = list(self._trail)

    def _traces(self, history: list[Moment]) -> list[dict]:
        arm, shoulder_elbow = self.session.arm, ("shoulder", "elbow")
        marks = [k for k, moment in enumerate(history) if moment.step % 8 == 0]

        def lines(**values):
            return [{"name": name.replace("_", " "), "values": [float(v) for v in row]} for name, row in values.items()]

        traces = [
            {"title": "distance to the target", "unit": "s.d. of z", "lines": lines(z=[m.distance for m in history])}
        ]
        angles = {}
        for j, joint in enumerate(shoulder_elbow):
            angles[joint] = [m.theta[j] for m in history]
            angles[f"{joint}_ref"] = [m.command[j] for m in history]
        traces.append({"title": "joint angles", "unit": "rad", "lines": lines(**angles)})
        if arm.tension_slice.stop:
            tension = [m.command[2] for m in history]
            traces.append({"title": "stiffness command", "unit": "N", "lines": lines(f_const=tension)})
        milliseconds = [1e3 * m.seconds for m in history]
        traces.append({"title": "time a step took", "unit": "ms", "lines": lines(step=milliseconds), "limit": 200})
        return [{"marks": marks} | trace for trace in traces]

    def _say(self, text: str) -> None:
        self.message.value = text

    # -- building --------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        w, wide = ipywidgets, {"description_width": "110px"}
        self._history: deque[Moment] = deque(maxlen=HISTORY)
        self._trail: deque[list[float]] = deque(maxlen=HISTORY)
        self.view, self.map, self.canvas = LiveView(), PBMap(), TargetCanvas()
        self.message = w.Label()
        buttons = {name: w.Button(description=name) for name in ("start", "pause", "step", "reset")}
        for name, button in buttons.items():
            button.on_click(self._guarded(lambda _, name=name: getattr(self, name)()))
        self.buttons = buttons
        self.arm = self._dropdown("arm", ARMS, self._set_arm)
        self.driver = self._dropdown("driven by", DRIVERS, self.session.set_driver)
        self.cloth = self._dropdown("cloth", (), self._set_cloth)
        self.damping = w.FloatSlider(
            description="C_damp [N s/m]",
            min=0.01,
            max=0.10,
            step=0.005,
            readout_format=".3f",
            continuous_update=False,
            style=wide,
        )
        self.mass = w.FloatSlider(
            description="C_mass [kg]", min=0.03, max=0.20, step=0.01, continuous_update=False, style=wide
        )
        for slider in (self.damping, self.mass):
            slider.observe(self._guarded(self._change_material), "value")
        self.estimate = w.ToggleButton(description="estimate p online")
        self.estimate.observe(self._guarded(lambda change: setattr(self.session, "estimating", change["new"])), "value")
        self.map.observe(self._guarded(self._choose_p), "chosen")
        self.fixed = w.Checkbox(description="fix the stiffness")
        self.tension = w.FloatSlider(
            description="f_const [N]", min=10, max=70, value=30, step=5, continuous_update=False, style=wide
        )
        for control in (self.fixed, self.tension):
            control.observe(self._guarded(self._set_tension), "value")
        self.ellipse = w.Image(format="png", width=300)
        self.hands = w.VBox()
        self.target = self._dropdown("target", (), self._load_target)
        take, self.erase, clear = (
            w.Button(description="take this image"),
            w.ToggleButton(description="eraser"),
            w.Button(description="clear"),
        )
        take.on_click(self._guarded(lambda _: self._aim(self.session.observation["image"], show=True)))
        clear.on_click(self._guarded(lambda _: self._clear_canvas()))
        self.erase.observe(lambda change: setattr(self.canvas, "erase", change["new"]), "value")
        self.canvas.observe(self._guarded(lambda _: self._aim(self.canvas.mask)), "drawn")
        self.upload = w.FileUpload(accept="image/*", description="from a file")
        self.upload.observe(self._guarded(self._load_file), "value")
        self.understood = w.Image(width=WIDTH * 2, height=HEIGHT * 2, format="png")
        self.verdict = w.HTML()  # which breaks its lines
        self.name = w.Text(description="name", placeholder="my-swing")
        self.record = w.ToggleButton(description="record")
        self.record.observe(self._guarded(self._record), "value")
        save, discard = w.Button(description="save"), w.Button(description="discard")
        save.on_click(self._guarded(lambda _: self._save()))
        discard.on_click(self._guarded(lambda _: self._discard()))
        columns = [
            (
                "Target",
                [
                    self.target,
                    self.canvas,
                    w.HBox([take, self.upload]),
                    w.HBox([self.erase, clear]),
                    self.understood,
                    self.verdict,
                ],
            ),
            ("Material", [self.cloth, self.damping, self.mass, self.estimate, self.map]),
            ("Stiffness", [self.fixed, self.tension, self.ellipse]),
            ("Your own hand", [self.hands, self.name, w.HBox([self.record, save, discard])]),
        ]
        width = w.Layout(width="340px", margin="0 12px 12px 0")
        parts = [w.VBox([w.HTML(f"<b>{title}</b>"), *children], layout=width) for title, children in columns]
        top = w.HBox([*buttons.values(), self.arm, self.driver], layout=w.Layout(flex_flow="row wrap"))
        self.box = w.VBox([top, self.message, self.view, w.HBox(parts, layout=w.Layout(flex_flow="row wrap"))])

    def _dropdown(self, description, options, act: Callable) -> ipywidgets.Dropdown:
        dropdown = ipywidgets.Dropdown(description=description, options=list(options))
        dropdown.observe(self._guarded(lambda change: change["new"] is not None and act(change["new"])), "value")
        return dropdown

    def _refill(self) -> None:
        """Set every control to what the session has, without acting on it, and show it."""
        with self._unheard():
            self._copy_session()
        self._aim(self.session.target, show=True)
        self._show(force=True)

    def _copy_session(self) -> None:
        session, arm = self.session, self.session.arm
        self._pca = principal_axes(session.biases)
        places = {name: self._pca.transform(p[None])[0].tolist() for name, p in session.biases.items()}
        self.map.materials = [
            {"name": name.replace("damp", "").replace("mass", ""), "at": at} for name, at in places.items()
        ]
        self.map.reach = 1.5 * float(np.abs(list(places.values())).max())
        muscles = bool(arm.tension_slice.stop)
        self.arm.value, self.driver.value = arm.name, session.driver
        self.cloth.options = list(FOAMS if muscles else CLOTHS)
        self.cloth.value = session.env.cloth.name if session.env.cloth.name in self.cloth.options else None
        self.damping.value, self.mass.value = session.env.cloth.damping, session.env.cloth.mass
        self.damping.disabled = self.mass.disabled = muscles
        self.fixed.disabled = self.tension.disabled = not muscles
        self.fixed.value = False
        self.target.options = [None, *sorted(path.stem for path in (artifacts.DATA / "targets").glob("*.png"))]
        self.hands.children = [
            ipywidgets.FloatSlider(
                description=name,
                min=low,
                max=high,
                value=value,
                step=(high - low) / 100,
                continuous_update=False,
                style={"description_width": "140px"},
            )
            for name, low, high, value in zip(
                arm.command_names, arm.command_lower, arm.command_upper, session.hand, strict=True
            )
        ]
        for slider in self.hands.children:
            slider.observe(
                self._guarded(lambda _: session.set_hand([each.value for each in self.hands.children])), "value"
            )

    # -- acting ----------------------------------------------------------------------------------------------------

    @contextmanager
    def _unheard(self) -> Iterator[None]:
        """Set controls without acting on it, as when they follow the session."""
        self._filling = True
        try:
            yield
        finally:
            self._filling = False

    def _guarded(self, act: Callable) -> Callable:
        """Show a person's mistake as a message; keep a fault of ours for `check`. The panel lives on after both."""

        def guarded(*arguments, **options):
            if self._filling:
                return None
            try:
                return act(*arguments, **options)
            except KNOWN_ERRORS as error:
                self._say(f"⚠ {error.args[0] if isinstance(error, KeyError) else error}")
            except Exception:
                self.errors.append(traceback.format_exc())
                self._say(f"✗ a fault in the panel: {self.errors[-1].splitlines()[-1]}")
            return None

        return guarded

    def _set_arm(self, name: str) -> None:
        try:
            self.session.set_arm(name)
        finally:  # where that failed, the controls go back to the arm that is still there
            self._history.clear()
            self._trail.clear()
            self._refill()

    def _set_cloth(self, name: str) -> None:
        self.session.set_cloth(name)
        with self._unheard():
            self.damping.value, self.mass.value = self.session.env.cloth.damping, self.session.env.cloth.mass

    def _change_material(self, _) -> None:
        self.session.set_material(self.damping.value, self.mass.value)
        with self._unheard():
            self.cloth.value = None

    def _choose_p(self, change) -> None:
        self.session.set_p(self._pca.inverse_transform(np.array(change["new"])[None])[0])
        self.map.current = change["new"]

    def _set_tension(self, _) -> None:
        self.session.set_tension(self.tension.value if self.fixed.value else None)
        self._draw_ellipse()

    def _draw_ellipse(self) -> None:
        """The stiffness ellipse of the present command, drawn 10 times as large as 1 N makes it."""
        arm, history = self.session.arm, self._history
        if not arm.tension_slice.stop:
            self.ellipse.value = b""
            return
        u = history[-1].command if history else self.session.hand
        f_const = self.tension.value if self.fixed.value else u[2]
        figure = plots.ellipse_at_hand(arm, u[:2], f_const)
        file = io.BytesIO()
        figure.savefig(file, dpi=75)
        self.ellipse.value = file.getvalue()

    def _load_target(self, name: str) -> None:
        self._aim(artifacts.load_target(name), show=True)

    def _load_file(self, change) -> None:
        if change["new"]:
            self._aim(mask_from_file(bytes(change["new"][0]["content"])), show=True)

    def _aim(self, mask: np.ndarray, show: bool = False) -> None:
        reconstruction, distance = self.session.set_target(mask)
        if show:
            self.canvas.shown = np.asarray(mask, np.uint8).tobytes()
        self.understood.value = _encoded(".png", (255 * reconstruction).astype(np.uint8))
        self.verdict.value = f"what the network believes it was shown, {distance:.2f} s.d. of z from it"
        self._say("")

    def _clear_canvas(self) -> None:
        self.canvas.shown = b""
        self.canvas.shown = bytes(HEIGHT * WIDTH)

    def _record(self, change) -> None:
        if change["new"] and not self.session.recording:
            try:
                self.session.record()
            except FileExistsError:
                self._release_record()
                raise
            self._say("recording")

    def _save(self) -> None:
        path = self.session.save_recording(self.name.value)
        self._release_record()
        self._say(f"saved as {path.name}")

    def _discard(self) -> None:
        self.session.discard_recording()
        self._release_record()
        self._say("discarded")

    def _release_record(self) -> None:
        with self._unheard():
            self.record.value = False

    def _ipython_display_(self) -> None:
        from IPython.display import display

        display(self.box)


def _encoded(kind: str, picture: np.ndarray) -> bytes:
    return cv2.imencode(kind, picture)[1].tobytes()
