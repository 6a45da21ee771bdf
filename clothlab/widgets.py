"""The live panel: a thin layer of widgets over `clothlab.session.LiveSession`."""

import asyncio
import io
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import anywidget
import cv2
import ipywidgets
import numpy as np
import traitlets
from sklearn.decomposition import PCA

from clothlab import plots
from clothlab.analysis import principal_axes
from clothlab.arm import ARMS, JOINTS
from clothlab.cloth import CLOTHS, FOAMS
from clothlab.control import ControlSettings
from clothlab.env import CONTROL_PERIOD
from clothlab.session import DRIVERS, LiveSession, Moment, mask_from_file
from clothlab.vision import HEIGHT, WIDTH

__all__ = ["LivePanel", "LiveView", "PBMap", "TargetCanvas"]

STATIC = Path(__file__).parent / "static"
PERIOD = ControlSettings().period
HISTORY = 150  # steps that the traces show, 30 s
ELLIPSE_EVERY = 5  # steps; matplotlib takes a third of a step for it
STICKS, TRIGGER = (1, 3), 7  # the standard gamepad's vertical axes and its right trigger
STICK_MOVES = 0.05  # by how much a stick must move to take over; at rest it trembles
PATIENCE = 25  # steps without a sign from the browser, after which the page is taken to be closed
NARROW = {"width": "70px"}
KNOWN_ERRORS = (ValueError, KeyError, OSError)  # what a person can do wrong; anything else is a fault of ours


class PBMap(anywidget.AnyWidget):
    """The plane of p after PCA. A click, or the arrow keys, sets `chosen` [PC1, PC2]."""

    _esm = STATIC / "pb_map.js"
    materials = traitlets.List().tag(sync=True)  # of {name, at: [PC1, PC2]}
    held = traitlets.Unicode("").tag(sync=True)  # name of the material in the hand, if it is one of them
    reach = traitlets.Float(1.0).tag(sync=True)  # half of the width shown
    labels = traitlets.List(["PC1 of p", "PC2 of p"]).tag(sync=True)
    current = traitlets.List([0.0, 0.0]).tag(sync=True)
    trail = traitlets.List().tag(sync=True)
    chosen = traitlets.List(allow_none=True, default_value=None).tag(sync=True)

    def show(self, biases: dict[str, np.ndarray]) -> PCA:
        """Put the trained materials there, `{name: p [D_p]}`, and return the axes of the map."""
        axes = principal_axes(biases)
        places = {name: axes.transform(p[None])[0].tolist() for name, p in biases.items()}
        self.reach = 1.3 * float(np.abs(list(places.values())).max())
        self.materials = [{"name": name, "at": at} for name, at in places.items()]
        return axes


class TargetCanvas(anywidget.AnyWidget):
    """A target to draw on, 128×96, with a gallery below. `drawn` is what a person made of what was `shown`."""

    _esm = STATIC / "target_canvas.js"
    shown = traitlets.Bytes(b"").tag(sync=True)  # one byte a pixel, 0 or 1
    drawn = traitlets.Bytes(b"").tag(sync=True, from_json=lambda view, _: bytes(view))  # the browser sends a memoryview
    brush = traitlets.Float(4.0).tag(sync=True)  # radius [pixel]
    erase = traitlets.Bool(False).tag(sync=True)
    gallery = traitlets.List().tag(sync=True)  # of {name, image: one byte a pixel}; a click sends {picked: name}

    @property
    def mask(self) -> np.ndarray:
        """What was drawn, `[H, W]`, bool; empty before the first stroke."""
        if len(self.drawn) != HEIGHT * WIDTH:
            return np.zeros((HEIGHT, WIDTH), bool)
        return np.frombuffer(self.drawn, np.uint8).reshape(HEIGHT, WIDTH).astype(bool)

    def show(self, mask: np.ndarray) -> None:
        """Put an image `[H, W]` there."""
        self.shown = b""  # an image that was shown before and drawn over would otherwise not be sent again
        self.shown = _pixels(mask)


class LiveView(anywidget.AnyWidget):
    """Pictures and traces. The browser acknowledges each frame once it is drawn; until then none is sent.

    Attributes:
        acknowledged: number of the last frame that was drawn. It comes as a message and not as a trait, because
            JupyterLab delivers it in a thread of its own, where it would meddle with the traits that are being set.
    """

    _esm = STATIC / "live_view.js"
    scene = traitlets.Bytes(b"").tag(sync=True)  # JPEG
    seen = traitlets.Bytes(b"").tag(sync=True)  # PNG
    decoded = traitlets.Bytes(b"").tag(sync=True)  # PNG
    traces = traitlets.List().tag(sync=True)  # of {title, unit, lines: [{name, values}], marks, limit}
    clock = traitlets.Unicode("").tag(sync=True)
    frame = traitlets.Int(0).tag(sync=True)

    def __init__(self):
        """Nothing was shown yet."""
        super().__init__()
        self.acknowledged = 0
        self.on_msg(lambda _, content, __: setattr(self, "acknowledged", content["drawn"]))


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
        self._thread = threading.get_ident()
        try:
            self._loop = asyncio.get_running_loop()
        except RuntimeError:  # outside a notebook; then no other thread calls us either
            self._loop = None
        self.session = session or LiveSession()
        self.errors: list[str] = []
        self.late = self.steps = 0
        self._task: asyncio.Task | None = None
        self._unseen = 0  # steps since the last frame was sent
        self._sticks: np.ndarray | None = None
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
            self._show(force=True)  # a page that was reloaded has not drawn the last one
            self._task = asyncio.get_running_loop().create_task(self._run())

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
        self._forget()
        self._show(force=True)

    def close(self) -> None:
        """Leave nothing behind: no task, no widget, no OpenGL context."""
        self.pause()
        self.session.close()
        _close(self.box)
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
        due, self._unseen = loop.time(), 0
        while True:
            behind = loop.time() - due
            self.late += behind > CONTROL_PERIOD / 2
            if not self._guarded(self._tick)(solve=behind < CONTROL_PERIOD):
                return
            if self._unseen > PATIENCE:
                self._say("paused: the page does not answer")
                return
            due = max(due + CONTROL_PERIOD, loop.time() - 2 * CONTROL_PERIOD)  # lost time is not made up for
            await asyncio.sleep(max(0.005, due - loop.time()))  # callbacks of the widgets run meanwhile

    def _tick(self, solve: bool) -> bool:
        self._advance(solve)
        self._show()
        return True

    def _advance(self, solve: bool) -> None:
        self._read_gamepad()
        moment = self.session.step(solve=solve)
        self._history.append(moment)
        self._trail.append(self._axes.transform(moment.p[None])[0].tolist())
        self.steps += 1
        self._unseen += 1

    # -- showing ---------------------------------------------------------------------------------------------------

    def _show(self, force: bool = False) -> None:
        """Send a frame, unless the browser has not drawn the last one yet: then this one is dropped."""
        view = self.view
        if view.acknowledged != view.frame and not force:
            return
        self._unseen = 0
        moment = self._history[-1] if self._history else None
        with view.hold_sync():
            view.scene = _encoded(".jpg", cv2.cvtColor(self.session.picture(), cv2.COLOR_RGB2BGR))
            if moment is not None:
                view.seen = _encoded(".png", moment.image * np.uint8(255))
                view.decoded = _encoded(".png", (255 * moment.reconstruction).astype(np.uint8))
            view.traces = self._traces(list(self._history))
            step = self.session.step_number
            view.clock = f"{step * CONTROL_PERIOD:.1f} s, step {step}"
            view.frame += 1
        if self.steps % ELLIPSE_EVERY == 0 or force:
            self._draw_ellipse()
        with self.map.hold_sync():
            self.map.current = self._axes.transform(self.session.p[None])[0].tolist()
            self.map.trail = list(self._trail)

    def _traces(self, history: list[Moment]) -> list[dict]:
        marks = [k for k, moment in enumerate(history) if moment.step % PERIOD == 0]

        def trace(title: str, unit: str, lines: dict, limit: float | None = None) -> dict:
            lines = [{"name": name, "values": [float(v) for v in values]} for name, values in lines.items()]
            return {"title": title, "unit": unit, "lines": lines, "marks": marks, "limit": limit}

        angles = {}
        for j, joint in enumerate(JOINTS):
            angles |= {joint: [m.theta[j] for m in history], f"{joint} ref": [m.command[j] for m in history]}
        traces = [
            trace("distance to the target", "s.d. of z", {"z": [m.distance for m in history]}),
            trace("joint angles", "rad", angles),
        ]
        if self.session.arm.tension_slice.stop:
            traces.append(trace("stiffness command", "N", {"f_const": [m.command[2] for m in history]}))
        milliseconds = [1e3 * m.seconds for m in history]
        return [*traces, trace("time a step took", "ms", {"step": milliseconds}, 1e3 * CONTROL_PERIOD)]

    def _say(self, text: str) -> None:
        self.message.value = text

    # -- building --------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        w = ipywidgets
        self._history: deque[Moment] = deque(maxlen=HISTORY)
        self._trail: deque[list[float]] = deque(maxlen=HISTORY)
        self.view, self.message = LiveView(), w.Label()
        self.buttons = {name: self._button(name, getattr(self, name)) for name in ("start", "pause", "step", "reset")}
        self.arm = self._dropdown("arm", ARMS, self._set_arm)
        self.driver = self._dropdown("driven by", DRIVERS, self.session.set_driver)
        head = w.HBox([*self.buttons.values(), self.arm, self.driver])
        columns = [
            w.VBox(children, layout=w.Layout(width="338px", margin="8px 6px 0 0"))
            for children in (
                [w.HTML("<b>Target</b>"), *self._build_target()],
                [w.HTML("<b>Material</b>"), *self._build_material()],
                [
                    w.HTML("<b>Stiffness</b>"),
                    *self._build_stiffness(),
                    w.HTML("<b>Your own hand</b>"),
                    *self._build_hand(),
                ],
            )
        ]
        self.box = w.VBox([head, self.message, self.view, w.HBox(columns, layout=w.Layout(flex_flow="row wrap"))])

    def _build_target(self) -> list[ipywidgets.Widget]:
        w = ipywidgets
        self.canvas = TargetCanvas()
        self.canvas.observe(self._acting(lambda _: self._aim(self.canvas.mask)), "drawn")
        pick = self._acting(lambda name: self._aim(self.session.gallery[name], show=True))
        self.canvas.on_msg(lambda _, content, __: pick(content["picked"]))
        self.erase = w.ToggleButton(description="eraser", layout=NARROW)
        short = {"style": {"description_width": "90px"}, "layout": {"width": "250px"}}
        self.brush = self._slider("brush [pixel]", 1, 12, 1, 4, **short)
        w.jslink((self.erase, "value"), (self.canvas, "erase"))  # in the browser, so that the next stroke has it
        w.jslink((self.brush, "value"), (self.canvas, "brush"))
        clear = self._button("clear", self._clear_canvas)
        take = self._button("take this image", lambda: self._aim(self.session.observation["image"], show=True))
        take.layout.width = "130px"
        self.upload = w.FileUpload(accept="image/*", description="from a file", layout=w.Layout(width="130px"))
        self.upload.observe(self._acting(self._load_file), "value")
        self.understood = w.Image(format="png", layout=w.Layout(width="160px", height="120px", flex="none"))
        self.verdict = w.HTML(layout=w.Layout(width="170px"))  # which breaks its lines
        tools = [w.HBox([self.erase, self.brush]), w.HBox([take, self.upload, clear])]
        return [self.canvas, *tools, w.HBox([self.understood, self.verdict])]

    def _build_material(self) -> list[ipywidgets.Widget]:
        self.cloth = self._dropdown("cloth", (), self._set_cloth)
        self.damping = self._slider("C_damp [N s/m]", 0.01, 0.10, 0.005, 0.05, readout_format=".3f")
        self.mass = self._slider("C_mass [kg]", 0.03, 0.20, 0.01, 0.10)
        for slider in (self.damping, self.mass):
            slider.observe(self._acting(self._change_material), "value")
        self.estimate = ipywidgets.ToggleButton(description="estimate p online")
        self.estimate.observe(self._acting(lambda change: setattr(self.session, "estimating", change["new"])), "value")
        self.map = PBMap()
        self.map.observe(self._acting(self._choose_p), "chosen")
        return [self.cloth, self.damping, self.mass, self.estimate, self.map]

    def _build_stiffness(self) -> list[ipywidgets.Widget]:
        self.fixed = ipywidgets.Checkbox(description="fix the stiffness", indent=False)
        self.tension = self._slider("f_const [N]", 10, 70, 5, 30)
        for control in (self.fixed, self.tension):
            control.observe(self._acting(self._set_tension), "value")
        self.ellipse = ipywidgets.Image(format="png", width=270)
        return [self.fixed, self.tension, self.ellipse]

    def _build_hand(self) -> list[ipywidgets.Widget]:
        w = ipywidgets
        self.hands, self.gamepad = w.VBox(), w.Controller(index=0)
        self.name = w.Text(description="name", placeholder="my-swing")
        self.record = w.ToggleButton(description="record", layout=NARROW)
        self.record.observe(self._acting(self._record), "value")
        save, discard = self._button("save", self._save), self._button("discard", self._discard)
        self.gamepad.observe(self._acting(self._greet_gamepad), "axes")
        # The message shows here, too: on a small screen its place at the top is out of sight.
        return [self.hands, self.gamepad, self.name, w.HBox([self.record, save, discard]), self.message]

    def _button(self, description: str, act: Callable[[], None]) -> ipywidgets.Button:
        button = ipywidgets.Button(description=description, layout=NARROW)
        button.on_click(self._acting(lambda _: act()))
        return button

    def _dropdown(self, description: str, options: Iterable[str], act: Callable[[str], None]) -> ipywidgets.Dropdown:
        dropdown = ipywidgets.Dropdown(description=description, options=list(options), layout={"width": "260px"})
        dropdown.observe(self._acting(lambda change: change["new"] is not None and act(change["new"])), "value")
        return dropdown

    def _slider(self, description: str, low: float, high: float, step: float, value: float, **options):
        """A slider that acts on release."""
        style, layout = {"description_width": "135px"}, {"width": "325px"}
        options = {"continuous_update": False, "style": style, "layout": layout} | options
        return ipywidgets.FloatSlider(value, description=description, min=low, max=high, step=step, **options)

    def _refill(self) -> None:
        """Set every control to what the session has, without acting on it, and show it."""
        with self._unheard():
            self._copy_session()
        self._aim(self.session.target, show=True)
        self._show(force=True)

    def _copy_session(self) -> None:
        session, arm = self.session, self.session.arm
        self._axes = self.map.show(session.biases)
        muscles = bool(arm.tension_slice.stop)
        self.arm.value, self.driver.value = arm.name, session.driver
        self.cloth.options = list(FOAMS if muscles else CLOTHS)
        self._follow_cloth()
        self.damping.disabled = self.mass.disabled = muscles
        self.fixed.disabled = self.tension.disabled = not muscles
        self.ellipse.layout.display = None if muscles else "none"
        self.fixed.value = False
        self.canvas.gallery = [{"name": name, "image": _pixels(mask)} for name, mask in session.gallery.items()]
        # These act while they are dragged: a step takes the last value and skips those before.
        self.hands.children = [
            self._slider(name, low, high, (high - low) / 100, value, continuous_update=True)
            for name, low, high, value in zip(
                arm.command_names, arm.command_lower, arm.command_upper, session.hand, strict=True
            )
        ]
        for k, slider in enumerate(self.hands.children):
            slider.observe(partial(self._move_hand, k), "value")

    # -- acting ----------------------------------------------------------------------------------------------------

    @contextmanager
    def _unheard(self) -> Iterator[None]:
        """Set controls without acting on it, as when they follow the session."""
        before, self._filling = self._filling, True
        try:
            yield
        finally:
            self._filling = before

    def _guarded(self, act: Callable) -> Callable:
        """Show a person's mistake as a message; keep a fault of ours for `check`. The panel lives on after both."""

        def guarded(*arguments, **options):
            try:
                return act(*arguments, **options)
            except KNOWN_ERRORS as error:
                self._say(f"⚠ {error.args[0] if isinstance(error, KeyError) else error}")
            except Exception:
                self.errors.append(traceback.format_exc())
                self._say(f"✗ a fault in the panel: {self.errors[-1].splitlines()[-1]}")
            return None

        return guarded

    def _acting(self, act: Callable) -> Callable:
        """Guard a callback of a control: it does not hear the panel, and what it says replaces the last message.

        JupyterLab may call it in a thread of its own, in the middle of a step: it then waits for the end of the step.
        """
        guarded = self._guarded(act)

        def acting(event) -> None:
            self._say("")
            guarded(event)

        def heard(event) -> None:
            if threading.get_ident() != self._thread:
                self._loop.call_soon_threadsafe(acting, event)
            elif not self._filling:
                acting(event)

        return heard

    def _set_arm(self, name: str) -> None:
        try:
            self.session.set_arm(name)
        finally:  # where that failed, the controls go back to the arm that is still there
            self._forget()
            self._refill()

    def _forget(self) -> None:
        self._history.clear()
        self._trail.clear()
        self._sticks = None

    def _set_cloth(self, name: str) -> None:
        try:
            self.session.set_cloth(name)
        finally:
            self._follow_cloth()

    def _change_material(self, _) -> None:
        try:
            self.session.set_material(self.damping.value, self.mass.value)
        finally:
            self._follow_cloth()

    def _follow_cloth(self) -> None:
        cloth = self.session.env.cloth
        with self._unheard():
            self.cloth.value = cloth.name if cloth.name in self.cloth.options else None
            self.damping.value, self.mass.value = cloth.damping, cloth.mass
        self.map.held = cloth.name

    def _choose_p(self, change) -> None:
        self.session.set_p(self._axes.inverse_transform(np.array(change["new"])[None])[0])
        self.map.current = change["new"]

    def _set_tension(self, _) -> None:
        self.session.set_tension(self.tension.value if self.fixed.value else None)
        self._draw_ellipse()

    def _draw_ellipse(self) -> None:
        """The stiffness ellipse of the present command, drawn 10 times as large as 1 N makes it."""
        arm, history = self.session.arm, self._history
        if not arm.tension_slice.stop:
            return
        u = history[-1].command if history else self.session.hand
        f_const = self.tension.value if self.fixed.value else u[2]
        figure = plots.ellipse_at_hand(arm, u[:2], f_const)
        file = io.BytesIO()
        figure.savefig(file, dpi=75)
        self.ellipse.value = file.getvalue()

    def _load_file(self, change) -> None:
        content = bytes(change["new"][0]["content"])
        with self._unheard():
            self.upload.value = ()  # the same file can then be chosen again
        self._aim(mask_from_file(content), show=True)

    def _aim(self, mask: np.ndarray, show: bool = False) -> None:
        reconstruction, distance = self.session.set_target(mask)
        if show:
            self.canvas.show(mask)
        self.understood.value = _encoded(".png", (255 * reconstruction).astype(np.uint8))
        usual = self.session.usual_distance
        verdict = "It knows such cloths." if distance <= usual else "<b>It knows no such cloth.</b>"
        believed = f"{distance:.1f} pixel from it" if np.isfinite(distance) else "no cloth at all"
        self.verdict.value = (
            f"<p style='line-height:1.3'>What the network believes it was shown: {believed} (chamfer distance; "
            f"{usual:.1f} for the worst in a hundred recorded images). {verdict}</p>"
        )

    def _clear_canvas(self) -> None:
        self.canvas.show(np.zeros((HEIGHT, WIDTH), bool))
        self._say("draw a target; until then the robot keeps the one that it has")

    def _move_hand(self, k: int, change) -> None:
        if abs(change["new"] - self.session.hand[k]) > change["owner"].step / 2:  # less is the browser's rounding
            self._acting(lambda _: self._take_over())(change)

    def _take_over(self) -> None:
        """Drive by hand, with the commands that the sliders show."""
        self.session.set_hand([slider.value for slider in self.hands.children])
        self.driver.value = "hand"

    def _greet_gamepad(self, _) -> None:
        trigger = ", right trigger: stiffness" if self.session.arm.tension_slice.stop else ""
        enough = len(self.gamepad.axes) > max(STICKS) and len(self.gamepad.buttons) > TRIGGER
        self._say(
            f"gamepad: left stick: shoulder, right stick: elbow{trigger}" if enough else "⚠ a gamepad needs two sticks"
        )

    def _read_gamepad(self) -> None:
        """Take over when a stick has moved. Read once a step, so that its many small changes do not pile up."""
        axes, buttons = self.gamepad.axes, self.gamepad.buttons
        if not self.gamepad.connected or len(axes) <= max(STICKS) or len(buttons) <= TRIGGER:
            return
        places = [*((axes[k].value + 1) / 2 for k in STICKS), buttons[TRIGGER].value][: len(self.hands.children)]
        sticks, before = np.array(places), self._sticks
        if before is not None and np.abs(sticks - before).max() < STICK_MOVES:
            return
        self._sticks = sticks
        if before is None:  # where they rest
            return
        with self._unheard():
            for slider, place in zip(self.hands.children, places, strict=True):
                slider.value = slider.min + place * (slider.max - slider.min)
        self._take_over()

    def _record(self, change) -> None:
        if not change["new"]:
            self.session.stop_recording()
            self._say("stopped: give it a name and save it, or discard it")
            return
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


def _close(widget: ipywidgets.Widget) -> None:
    """Close a widget and what it contains, which ipywidgets would keep for as long as the kernel lives."""
    for child in getattr(widget, "children", ()):
        _close(child)
    widget.close()


def _pixels(mask: np.ndarray) -> bytes:
    return np.asarray(mask, np.uint8).tobytes()


def _encoded(kind: str, picture: np.ndarray) -> bytes:
    return cv2.imencode(kind, picture)[1].tobytes()
