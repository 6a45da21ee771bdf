"""Figures in words, for readers who cannot see them.

They say what kind of figure it is, its axes, and the numbers that it draws. Everything
is read off the figure itself, so that the words cannot differ from the picture.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.cbook import strip_math
from matplotlib.collections import PathCollection
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation

_Drawn = Line2D | PathCollection
# Characters of a summary, which a screen reader reads in one go and cannot stop within
_LONGEST = 240
_MANY = 12  # labels, or lines without a label, that are still named one by one
_MARKS = {r"\hat": "predicted", r"\theta": "θ", "$": "", "{": "", "}": ""}
_NUMERALS = "-−0123456789.x^ "  # what a tick is made of that is no name


@dataclass(frozen=True)
class AltText:
    """A figure in words."""

    summary: str  # alternative text, a sentence or two
    details: tuple[str, ...]  # a paragraph of numbers for each panel


def describe(figure: Figure) -> AltText:
    """What a figure shows, from its axes, labels, lines, dots, bars and pictures."""
    bars = [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]
    panels = [ax for ax in figure.axes if ax not in bars and _shows(ax)]
    names = [_plain(str(ax.get_label()) or ax.get_title()) for ax in panels]
    heads = names
    if len(panels) > 1:
        numbered = enumerate(names, 1)
        heads = [f"Panel {k}, {name}".removesuffix(", ") for k, name in numbered]

    details = []
    for ax, head in zip(panels, heads, strict=True):
        phrases = [head, *_contents(ax)]
        details.append(". ".join(filter(None, phrases)))
    details += [f"Colours: {_axis(bar.yaxis)}" for bar in bars]
    paragraphs = tuple(f"{each}." for each in details)
    return AltText(_summary(panels, names), paragraphs)


def _shows(ax: Axes) -> bool:
    return bool(ax.images) or bool(ax.axison and ax.has_data()) or _is_drawing(ax)


def _is_drawing(ax: Axes) -> bool:
    """Whether it is a drawing, not of data: without axes, and with a label."""
    return not ax.axison and bool(ax.get_label() and (ax.patches or ax.texts))


def _summary(panels: list[Axes], names: list[str]) -> str:
    """What kind of figure it is, and the labels in it, cut where it gets long."""
    kinds = " and ".join(dict.fromkeys(map(_kind, panels))) or "Empty figure"
    if len(panels) > 1:
        kinds += f" in {len(panels)} panels"

    # Labels of panels, axes and what is drawn
    charts = [ax for ax in panels if not (ax.images or _is_drawing(ax))]
    drawn = [each for ax in charts for each in _drawn(ax)]
    parts = [
        kinds,
        _few(names),
        _few((_plain(ax.get_xlabel()) for ax in charts), "horizontal: "),
        _few((_plain(ax.get_ylabel()) for ax in charts), "vertical: "),
        _few(map(_label, drawn), "shown: "),
    ]
    summary = "; ".join(filter(None, parts))

    # At the end of a word
    if len(summary) > _LONGEST:
        cut, _ = summary[: _LONGEST - 2].rsplit(" ", 1)
        return f"{cut} …"
    return summary


def _plain(text: str) -> str:
    """A label on one line, without the marks of mathematical type."""
    plain = strip_math(text)
    for mark, word in _MARKS.items():
        plain = plain.replace(mark, word)
    return " ".join(plain.split())


def _label(each: _Drawn | BarContainer | ErrorbarContainer) -> str:
    """What a legend would call it, if anything."""
    label = str(each.get_label())
    return "" if label.startswith("_") else _plain(label)


def _few(labels: Iterable[str], before: str = "") -> str:
    """Different labels as one phrase; of many, the first and the last."""
    different = list(dict.fromkeys(filter(None, labels)))
    if not different:
        return ""
    if len(different) > _MANY:
        different = [f"{different[0]} to {different[-1]}"]
    comma = "; " if any("," in label for label in different) else ", "
    return before + comma.join(different)


def _kind(ax: Axes) -> str:
    if ax.images:
        return "Pictures"
    if _is_drawing(ax):
        return "Drawing"
    if any(isinstance(each, QuadContourSet) for each in ax.collections):
        return "Map"
    if any(isinstance(each, BarContainer) for each in ax.containers):
        return "Bar chart"
    joined = any(_is_joined(line) and len(_points(line)) > 2 for line in ax.lines)
    return "Line chart" if joined else "Dot chart"


def _is_joined(each: _Drawn) -> bool:
    """Whether it is a line, not dots."""
    return isinstance(each, Line2D) and each.get_linestyle() != "None"


def _contents(ax: Axes) -> list[str]:
    """Phrases for what a panel shows."""
    if ax.images:
        return [_picture(np.asarray(image.get_array())) for image in ax.images]
    if _is_drawing(ax):
        written = dict.fromkeys(_plain(text.get_text()) for text in ax.texts)
        return [f"Written in it: {'; '.join(written)}"]
    axes = [f"Horizontal: {_axis(ax.xaxis)}", f"Vertical: {_axis(ax.yaxis)}"]
    bars = [_bars(ax, each) for each in ax.containers if isinstance(each, BarContainer)]
    intervals = [
        _intervals(ax, each)
        for each in ax.containers
        if isinstance(each, ErrorbarContainer)
    ]
    return [*axes, *_lines_and_dots(ax), *bars, *intervals, *_notes(ax)]


def _lines_and_dots(ax: Axes) -> list[str]:
    """A phrase for each that has a name, and for the others, unless they are many."""
    drawn = _drawn(ax)
    phrases = []
    for each in drawn:
        if _label(each):
            phrases.append(f"{_label(each)}: {_numbers(ax, each)}")
    rest = [each for each in drawn if not _label(each)]
    if len(rest) > _MANY:
        places = np.concatenate([_points(each) for each in rest])
        phrases.append(f"{len(rest)} more, {_box(ax, places)}")
    else:
        phrases += [f"without a name: {_numbers(ax, each)}" for each in rest]
    return phrases


def _notes(ax: Axes) -> list[str]:
    """What is written in a panel, and where notes point to."""
    phrases = []
    others = []
    for text in ax.texts:
        words = _plain(text.get_text())
        if isinstance(text, Annotation) and text.get_text():
            phrases.append(f"{words}: {_place(ax, *text.xy)}")
        else:
            others.append(words)
    written = _few(others, "Written in it: ")
    return [*phrases, written] if written else phrases


def _drawn(ax: Axes) -> list[_Drawn]:
    """Lines and clouds of dots with a finite point.

    Without those that are parts of bars and intervals.
    """
    parts = {part for each in ax.containers for part in each.get_children()}
    drawn = [each for each in (*ax.lines, *ax.collections) if isinstance(each, _Drawn)]
    return [each for each in drawn if each not in parts and _points(each).size]


def _points(each: _Drawn) -> np.ndarray:
    """Finite places `[N, 2]` that are drawn."""
    if isinstance(each, PathCollection):
        places = np.reshape(each.get_offsets(), (-1, 2))
    else:
        places = np.reshape(each.get_xydata(), (-1, 2))
    return places[np.isfinite(places).all(axis=1)]


def _axis(axis: Axis) -> str:
    """An axis: its label, and its range or the names on it."""
    label = _plain(axis.get_label_text()) or "value"
    names = list(_names_on(axis).values())
    if names:
        return f"{label} with {', '.join(names[: 2 * _MANY])}"
    low, high = sorted(axis.get_view_interval())
    scale = ", logarithmic" if axis.get_scale() == "log" else ""
    return f"{label} from {_number(low)} to {_number(high)}{scale}"


def _names_on(axis: Axis) -> dict[float, str]:
    """Names that stand in place of numbers on an axis, by where they stand."""
    along = 0 if isinstance(axis, XAxis) else 1
    names = {}
    for text in axis.get_ticklabels():
        name = _plain(text.get_text())
        if name.strip(_NUMERALS):
            names[float(text.get_position()[along])] = name
    return names


def _number(value: float) -> str:
    rounded = round(value, 9)
    return np.format_float_positional(rounded, precision=3, fractional=False, trim="-")


def _span(axis: Axis, *values: float) -> str:
    """One or two values as a reader of the axis would say them.

    Where the axis has names, those that are nearest.
    """
    names = _names_on(axis)
    said = []
    for value in values:
        if names:
            gaps = {place: abs(place - value) for place in names}
            said.append(names[min(gaps, key=gaps.__getitem__)])
        else:
            said.append(_number(value))
    return " to ".join(dict.fromkeys(said))


def _place(ax: Axes, x: float, y: float) -> str:
    return f"{_span(ax.yaxis, y)} at {_span(ax.xaxis, x)}"


def _box(ax: Axes, places: np.ndarray) -> str:
    """The smallest box around places `[N, 2]`."""
    x, y = places.T
    across = _span(ax.xaxis, x.min(), x.max())
    up = _span(ax.yaxis, y.min(), y.max())
    return f"{across} across and {up} up"


def _numbers(ax: Axes, each: _Drawn) -> str:
    """The numbers of a line or of dots.

    Of a line its level, or where it begins, ends, and is lowest and highest.
    """
    # Dots
    places = _points(each)
    x, y = places.T
    first = _place(ax, *places[0])
    if len(places) == 1:
        return first
    if not _is_joined(each):
        return f"{len(places)} dots, {_box(ax, places)}"

    # Straight lines along an axis
    if np.ptp(y) == 0:
        return f"level at {_span(ax.yaxis, y[0])}"
    if np.ptp(x) == 0:
        at = _span(ax.xaxis, x[0])
        return f"upright at {at}, {_span(ax.yaxis, y.min(), y.max())}"

    # Paths that turn back, and curves
    last = _place(ax, *places[-1])
    ends = f"from {first} to {last}"
    if (np.diff(x) < 0).any():
        return f"a path {ends}, {_box(ax, places)}"
    phrases = [ends]
    for word, k in (("lowest", y.argmin()), ("highest", y.argmax())):
        place = _place(ax, *places[k])
        if place not in (first, last):
            phrases.append(f"{word} {place}")
    return ", ".join(phrases)


def _bars(ax: Axes, bars: BarContainer) -> str:
    each = []
    for bar in bars:
        x, _ = bar.get_center()
        each.append(f"{_span(ax.xaxis, x)} {_number(bar.get_height())}")
    return f"{_label(bars) or 'bars'}: {', '.join(each)}"


def _intervals(ax: Axes, errors: ErrorbarContainer) -> str:
    line, _, spans = errors.lines
    middle = f"{_numbers(ax, line)}, " if line else ""
    segments = [segment for span in spans for segment in span.get_segments()]
    across = _box(ax, np.concatenate(segments))
    return f"{_label(errors) or 'interval'}: {middle}intervals {across}"


def _picture(image: np.ndarray) -> str:
    """A picture's size; of a mask, or of grey values from 0 to 1, what is white.

    That is how much of it, and where the middle of that is.
    """
    height, width = image.shape[:2]
    size = f"picture of {width} by {height} pixels"
    if image.ndim == 3:
        return f"Colour {size}"
    if image.max() > 1:
        return f"Grey {size}"

    white = image > 0.5
    if not white.any():
        return "All black"
    share = 100 * white.mean()
    down, right = 100 * (np.argwhere(white).mean(axis=0) + 0.5) / image.shape
    return (
        f"White in {share:.0f} % of it, around {right:.0f} % from the left "
        f"and {down:.0f} % from the top"
    )
