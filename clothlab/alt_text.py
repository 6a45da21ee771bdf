"""Figures in words, for readers who cannot see them: what kind of figure, its axes, and
the numbers that it draws.

Everything is read off the figure itself, so that the words cannot differ from the
picture.
"""

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


@dataclass(frozen=True)
class AltText:
    """A figure in words: a sentence or two as alternative text, and a paragraph of
    numbers for each panel.
    """

    summary: str
    details: tuple[str, ...]


def describe(figure: Figure) -> AltText:
    """What a figure shows, from its axes, labels, lines, dots, bars and pictures."""
    bars = [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]
    panels = [
        ax
        for ax in figure.axes
        if ax not in bars and (ax.images or (ax.axison and ax.has_data()))
    ]
    charts = [ax for ax in panels if not ax.images]
    names = [_plain(str(ax.get_label()) or ax.get_title()) for ax in panels]
    kinds = " and ".join(dict.fromkeys(map(_kind, panels))) or "Empty figure"
    parts = [
        kinds + (f" in {len(panels)} panels" if len(panels) > 1 else ""),
        *_few(names),
    ]
    parts += _few([_plain(ax.get_xlabel()) for ax in charts], "horizontal: ")
    parts += _few([_plain(ax.get_ylabel()) for ax in charts], "vertical: ")
    parts += _few([_label(each) for ax in panels for each in _drawn(ax)], "shown: ")
    summary = "; ".join(parts)
    if len(summary) > _LONGEST:
        summary = f"{summary[: _LONGEST - 2].rsplit(' ', 1)[0]} …"
    heads = (
        [f"Panel {k}, {name}".removesuffix(", ") for k, name in enumerate(names, 1)]
        if len(panels) > 1
        else names
    )
    details = [
        ". ".join(filter(None, [head, *_contents(ax)]))
        for head, ax in zip(heads, panels, strict=True)
    ]
    details += [f"Colours: {_axis(bar.yaxis)}" for bar in bars]
    return AltText(summary, tuple(f"{each}." for each in details))


def _plain(text: str) -> str:
    """A label on one line, without the marks of mathematical type."""
    return " ".join(strip_math(text).split())


def _label(each: _Drawn | BarContainer | ErrorbarContainer) -> str:
    """What a legend would call it, if anything."""
    label = str(each.get_label())
    return "" if label.startswith("_") else _plain(label)


def _few(labels: list[str], before: str = "") -> list[str]:
    """Different labels as one phrase; of many, the first and the last."""
    different = list(dict.fromkeys(filter(None, labels)))
    if len(different) > _MANY:
        different = [f"{different[0]} to {different[-1]}"]
    comma = "; " if any("," in label for label in different) else ", "
    return [before + comma.join(different)] if different else []


def _kind(ax: Axes) -> str:
    if ax.images:
        return "Pictures"
    if any(isinstance(each, QuadContourSet) for each in ax.collections):
        return "Map"
    if any(isinstance(each, BarContainer) for each in ax.containers):
        return "Bar chart"
    joined = any(
        line.get_linestyle() != "None" and len(_points(line)) > 2 for line in ax.lines
    )
    return "Line chart" if joined else "Dot chart"


def _contents(ax: Axes) -> list[str]:
    """Phrases for what a panel shows."""
    if ax.images:
        return [_picture(np.asarray(image.get_array())) for image in ax.images]
    phrases = [f"Horizontal: {_axis(ax.xaxis)}", f"Vertical: {_axis(ax.yaxis)}"]
    drawn = _drawn(ax)
    phrases += [
        f"{_label(each)}: {_numbers(ax, each)}" for each in drawn if _label(each)
    ]
    rest = [each for each in drawn if not _label(each)]
    if len(rest) > _MANY:
        phrases.append(
            f"{len(rest)} more, {_box(ax, np.concatenate([_points(each) for each in rest]))}"
        )
    else:
        phrases += [f"without a name: {_numbers(ax, each)}" for each in rest]
    phrases += [
        _bars(ax, each) for each in ax.containers if isinstance(each, BarContainer)
    ]
    phrases += [
        _intervals(ax, each)
        for each in ax.containers
        if isinstance(each, ErrorbarContainer)
    ]
    notes = [
        text for text in ax.texts if isinstance(text, Annotation) and text.get_text()
    ]
    phrases += [f"{_plain(note.get_text())}: {_place(ax, *note.xy)}" for note in notes]
    return phrases + _few(
        [_plain(text.get_text()) for text in ax.texts if text not in notes],
        "Written in it: ",
    )


def _drawn(ax: Axes) -> list[_Drawn]:
    """Lines and clouds of dots with a finite point, without those that are parts of
    bars and intervals.
    """
    parts = {part for each in ax.containers for part in each.get_children()}
    drawn = [each for each in (*ax.lines, *ax.collections) if isinstance(each, _Drawn)]
    return [each for each in drawn if each not in parts and _points(each).size]


def _points(each: _Drawn) -> np.ndarray:
    """Finite places `[N, 2]` that are drawn."""
    places = np.reshape(
        each.get_offsets() if isinstance(each, PathCollection) else each.get_xydata(),
        (-1, 2),
    )
    return places[np.isfinite(places).all(axis=1)]


def _axis(axis: Axis) -> str:
    """An axis: its label, and its range or the names on it."""
    label, names = (
        _plain(axis.get_label_text()) or "value",
        list(_names_on(axis).values()),
    )
    if names:
        return f"{label} with {', '.join(names[: 2 * _MANY])}"
    low, high = sorted(axis.get_view_interval())
    return f"{label} from {_number(low)} to {_number(high)}{', logarithmic' if axis.get_scale() == 'log' else ''}"


def _names_on(axis: Axis) -> dict[float, str]:
    """Names that stand in place of numbers on an axis, by where they stand."""
    along = 0 if isinstance(axis, XAxis) else 1
    ticks = {
        float(text.get_position()[along]): _plain(text.get_text())
        for text in axis.get_ticklabels()
    }
    return {
        place: name for place, name in ticks.items() if name.strip("-−0123456789.x^ ")
    }


def _number(value: float) -> str:
    return np.format_float_positional(
        round(value, 9), precision=3, fractional=False, trim="-"
    )


def _span(axis: Axis, *values: float) -> str:
    """One or two values as a reader of the axis would say them: the names nearest to
    them, if there are names.
    """
    names = _names_on(axis)
    said = [
        names[min(names, key=lambda place: abs(place - value))]
        if names
        else _number(value)
        for value in values
    ]
    return " to ".join(dict.fromkeys(said))


def _place(ax: Axes, x: float, y: float) -> str:
    return f"{_span(ax.yaxis, y)} at {_span(ax.xaxis, x)}"


def _box(ax: Axes, places: np.ndarray) -> str:
    (left, bottom), (right, top) = places.min(axis=0), places.max(axis=0)
    return (
        f"{_span(ax.xaxis, left, right)} across and {_span(ax.yaxis, bottom, top)} up"
    )


def _numbers(ax: Axes, each: _Drawn) -> str:
    """The numbers of a line or of dots: its level, or where it begins, ends, and is
    lowest and highest.
    """
    places = _points(each)
    x, y = places.T
    first, last, lowest, highest = (
        _place(ax, *places[k]) for k in (0, -1, y.argmin(), y.argmax())
    )
    if len(places) == 1:
        return first
    if isinstance(each, PathCollection) or each.get_linestyle() == "None":
        return f"{len(places)} dots, {_box(ax, places)}"
    if np.ptp(y) == 0:
        return f"level at {_span(ax.yaxis, y[0])}"
    if np.ptp(x) == 0:
        return (
            f"upright at {_span(ax.xaxis, x[0])}, {_span(ax.yaxis, y.min(), y.max())}"
        )
    if (np.diff(x) < 0).any():
        return f"a path from {first} to {last}, {_box(ax, places)}"
    extremes = {"lowest": lowest, "highest": highest}.items()
    inside = [
        f"{word} {place}" for word, place in extremes if place not in (first, last)
    ]
    return ", ".join([f"from {first} to {last}", *inside])


def _bars(ax: Axes, bars: BarContainer) -> str:
    each = [
        f"{_span(ax.xaxis, bar.get_center()[0])} {_number(bar.get_height())}"
        for bar in bars
    ]
    return f"{_label(bars) or 'bars'}: {', '.join(each)}"


def _intervals(ax: Axes, errors: ErrorbarContainer) -> str:
    line, _, spans = errors.lines
    middle = f"{_numbers(ax, line)}, " if line else ""
    ends = np.concatenate(
        [segment for span in spans for segment in span.get_segments()]
    )
    return f"{_label(errors) or 'interval'}: {middle}intervals {_box(ax, ends)}"


def _picture(image: np.ndarray) -> str:
    """A picture's size; of a mask, or of grey values from 0 to 1, how much is white,
    and where its middle is.
    """
    if image.ndim == 3 or image.max() > 1:
        return f"{'Colour' if image.ndim == 3 else 'Grey'} picture of {image.shape[1]} by {image.shape[0]} pixels"
    white = image > 0.5
    if not white.any():
        return "All black"
    down, right = 100 * (np.argwhere(white).mean(axis=0) + 0.5) / image.shape
    share = 100 * white.mean()
    return f"White in {share:.0f} % of it, around {right:.0f} % from the left and {down:.0f} % from the top"
