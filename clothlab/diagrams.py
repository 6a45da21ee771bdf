"""Drawings of notebooks: the method, a muscle pair, the muscle arm, the memory.

Nothing is computed here. A drawing is measured in inches on a white sheet, so that it
is read on a dark page, too, and its letters from the last row. What it shows in words
stands in the label of its axes, from which `_alt_text` takes it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from matplotlib.text import Text

from clothlab._validation import choose
from clothlab.plots import COLOURS, new_axes
from clothlab.simulation.muscle import Muscles

_INK = "#222222"
_GREY = "#767676"  # what stays as it is
_ORANGE = COLOURS[1]  # what moves, and the gradient that moves it
_BLUE = COLOURS[0]
_GREEN = COLOURS[2]
_PURPLE = "#A8487F"  # of `COLOURS[3]`, dark enough for letters
_SMALL = 12  # points, of the smallest letters on a sheet ten inches wide

# What moves in each task, and the sentence below the picture.
_TASKS: dict[str, tuple[tuple[str, ...], str]] = {
    "W": (
        ("W", "p"),
        "Training: $W$, and one $p$ for each cloth, move. "
        "The loss counts all steps, all sensors, all runs.",
    ),
    "p": (
        ("p",),
        "Estimation: only $p$ moves. "
        "The loss counts a window of the last steps, all sensors.",
    ),
    "u": (
        ("u",),
        "Control: only $u$ moves. "
        "The loss counts the image at the period's end, and tension.",
    ),
}
_ALL = "One network $h$, two losses. Three tasks differ in what moves."


def method(lit: str | None = None) -> Figure:
    """The whole method: camera image → z; s, u, p → h, step after step → loss.

    Without `lit`, it shows what all tasks share, and leaves open which predictions are
    compared, with what, and what the next step is fed.
    With `lit`, what one task moves is orange, all else is grey, and the gradient's way
    from the loss to it is dashed: "W" is training (which moves p, too), "p" estimation,
    "u" control.
    """
    task = ((), _ALL) if lit is None else choose("quantity to light", lit, _TASKS)
    moves, caption = task
    sheet = _Sheet(10.0, 5.4, _about_method(lit, moves))
    look = _Look(lit, moves)

    _draw_eye(sheet, look)
    for k, x in enumerate(_PLACES):
        _draw_step(sheet, look, k, x)
    _draw_bias(sheet, look)
    _draw_loss(sheet, look)
    if lit is not None:
        _draw_gradient(sheet, look)
    sheet.write(5.0, 0.16, caption, color=_ORANGE if lit else _INK)
    return sheet.figure


def muscle_pair() -> Figure:
    """One joint and its two muscles, each a motor, a wire and a spring."""
    about = (
        "A link that turns about a joint by the angle θ, downwards, and two wires over "
        "its pulley of radius r: the flexor's above, the extensor's below, each from a "
        "motor through a spring"
    )
    sheet = _Sheet(10.0, 3.4, about)
    _draw_joint(sheet)
    _draw_muscle(sheet, "flexor", 2.6, _BLUE)
    _draw_muscle(sheet, "extensor", 0.8, _ORANGE)
    return sheet.figure


def muscle_arm() -> Figure:
    """The arm with two joints and six muscles, and where the signs of G come from."""
    about = (
        "An arm with shoulder and elbow, a cloth in its hand, and six springs, each "
        "with a motor: flexors pass above a joint (G positive), extensors below it "
        "(G negative), two pairs pass one joint, one pair both"
    )
    sheet = _Sheet(10.0, 5.4, about)
    _draw_links(sheet)
    for name in _PAIRS:
        _draw_pair(sheet, name)
    _write_arms(sheet)
    return sheet.figure


def unrolled() -> Figure:
    """Memory over time: fed with what was seen, above, or with its own predictions."""
    about = (
        "The network over four steps, its memory handed on. Teacher forcing, above: "
        "each step is fed the state that was seen. Closed loop, below: its own "
        "prediction. Sketches: the error stays that of one step, or is open"
    )
    sheet = _Sheet(10.0, 5.4, about)
    _draw_row(sheet, 3.6, "Teacher forcing: each step is fed what was seen", True)
    _draw_row(sheet, 0.95, "Closed loop: each step is fed its own prediction", False)
    note = "Commands $u$ and $p$ go into each $h$, too, and are left out here."
    sheet.write(0.3, 0.16, note, ha="left", color=_GREY)
    return sheet.figure


class _Sheet:
    """White paper, measured in inches from its lower left corner."""

    def __init__(self, width: float, height: float, about: str):
        self.figure, axes = new_axes(size=(width, height))
        self.figure.set_layout_engine("none")
        self.figure.set_facecolor("white")
        self.ax = axes[0, 0]
        self.ax.set_position((0.0, 0.0, 1.0, 1.0))
        self.ax.set(xlim=(0, width), ylim=(0, height), label=about)
        self.ax.set_axis_off()

    def write(self, x: float, y: float, text: str, **look: Any) -> Text:
        """Text around a place."""
        style = {"ha": "center", "va": "center", "fontsize": _SMALL, "color": _INK}
        return self.ax.text(x, y, text, **(style | look))

    def box(
        self, x: float, y: float, size: tuple[float, float], text: str, **look: Any
    ) -> None:
        """A box around a place with a text in it."""
        colour = look.get("color", _INK)
        width, height = size
        corner = (x - width / 2, y - height / 2)
        style = {"facecolor": look.get("fill", "white"), "edgecolor": colour}
        style |= {"linewidth": look.get("lw", 1.5), "gid": look.get("gid")}
        self.ax.add_patch(Rectangle(corner, width, height, zorder=2, **style))
        letters = {"color": colour, "gid": look.get("gid"), "zorder": 3}
        self.write(x, y, text, fontsize=look.get("fontsize", 15), **letters)

    def arrow(self, start: tuple, end: tuple, **look: Any) -> None:
        """A straight arrow, or with `bend` a bent one."""
        bend = f"arc3,rad={look.pop('bend', 0)}"
        style: dict[str, Any] = {"color": _INK, "lw": 1.5, "arrowstyle": "-|>"}
        style["zorder"] = 1
        style |= {"mutation_scale": 14, "shrinkA": 0, "shrinkB": 0} | look
        self.ax.add_patch(FancyArrowPatch(start, end, connectionstyle=bend, **style))

    def line(self, points: Sequence[tuple], **look: Any) -> None:
        """Straight lines from point to point."""
        x, y = np.transpose(points)
        style = {"color": _INK, "lw": 1.5, "zorder": 1}
        self.ax.plot(x, y, **(style | look))


# The method

_PLACES = (4.4, 6.2, 8.0)  # of the three steps
_COMMANDS = 1.7  # heights
_NETWORK = 2.8
_PREDICTED = 3.9
_COMPARED = 4.42
_WANTED = 4.94
_BIAS = 0.95
_LOSS = 9.45  # places
_STATE = 2.7


class _Look:
    """How each quantity is drawn while one of them is lit."""

    def __init__(self, lit: str | None, moves: Sequence[str]):
        self.lit = lit
        self.moves = moves

    def of(self, name: str) -> dict[str, Any]:
        """Colours of a quantity: orange where it moves, grey where another does."""
        if name in self.moves:
            return {"color": _ORANGE, "fill": "#FBE6D9", "lw": 3.0, "gid": name}
        return {"color": self.rest, "gid": name}

    @property
    def rest(self) -> str:
        """The colour of all that is no quantity to move."""
        return _GREY if self.moves else _INK

    @property
    def counts(self) -> tuple[int, ...]:
        """Steps whose prediction the loss compares."""
        return (2,) if self.lit == "u" else (0, 1, 2)

    @property
    def closed(self) -> bool:
        """Whether a prediction is fed into the next step."""
        return self.lit == "u"


def _about_method(lit: str | None, moves: Sequence[str]) -> str:
    """The picture in words."""
    chain = (
        "The method: camera image, autoencoder, z; state (z, robot), command u and "
        "parametric bias p go into the network h with weights W, step after step; "
        "predictions are compared in a loss"
    )
    if lit is None:
        return chain
    return f"{chain}. Orange: {' and '.join(moves)}, and the gradient's way to it"


def _draw_eye(sheet: _Sheet, look: _Look) -> None:
    """From the camera, and what the robot feels, to the state."""
    colour = look.rest
    # The camera's binary image of a cloth
    frame: dict[str, Any] = {"facecolor": "black", "edgecolor": colour}
    sheet.ax.add_patch(Rectangle((0.3, 3.95), 1.3, 0.98, **frame))
    x = [0.78, 1.1, 1.18, 1.36, 1.22, 1.02, 0.86, 0.72]
    y = [4.72, 4.66, 4.5, 4.22, 4.08, 4.2, 4.12, 4.38]
    sheet.ax.fill(x, y, color="white", zorder=2)
    sheet.write(0.95, 5.12, "camera", color=colour)

    # The autoencoder, wide where the image comes in
    sheet.arrow((0.95, 3.93), (0.95, 3.5), color=colour)
    edges = [(0.3, 3.48), (1.6, 3.48), (1.3, 2.72), (0.6, 2.72), (0.3, 3.48)]
    sheet.line(edges, color=colour)
    sheet.write(0.95, 3.26, "autoencoder", color=colour)
    sheet.write(0.95, 2.93, "$z_t$", color=colour, fontsize=15)

    # Beside it, what the robot feels
    sheet.write(0.95, 1.85, "robot: joints\nor muscles", color=colour)
    sheet.arrow((1.5, 3.05), (2.36, 3.05), color=colour)
    sheet.arrow((1.6, 1.95), (2.4, 2.8), color=colour)
    sheet.box(_STATE, 3.05, (0.64, 0.46), "$s_t$", color=colour)
    sheet.write(_STATE, 3.42, "state", color=colour)
    sheet.arrow((_STATE + 0.34, 3.05), (_PLACES[0] - 0.52, 3.05), color=colour)


def _draw_step(sheet: _Sheet, look: _Look, k: int, x: float) -> None:
    """The network in one step, what goes in and what comes out."""
    colour = look.rest
    after = f"t+{k + 1}"
    # The network with its weights, and the command below it
    sheet.box(x, _NETWORK, (1.0, 0.95), "", **look.of("W"))
    sheet.write(x - 0.2, _NETWORK + 0.08, "$h$", fontsize=20, color=colour, zorder=3)
    weights = {"fontsize": 14, "color": look.of("W")["color"], "gid": "W"}
    sheet.write(x + 0.26, _NETWORK - 0.24, "$W$", zorder=3, **weights)
    command = f"$u_{{t+{k}}}$" if k else "$u_t$"
    sheet.box(x - 0.2, _COMMANDS, (0.66, 0.44), command, **look.of("u"))
    sheet.arrow((x - 0.2, _COMMANDS + 0.22), (x - 0.2, _NETWORK - 0.49), color=colour)

    # What it predicts, and what it remembers
    said = f"$\\hat s_{{{after}}}$"
    sheet.arrow((x, _NETWORK + 0.48), (x, _PREDICTED - 0.23), color=colour)
    sheet.box(x, _PREDICTED, (0.78, 0.46), said, color=colour)
    following = x + 1.8
    if k == len(_PLACES) - 1:
        return
    sheet.arrow((x + 0.52, 2.55), (following - 0.52, 2.55), color=colour, lw=2.5)
    sheet.write(x + 0.9, 2.38, "memory", color=colour)

    # The next state: seen, or the prediction itself, or neither is said
    end = (following - 0.52, 3.05)
    if look.closed:
        start = (x + 0.4, _PREDICTED - 0.1)
        sheet.arrow(start, end, bend=-0.25, color=colour)
    elif look.lit:
        way = [(x + 0.4, _WANTED), (x + 0.68, _WANTED), (x + 0.68, 3.05)]
        sheet.line(way, color=colour)
        sheet.arrow(way[-1], end, color=colour)
        fed = f"$s_{{{after}}}$"
        sheet.write(x + 1.0, 3.25, fed, fontsize=14, color=colour)
    else:
        sheet.arrow((x + 0.62, 3.05), end, color=colour)
        sheet.write(x + 0.9, 3.25, "state", color=colour)


def _draw_bias(sheet: _Sheet, look: _Look) -> None:
    """One p, the same in each step, and the names of what goes in."""
    colour = look.rest
    sheet.box(_STATE, _BIAS, (0.5, 0.44), "$p$", **look.of("p"))
    sheet.line([(_STATE + 0.25, _BIAS), (_PLACES[-1] + 0.33, _BIAS)], color=colour)
    for x in _PLACES:
        sheet.arrow((x + 0.33, _BIAS), (x + 0.33, _NETWORK - 0.49), color=colour)
    sheet.write(1.4, _BIAS, "parametric bias", color=colour)
    sheet.write(_STATE + 0.4, _COMMANDS, "commands", color=colour)


def _draw_loss(sheet: _Sheet, look: _Look) -> None:
    """What predictions are compared with, and the loss of the differences."""
    colour = look.rest
    if look.lit is None:
        _draw_any_loss(sheet)
        return
    label = "wanted" if look.lit == "u" else "seen"
    first = _PLACES[look.counts[0]]
    sheet.write(first - 0.95, _WANTED, label, color=colour)
    sheet.write(_PLACES[0] - 0.95, _PREDICTED, "predicted", color=colour)

    # The steps that count
    for k in look.counts:
        x = _PLACES[k]
        wanted = "$z^{ref}$" if look.lit == "u" else f"$s_{{t+{k + 1}}}$"
        sheet.box(x, _WANTED, (0.78, 0.46), wanted, color=colour)
        sheet.arrow(
            (x, _PREDICTED + 0.24),
            (x, _WANTED - 0.24),
            color=colour,
            arrowstyle="<|-|>",
        )
    sheet.arrow((first, _COMPARED), (_LOSS - 0.27, _COMPARED), color=colour)

    # The loss
    sheet.box(_LOSS, _COMPARED, (0.5, 0.5), "$L$", color=_ORANGE, gid="loss")
    sheet.write(_LOSS, _COMPARED + 0.45, "loss", color=_ORANGE)
    if look.lit == "u":
        sheet.write(_LOSS, _COMPARED + 0.75, "+ tension", color=colour)


def _draw_any_loss(sheet: _Sheet) -> None:
    """Predictions are compared with something: which, and with what, is left open."""
    left = _PLACES[0] - 0.6
    right = _PLACES[-1] + 0.6
    size = (right - left, 0.7)
    corner = (left, _PREDICTED - 0.35)
    sheet.ax.add_patch(Rectangle(corner, *size, fill=False, linestyle=":", zorder=0))
    sheet.write(left - 0.5, _PREDICTED, "predicted")
    sheet.arrow((right, _PREDICTED), (_LOSS - 0.3, _COMPARED - 0.15))
    sheet.write(_PLACES[1], _WANTED, "what was seen, or what is wanted", fontsize=14)
    sheet.arrow((_PLACES[-1], _WANTED), (_LOSS - 0.3, _COMPARED + 0.15))
    sheet.box(_LOSS, _COMPARED, (0.5, 0.5), "$L$", gid="loss")
    sheet.write(_LOSS, _COMPARED + 0.45, "loss")


def _draw_gradient(sheet: _Sheet, look: _Look) -> None:
    """Dashed, from the loss through predictions and networks to what moves."""
    dashed = {"color": _ORANGE, "linestyle": (0, (4, 2)), "gid": "gradient", "lw": 2.0}
    moves = look.moves
    above = _COMPARED - 0.15
    below = _BIAS - 0.14
    aside = 0.18  # beside the arrows that lead the other way

    # To the predictions that count
    first = _PLACES[look.counts[0]] + aside
    sheet.line([(_LOSS - 0.26, above), (first, above)], **dashed)
    sheet.write(_LOSS - 0.45, above - 0.24, "gradient", color=_ORANGE)
    for k, x in enumerate(_PLACES):
        # From a prediction down to its network, and in it to the weights
        top = above if k in look.counts else _PREDICTED
        end = (x + aside, _NETWORK + 0.49)
        if "W" in moves:
            sheet.arrow((x + aside, top), end, **dashed)
        else:
            sheet.line([(x + aside, top), end], **dashed)

        # Through the network to what goes in
        if "u" in moves:
            command = (x - 0.05, _COMMANDS + 0.23)
            sheet.arrow((x - 0.05, _NETWORK - 0.49), command, **dashed)
        if "p" in moves:
            sheet.line([(x + aside, _NETWORK - 0.49), (x + aside, below)], **dashed)
        if k:
            _draw_back(sheet, look, k, dashed)
    if "p" in moves:
        line = (_PLACES[-1] + aside, below)
        sheet.arrow(line, (_STATE + 0.26, below), **dashed)


def _draw_back(sheet: _Sheet, look: _Look, k: int, dashed: dict[str, Any]) -> None:
    """From a step to the one before: by memory, and by a prediction that was fed."""
    x = _PLACES[k]
    before = _PLACES[k - 1]
    sheet.line([(x - 0.52, 2.69), (before + 0.52, 2.69)], **dashed)
    if look.closed:
        way = np.array([[x - 0.52, 3.2], [before + 0.72, 3.5], [before + 0.4, 3.98]])
        along = np.linspace(0, 1, 30)[:, None]
        curve = (1 - along) ** 2 * way[0] + along**2 * way[2]
        curve += 2 * along * (1 - along) * way[1]
        sheet.line(curve.tolist(), **dashed)


# A muscle pair, at one joint

_JOINT = (5.9, 1.7)


def _draw_joint(sheet: _Sheet) -> None:
    """The pulley, the link on it, and the angle by which it is turned down."""
    x, y = _JOINT
    sheet.ax.add_patch(Circle(_JOINT, 0.9, fill=False, edgecolor=_GREY, lw=1.5))
    link = {"color": "#BFBFBF", "lw": 9, "solid_capstyle": "round", "zorder": 0}
    sheet.line([_JOINT, (x + 3.4, y - 0.85)], **link)
    sheet.line([_JOINT, (x + 3.4, y)], color=_GREY, linestyle=":")
    sheet.write(x + 2.5, y - 0.28, "$\\theta$", fontsize=16)
    sheet.arrow((x + 3.0, y), (x + 2.95, y - 0.66), bend=-0.15)
    sheet.arrow(_JOINT, (x, y + 0.9), arrowstyle="<|-|>")
    sheet.write(x + 0.18, y + 0.42, "$r$", fontsize=16)


def _draw_muscle(sheet: _Sheet, name: str, y: float, colour: str) -> None:
    """From the motor over the wire and the spring to the pulley."""
    sheet.line([(1.2, y), (2.4, y)], color=colour, lw=2)
    teeth = y + 0.16 * np.array([0, 1, -1, 1, -1, 1, -1, 1, 0])
    spring = np.linspace(2.4, 4.2, 9)
    sheet.line(list(zip(spring, teeth, strict=True)), color=colour, lw=2)
    sheet.line([(4.2, y), (_JOINT[0], y)], color=colour, lw=2)
    sheet.box(0.75, y, (0.9, 0.44), "motor", fontsize=13)
    sheet.write(3.3, y + 0.36, f"{name}: stretch $e$", color=colour, fontsize=14)
    # The length counts from a mark: zero at θ = 0 with a spring that is just slack
    sheet.line([(2.1, y - 0.16), (2.1, y + 0.16)], color=colour, lw=2)
    sheet.write(2.1, y - 0.36, "$l = 0$", color=colour)
    sheet.arrow((2.0, y + 0.26), (1.35, y + 0.26), color=colour)
    sheet.write(1.68, y + 0.48, "$l < 0$", color=colour)


# The muscle arm: each pair of muscles by the joints that it passes. Radii of pulleys
# are drawn apart, so that wires can be told; the true ones stand in the table.

_SHOULDER = (3.5, 3.3)
_ELBOW = (6.1, 3.3)
_BEND = np.radians(40)  # of the elbow, upwards: it can't bend down
_HAND = (_ELBOW[0] + 2.1 * np.cos(_BEND), _ELBOW[1] + 2.1 * np.sin(_BEND))


class _Pair(NamedTuple):
    """Two muscles that pull the same joints, one each way."""

    radius: float  # of the last pulley
    start: float  # where the motors are
    end: float  # where the last joint is
    colour: str


_PAIRS = {
    "shoulder": _Pair(0.95, 0.9, 3.5, _BLUE),
    "elbow": _Pair(0.36, 4.2, 6.1, _GREEN),
    "biarticular": _Pair(0.64, 1.5, 6.1, _PURPLE),
}


def _draw_links(sheet: _Sheet) -> None:
    """Links, joints, hand and cloth, and which way the joints count."""
    bone = {"color": "#CFCFCF", "lw": 13, "solid_capstyle": "round", "zorder": 0}
    sheet.line([_SHOULDER, _ELBOW, _HAND], **bone)
    for joint, radii in ((_SHOULDER, (0.95, 0.64)), (_ELBOW, (0.64, 0.36))):
        for radius in radii:
            look = {"fill": False, "edgecolor": _GREY, "zorder": 1}
            sheet.ax.add_patch(Circle(joint, radius, **look))
        sheet.ax.add_patch(Circle(joint, 0.07, color=_INK, zorder=3))

    # The hand holds the cloth by an edge
    x, y = _HAND
    waves = [(0, 0), (0.12, -0.35), (0, -0.7), (0.14, -1.0)]
    left = [(x - 0.2 + dx, y + dy) for dx, dy in waves]
    right = [(x + 0.35 + dx, y + dy) for dx, dy in waves]
    sheet.ax.fill(*np.transpose(left + right[::-1]), color=COLOURS[4], zorder=1)
    sheet.ax.add_patch(Circle(_HAND, 0.13, color=_INK, zorder=3))
    sheet.write(x - 0.5, y + 0.1, "hand")
    sheet.write(x + 0.8, y - 0.6, "cloth")

    # Angles count downwards; a moment arm is what a wire is away from a joint
    sheet.write(_SHOULDER[0], _SHOULDER[1] - 1.2, "shoulder")
    sheet.write(_ELBOW[0] - 0.45, _ELBOW[1] - 0.95, "elbow")
    straight = (_ELBOW[0] + 1.7, _ELBOW[1])
    sheet.line([_ELBOW, straight], color=_GREY, linestyle=":")
    # The shoulder's turns by θ1; the elbow is bent up by θ2, from the dotted line
    for joint, radius, turn in ((_SHOULDER, 0.45, (40, -40)), (_ELBOW, 0.95, (0, 35))):
        way = np.radians(turn)
        x = joint[0] + radius * np.cos(way)
        y = joint[1] + radius * np.sin(way)
        bend = -0.4 if joint is _SHOULDER else 0.15
        sheet.arrow((x[0], y[0]), (x[1], y[1]), bend=bend)
    theta = {"fontsize": 15}
    sheet.write(_SHOULDER[0] + 0.17, _SHOULDER[1] - 0.38, "$\\theta_1$", **theta)
    sheet.write(_ELBOW[0] + 1.14, _ELBOW[1] + 0.32, "$\\theta_2$", **theta)
    words = "Angles count downwards:\nbent up, as here, $\\theta_2 < 0$"
    sheet.write(_ELBOW[0] + 2.1, _ELBOW[1] - 0.55, words)
    x, y = _SHOULDER
    sheet.arrow((x, y), (x, y + 0.95), arrowstyle="<|-|>")
    sheet.write(x - 0.17, y + 0.38, "$r$", **theta)


def _draw_pair(sheet: _Sheet, name: str) -> None:
    """Flexor and extensor: motor, spring and wire, to the last joint that they turn."""
    pair = _PAIRS[name]
    colour = pair.colour
    first = pair.start
    last = pair.end
    height = _SHOULDER[1]
    for up in (1, -1):
        y = height + up * pair.radius
        # A motor reels in the wire; a spring is part of it
        sheet.box(first, y, (0.24, 0.24), "M", color=colour, fontsize=_SMALL)
        spring = np.linspace(first + 0.3, first + 0.9, 11)
        teeth = y + 0.08 * np.array([0, 1, -1, 1, -1, 1, -1, 1, -1, 1, 0])
        sheet.line([(first + 0.12, y), (first + 0.3, y)], color=colour, lw=2)
        sheet.line(list(zip(spring, teeth, strict=True)), color=colour, lw=2)
        sheet.line([(first + 0.9, y), (last, y)], color=colour, lw=2)

        # Around the pulley, and fixed there
        turn = np.radians(90 - np.linspace(0, 45, 20))
        x = last + pair.radius * np.cos(turn)
        around = height + up * pair.radius * np.sin(turn)
        sheet.line(list(zip(x, around, strict=True)), color=colour, lw=2)
        end = (x[-1], around[-1])
        sheet.ax.add_patch(Circle(end, 0.06, color=colour, zorder=3))


def _write_arms(sheet: _Sheet) -> None:
    """What the sign of a moment arm means, and the table G, from the arm itself."""
    flexors = "Flexors pass above a joint and raise the link:\nturning down stretches "
    sheet.write(2.5, 4.95, flexors + "them, $G > 0$.")
    extensors = "Extensors pass below it and lower the link:\nturning down slackens "
    sheet.write(2.5, 1.35, extensors + "them, $G < 0$.")
    sheet.write(2.5, 0.6, "M: a motor, which reels in wire; radii not to scale.")

    # A line for each pair, in its colour
    sheet.write(6.55, 1.75, "$G$ [mm/rad]", fontweight="bold")
    sheet.write(8.2, 1.75, "shoulder")
    sheet.write(9.2, 1.75, "elbow")
    rows = 1e3 * Muscles().moment_arms[::2]  # of the flexors
    for k, (name, row) in enumerate(zip(_PAIRS, rows, strict=True)):
        y = 1.45 - 0.28 * k
        sheet.write(6.55, y, f"{name} pair", color=_PAIRS[name].colour)
        for x, arm in zip((8.2, 9.2), row, strict=True):
            sheet.write(x, y, f"±{arm:.0f}" if arm else "0")


# Memory over time: four steps in a row, and a sketch of the error beside them.

_STEPS = (1.5, 2.95, 4.4, 5.85)


def _draw_row(sheet: _Sheet, y: float, title: str, seen: bool) -> None:
    """The network over time, fed with what was seen or with what it said."""
    sheet.write(0.3, y + 1.55, title, ha="left", fontsize=14, fontweight="bold")
    for k, x in enumerate(_STEPS):
        sheet.box(x, y + 0.45, (0.7, 0.6), "$h$", fontsize=18)
        sheet.arrow((x, y + 0.76), (x, y + 0.98), color=_PURPLE)
        sheet.write(x, y + 1.13, f"$\\hat s_{k + 1}$", fontsize=15, color=_PURPLE)

        # What is fed: a state that was seen, or the last prediction
        if seen or not k:
            sheet.write(x, y - 0.28, f"$s_{k}$", fontsize=15, color=_GREEN)
            sheet.arrow((x, y - 0.13), (x, y + 0.14), color=_GREEN)
        else:
            start = (x - 1.45 + 0.2, y + 1.08)
            sheet.arrow(start, (x - 0.36, y + 0.65), bend=-0.3, color=_PURPLE)

        # What is remembered: a closed loop goes on from the steps before
        sheet.arrow((x - 1.09, y + 0.35), (x - 0.36, y + 0.35), lw=2.5)
        sheet.write(x - 0.75, y + 0.17, "memory" if k or not seen else "empty")
    _sketch_error(sheet, y, seen)


def _sketch_error(sheet: _Sheet, y: float, seen: bool) -> None:
    """How the error goes with the steps predicted; a sketch without numbers."""
    left = 7.2
    bottom = y - 0.05
    sheet.arrow((left, bottom), (left + 2.5, bottom))
    sheet.arrow((left, bottom), (left, bottom + 1.4))
    sheet.write(left + 1.2, bottom - 0.2, "steps")
    sheet.write(left + 0.35, bottom + 1.35, "error")

    # With what was seen each step begins anew; else the text asks how it goes on
    if not seen:
        sheet.write(left + 1.3, bottom + 0.65, "?", fontsize=40, color=_PURPLE)
        return
    steps = np.linspace(0, 2.3, 60)
    error = 0.5 + 0.02 * np.sin(9 * steps)
    curve = list(zip(left + steps, bottom + error, strict=True))
    sheet.line(curve, color=_PURPLE, lw=2.5)
    place = (left + 1.45, bottom + error.max() + 0.2)
    sheet.write(*place, "stays that of one step", color=_PURPLE)
