"""Figures in words, for readers who cannot see them: what kind of figure, its axes, and the numbers that it draws.

Everything is read off the figure itself, so that the words cannot differ from the picture. They say what is drawn and
leave what it means to the text of a notebook, as the picture does.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.collections import PathCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation

Drawn = Line2D | PathCollection
LONGEST = 240  # characters of a summary, which a screen reader reads in one go and cannot stop within
MANY = 12  # labels, or lines without a label, that are still named one by one


@dataclass(frozen=True)
class AltText:
    """A figure in words.

    Attributes:
        summary: a sentence or two, for an image's alternative text.
        details: a paragraph for each panel with the numbers that it draws, to be read one by one.
    """

    summary: str
    details: tuple[str, ...]


def describe(figure: Figure) -> AltText:
    """What a figure shows, from its axes, labels, lines, dots, bars and pictures."""
    panels = [ax for ax in figure.axes if ax.images or (ax.axison and ax.has_data() and not _is_key(ax))]
    names = {ax: _name(ax, panels) for ax in panels}
    kinds = list(dict.fromkeys(_kind(ax) for ax in panels))
    parts = [f"{' and '.join(kinds) or 'Empty figure'}{f' in {len(panels)} panels' if len(panels) > 1 else ''}"]
    parts += _few([names[ax] for ax in panels])
    parts += _few([plain(ax.get_xlabel()) for ax in panels if not ax.images], "horizontal: ")
    parts += _few([plain(ax.get_ylabel()) for ax in panels if not ax.images], "vertical: ")
    parts += _few([label for ax in panels for label, _ in _labelled(ax)], "shown: ")
    summary = "; ".join(parts)
    if len(summary) > LONGEST:
        summary = f"{summary[: LONGEST - 2].rsplit(' ', 1)[0]} …"
    details = [_panel(ax, names[ax], k, len(panels)) for k, ax in enumerate(panels, 1)]
    details += [f"Colours: {_axis('value', ax.yaxis)}." for ax in figure.axes if _is_key(ax)]
    return AltText(summary, tuple(details))


def plain(text: str) -> str:
    """A label without the marks of mathematical type."""
    for mark in ("\\mathdefault", "\\mathrm", "\\boldsymbol", "$", "{", "}", "\\"):
        text = text.replace(mark, "")
    return " ".join(text.split())


def _few(labels: list[str], before: str = "") -> list[str]:
    """Different labels as one phrase; of many, the first and the last."""
    different = list(dict.fromkeys(label for label in labels if label))
    if len(different) > MANY:
        different = [f"{different[0]} to {different[-1]}"]
    comma = "; " if any("," in label for label in different) else ", "
    return [before + comma.join(different)] if different else []


def _is_key(ax: Axes) -> bool:
    """Whether these are a colour bar's axes."""
    return ax.get_label() == "<colorbar>"


def _kind(ax: Axes) -> str:
    if ax.images:
        return "Pictures"
    if any(isinstance(each, QuadContourSet | QuadMesh) for each in ax.collections):
        return "Map"
    if any(isinstance(each, BarContainer) for each in ax.containers):
        return "Bar chart"
    joined = any(line.get_linestyle() != "None" and len(_points(line)) > 2 for line in ax.lines)
    return "Line chart" if joined else "Dot chart"


def _name(ax: Axes, panels: list[Axes]) -> str:
    """A panel's title; in a grid of pictures with labels at its edges, that of its row and that of its column."""
    title, place = plain(ax.get_title()), ax.get_subplotspec()
    if not ax.images or place is None:
        return title
    row = column = ""
    for other in panels:
        at = other.get_subplotspec()
        if at is None or at.get_gridspec() is not place.get_gridspec():
            continue
        if at.rowspan.start == place.rowspan.start:
            row = row or plain(other.get_ylabel())
        if at.colspan.start == place.colspan.start and at.rowspan.start == 0:
            column = column or plain(other.get_title())
    return ", ".join(each for each in (row, title or column) if each)


def _labelled(ax: Axes) -> list[tuple[str, Drawn]]:
    """Lines and clouds of dots that a legend would name, with their names."""
    named = [(plain(str(each.get_label())), each) for each in _drawn(ax)]
    return [(name, each) for name, each in named if name and not name.startswith("_")]


def _drawn(ax: Axes) -> list[Drawn]:
    """Lines and clouds of dots, without those that are parts of bars and intervals."""
    parts = {id(part) for each in ax.containers for part in each.get_children()}
    all_of_them = [each for each in (*ax.lines, *ax.collections) if isinstance(each, Line2D | PathCollection)]
    return [each for each in all_of_them if id(each) not in parts]


def _panel(ax: Axes, name: str, number: int, of: int) -> str:
    """A panel's paragraph."""
    head = ", ".join(each for each in (f"Panel {number}" if of > 1 else "", name) if each)
    if ax.images:
        parts = [_picture(np.asarray(image.get_array())) for image in ax.images]
    else:
        parts = [f"Horizontal: {_axis('value', ax.xaxis)}", f"Vertical: {_axis('value', ax.yaxis)}"]
        parts += [*_series(ax), *_containers(ax)]
        free = [text for text in ax.texts if plain(text.get_text()) and text not in _labels_of_dots(ax).values()]
        parts += _few([plain(text.get_text()) for text in free], "Written in it: ")
    return ". ".join(part for part in (head, *parts) if part) + "."


def _axis(unnamed: str, axis: Axis) -> str:
    """An axis: its label, and its range or the names on it."""
    label, names = plain(axis.get_label_text()) or unnamed, _names_on(axis)
    if names:
        return f"{label} with {', '.join(list(names.values())[: 2 * MANY])}"
    low, high = sorted(axis.get_view_interval())
    return f"{label} from {_number(low)} to {_number(high)}{', logarithmic' if axis.get_scale() == 'log' else ''}"


def _names_on(axis: Axis) -> dict[float, str]:
    """Names that stand in place of numbers on an axis, by where they stand."""
    along = 0 if isinstance(axis, XAxis) else 1
    ticks = [(text.get_position()[along], plain(text.get_text())) for text in axis.get_ticklabels()]
    return {float(place): name for place, name in ticks if name and not _is_number(name)}


def _is_number(tick: str) -> bool:
    try:
        float(tick.replace("−", "-").replace("×10^", "e").replace("10^", "1e"))
    except ValueError:
        return False
    return True


def _number(value: float) -> str:
    if abs(value) < 1e-9:
        return "0"
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e7 else f"{value:.3g}"


def _value(axis: Axis, value: float) -> str:
    """A value as a reader of the axis would say it: the name nearest to it, if there are names."""
    names = _names_on(axis)
    return names[min(names, key=lambda place: abs(place - value))] if names else _number(value)


def _series(ax: Axes) -> list[str]:
    """A phrase for each line and cloud of dots; what has no name is one more of those that look like it, or counted."""
    named, labels = _labelled(ax), _labels_of_dots(ax)
    known = [(name, each) for name, each in named if _points(each).size]
    unknown: list[tuple[str, Drawn]] = []
    for each in _drawn(ax):
        if any(each is one for _, one in named) or not _points(each).size:
            continue
        name = plain(labels[id(each)].get_text()) if id(each) in labels else _name_by_look(each, named)
        (known if name else unknown).append((name or "without a name", each))
    if len(unknown) > MANY:
        places = np.concatenate([_points(each) for _, each in unknown])
        return [*(f"{name}: {_numbers(ax, each)}" for name, each in known), f"{len(unknown)} more, {_box(ax, places)}"]
    return [f"{name}: {_numbers(ax, each)}" for name, each in (*known, *unknown)]


def _name_by_look(each: Drawn, named: list[tuple[str, Drawn]]) -> str:
    """The name of what a legend shows in the same colour, and in the same style where the colour leaves a choice."""
    alike = [(name, one) for name, one in named if _colour(one) == _colour(each)]
    styles = [name for name, one in alike if _style(one) == _style(each)]
    found = list(dict.fromkeys([name for name, _ in alike] if len({name for name, _ in alike}) == 1 else styles))
    return found[0] if len(found) == 1 else ""


def _colour(each: Drawn) -> str:
    if isinstance(each, Line2D):
        return to_hex(each.get_color())
    colours = np.atleast_2d(np.asarray(each.get_facecolor(), float))
    return to_hex(tuple(colours[0][:3])) if colours.size else ""


def _style(each: Drawn) -> str:
    return f"{each.get_linestyle()} {each.get_marker()}" if isinstance(each, Line2D) else "dots"


def _labels_of_dots(ax: Axes) -> dict[int, Annotation]:
    """Notes that stand at a single dot, by that dot."""
    notes = [text for text in ax.texts if isinstance(text, Annotation)]
    dots = [each for each in _drawn(ax) if len(_points(each)) == 1]
    return {id(dot): note for dot in dots for note in notes if np.allclose(_points(dot)[0], note.xy)}


def _containers(ax: Axes) -> list[str]:
    """A phrase for each group of bars, and for each mean with its interval."""
    parts = []
    for each in ax.containers:
        label = plain(str(each.get_label()))
        if isinstance(each, BarContainer):
            upright = each.orientation != "horizontal"
            at = [bar.get_x() + bar.get_width() / 2 if upright else bar.get_y() + bar.get_height() / 2 for bar in each]
            long = [bar.get_height() if upright else bar.get_width() for bar in each]
            axis = ax.xaxis if upright else ax.yaxis
            bars = [f"{_value(axis, x)} {_number(y)}" for x, y in zip(at, long, strict=True)]
            parts.append(f"{'bars' if label.startswith('_') or not label else label}: {', '.join(bars)}")
        elif isinstance(each, ErrorbarContainer):
            line, _, spans = each.lines
            ends = (
                np.concatenate([np.concatenate(span.get_segments()) for span in spans]) if spans else np.empty((0, 2))
            )
            reach = f", intervals {_box(ax, ends)}" if len(ends) else ""
            middle = _numbers(ax, line) if line is not None else ""
            parts.append(f"{'interval' if label.startswith('_') or not label else label}: {middle}{reach}")
    return parts


def _points(each: Drawn) -> np.ndarray:
    """Finite places `[N, 2]` that are drawn."""
    places = np.asarray(each.get_offsets() if isinstance(each, PathCollection) else each.get_xydata(), float)
    return places.reshape(-1, 2)[np.isfinite(places.reshape(-1, 2)).all(axis=1)]


def _box(ax: Axes, places: np.ndarray) -> str:
    (left, bottom), (right, top) = places.min(axis=0), places.max(axis=0)
    return f"{_span(ax.xaxis, left, right)} across and {_span(ax.yaxis, bottom, top)} up"


def _span(axis: Axis, low: float, high: float) -> str:
    ends = _value(axis, low), _value(axis, high)
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def _numbers(ax: Axes, each: Drawn) -> str:
    """The numbers of a line or of dots: its level, or where it begins, ends, and is lowest and highest."""
    places = _points(each)
    x, y = places.T

    def at(k: int) -> str:
        return f"{_value(ax.yaxis, y[k])} at {_value(ax.xaxis, x[k])}"

    if len(places) == 1:
        return at(0)
    if isinstance(each, PathCollection) or each.get_linestyle() == "None":
        return f"{len(places)} dots, {_box(ax, places)}"
    if np.ptp(y) == 0:
        return f"level at {_value(ax.yaxis, y[0])}"
    if np.ptp(x) == 0:
        return f"upright at {_value(ax.xaxis, x[0])}, {_span(ax.yaxis, y.min(), y.max())}"
    if (np.diff(x) < 0).any():
        return f"a path from {at(0)} to {at(-1)}, {_box(ax, places)}"
    turns = {int(np.argmin(y)): "lowest", int(np.argmax(y)): "highest"}
    extremes = [f"{word} {at(k)}" for k, word in turns.items() if k not in (0, len(x) - 1)]
    return ", ".join([f"from {at(0)} to {at(-1)}", *extremes])


def _picture(image: np.ndarray) -> str:
    """A picture's size; of a mask, or of grey values from 0 to 1, also how much is white, and the middle of that."""
    rows, columns = image.shape[:2]
    if image.ndim == 3:
        return f"Colour picture of {columns} by {rows} pixels"
    if image.min() < 0 or image.max() > 1:
        return f"Grey picture of {columns} by {rows} pixels"
    white, word = image > 0.5, "White" if np.isin(image, (0, 1)).all() else "Nearer to white than to black"
    if not white.any():
        return "All black" if word == "White" else "Dark everywhere"
    down, right = (100 * (np.mean(at) + 0.5) / size for at, size in zip(np.nonzero(white), image.shape, strict=True))
    return (
        f"{word} in {100 * white.mean():.0f} % of it, around {right:.0f} % from the left and {down:.0f} % from the top"
    )
