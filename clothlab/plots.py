"""Figures that two notebooks, or a notebook and the lab, draw.

Each function takes arrays and returns a Figure. Colours are Okabe and Ito's, which
colour-blind readers can tell apart; where lines cross, their style differs too.
"""

import html
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import IPython.display
import mediapy
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clothlab._validation import choose
from clothlab.analysis import outline, principal_axes
from clothlab.method.control import ControlSettings
from clothlab.simulation.cloth import DAMPINGS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_DRAWINGS = Path(__file__).parents[1] / "docs" / "drawings"
PERIOD = ControlSettings.period  # control steps
_BLUE = 86, 180, 233  # two of the same colours, as pixels on black
_ORANGE = 213, 94, 0
STYLES = ("-", "--", "-.", ":")
MARKERS = {
    DAMPINGS[0]: "o",
    DAMPINGS[1]: "s",
    DAMPINGS[2]: "^",
    "soft": "o",
    "hard": "s",
}


class _Shown(Figure):
    """A figure that a notebook shows although pyplot has never been used.

    Its back end would show others.
    """

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """The picture, with its alternative text as metadata for web pages."""
        png = io.BytesIO()
        self.savefig(png, format="png")
        return png.getvalue(), {"alt": alt_text(self)}


def alt_text(figure: Figure) -> str:
    """A figure in a sentence for who can't see it: kind, titles, axes and legend."""
    panels = [ax for ax in figure.axes if ax.images or (ax.axison and ax.has_data())]
    charts = [ax for ax in panels if not ax.images]
    kinds = ["Pictures"] * (len(charts) < len(panels)) + ["Chart"] * bool(charts)
    of_lines = [ax.get_legend_handles_labels()[1] for ax in charts]
    said = {
        "": [ax.get_title() for ax in panels],
        "across: ": [ax.get_xlabel() for ax in charts],
        "up: ": [ax.get_ylabel() for ax in charts],
        "shown: ": [label for labels in of_lines for label in labels],
    }

    # Each label once, on one line and without marks of mathematical type
    parts = [" and ".join(kinds) or "Empty figure"]
    for before, labels in said.items():
        plain = [" ".join(label.replace("$", "").split()) for label in labels]
        different = ", ".join(dict.fromkeys(filter(None, plain)))
        if different:
            parts.append(before + different)
    return "; ".join(parts)


def new_axes(
    rows: int = 1,
    columns: int = 1,
    size: tuple[float, float] = (5.0, 3.2),
    **options: Any,
) -> tuple[Figure, np.ndarray]:
    """Figure and its axes `[rows, columns]`; `size` is that of one, in inches.

    It is made without pyplot: widgets may then draw in a thread of their own.
    """
    width, height = size
    figure = _Shown(figsize=(width * columns, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(alpha=0.25)
        ax.set_prop_cycle(color=COLOURS)
    return figure, axes


def _look(k: int) -> dict[str, Any]:
    """Colour and style of the k-th line."""
    return {"color": COLOURS[k % 7], "ls": STYLES[k % 4]}


def show_video(
    pictures: Sequence[np.ndarray], about: str, fps: int = 25, width: int = 480
) -> None:
    """Play pictures `[h, w, 3]` uint8 in the notebook, `width` pixels wide.

    `about` says what moves in them, for who can't see it.
    """
    mediapy.set_ffmpeg(imageio_ffmpeg.get_ffmpeg_exe())
    page = mediapy.show_video(
        pictures, fps=fps, width=width, codec="h264", return_html=True
    )
    seconds = len(pictures) / fps
    label = html.escape(f"{about}; a video of {seconds:.1f} s without sound")
    labelled = str(page).replace("<video ", f'<video aria-label="{label}" ', 1)
    IPython.display.display(IPython.display.HTML(labelled))


def drawing(name: str) -> IPython.display.SVG:
    """A drawing of `docs/drawings`, such as "method_training", "muscle_arm", "memory".

    Raises:
        KeyError: there is no such drawing; the message lists them.
    """
    files = {path.stem: path for path in sorted(_DRAWINGS.glob("*.svg"))}
    text = choose("drawing", name, files).read_text("utf-8")
    title = re.search("<title>(.*)</title>", text)
    words = html.unescape(title[1]) if title else name
    return IPython.display.SVG(text, metadata={"alt": words})


def larger(figure: Figure) -> Figure:
    """The figure with letters that a projector shows."""
    for ax in figure.axes:
        for text in (ax.title, ax.xaxis.label, ax.yaxis.label):
            text.set_fontsize(14)
        ax.tick_params(labelsize=13)
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes)]
    for legend in filter(None, legends):
        for text in legend.get_texts():
            text.set_fontsize(max(13, text.get_fontsize()))
    return figure


def over_target(image: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Cloth over its target, masks `[..., H, W]`, as `[..., H, W, 3]` uint8.

    White: in both; blue: the target alone; orange: the cloth alone. A decoded image
    counts as cloth above one half.
    """
    cloth, wanted = np.broadcast_arrays(image, target)
    cloth, wanted = cloth > 0.5, wanted > 0.5
    picture = np.zeros((*cloth.shape, 3), np.uint8)
    picture[wanted] = _BLUE
    picture[cloth] = _ORANGE
    picture[cloth & wanted] = 255
    return picture


def image_grid(
    images: Sequence[np.ndarray],
    titles: Sequence[str] = (),
    columns: int = 6,
    width: float = 2.0,
) -> Figure:
    """Images in rows, each `width` inches wide.

    They are `[h, w]` (0 to 1 or bool) or `[h, w, 3]` uint8.
    """
    images = [np.asarray(image) for image in images]
    if not images:
        raise ValueError("there is no image to show")
    if any(image.ndim not in (2, 3) for image in images):
        raise ValueError(
            "images are a list of [h, w] or [h, w, 3]: "
            "put a single one into a list, [image]"
        )

    # As high as the tallest image, with room for a title
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    height = width * max(image.shape[0] / image.shape[1] for image in images)
    title_height = 0.25 if len(titles) else 0.05
    figure, axes = new_axes(rows, columns, size=(width, height + title_height))

    # Some places of the last row may stay empty
    for ax in axes.flat:
        ax.axis("off")
    for ax, image in zip(axes.flat, images, strict=False):
        ax.imshow(image, cmap="gray", vmin=0, vmax=1 if image.ndim == 2 else None)
    for ax, title in zip(axes.flat, titles, strict=False):
        ax.set_title(title, fontsize=9)
    return figure


def film_strips(rows: dict[str, Sequence[np.ndarray]], titles: Sequence[str]) -> Figure:
    """Several runs of masks, one below the other: `{label: masks [T, H, W]}`.

    Each of the T columns has a title. All are cut to where cloth is in any of them.
    """
    masks = np.stack([*rows.values()])
    lines, columns = _with_cloth(masks)
    height, width = masks[0, 0, lines, columns].shape

    # As large as fits: 1.45 inches wide or 2.1 high, and a title
    across = min(1.45, 2.1 * width / height)
    size = (max(across, 0.8), across * height / width + 0.2)
    figure, axes = new_axes(len(rows), len(titles), size=size)
    for line, (label, images) in zip(axes, rows.items(), strict=True):
        line[0].set_ylabel(label, fontsize=12)
        for ax, image in zip(line, images, strict=True):
            ax.imshow(image[lines, columns], cmap="gray", vmin=0, vmax=1)
            ax.set(xticks=[], yticks=[])
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=12)
    return figure


def _with_cloth(masks: np.ndarray) -> tuple[slice, slice]:
    """Lines and columns of masks `[..., H, W]` with cloth in any, and a few around."""
    seen = np.any(masks.reshape(-1, *masks.shape[-2:]) > 0.5, axis=0)
    if not seen.any():
        return slice(None), slice(None)
    ranges = []
    for along in (seen.any(axis=1), seen.any(axis=0)):
        (places,) = np.nonzero(along)
        ranges.append(slice(max(places[0] - 4, 0), places[-1] + 5))
    return ranges[0], ranges[1]


def time_series(series: dict[str, np.ndarray], ylabel: str) -> Figure:
    """Quantities over the control steps of a run: `{label: [T]}`."""
    figure, ((ax,),) = new_axes(size=(8.0, 3.6))
    for k, (label, values) in enumerate(series.items()):
        seconds = np.arange(len(values)) * CONTROL_PERIOD
        ax.plot(seconds, values, lw=2.2, label=label, **_look(k))
    ax.set(xlabel="time [s]", ylabel=ylabel)
    figure.legend(loc="outside upper right", ncols=min(len(series), 4))
    return figure


def plans(shown: dict[str, np.ndarray], ylabel: str) -> Figure:
    """Plans of two angles, or slopes of them, as bars: `{title: [T, 2]}`, side by side.

    Angles count downwards, so down is down.
    """
    figure, axes = new_axes(1, len(shown), size=(4.6, 3.2), sharey=True)
    for ax, (title, plan) in zip(axes[0], shown.items(), strict=True):
        command = np.arange(1, len(plan) + 1)
        for k, (joint, hatch) in enumerate((("shoulder", ""), ("elbow", "//"))):
            look = {"color": COLOURS[k], "hatch": hatch, "ec": "white", "label": joint}
            ax.bar(command + 0.4 * k - 0.2, np.asarray(plan)[:, k], 0.4, **look)
        ax.axhline(0, color="0.3", lw=1)
        ax.set(title=title, xlabel="command of the plan", xticks=command)
    axes[0, 0].invert_yaxis()  # and that of all
    axes[0, 0].set_ylabel(ylabel)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper")
    return larger(figure)


def throws(
    runs: dict[str, np.ndarray], hoped: dict[str, np.ndarray] | None = None
) -> Figure:
    """Points over the control steps of runs, side by side: `{title: [T]}`.

    Step 0 is before any command. A dot is what happened at the end of a period, a
    diamond what was hoped for it, `{title: [P]}`.
    """
    figure, axes = new_axes(1, len(runs), size=(5.2, 3.4), sharey=True)
    for ax, (title, points) in zip(axes[0], runs.items(), strict=True):
        steps = np.arange(len(points))
        ax.plot(steps, points, lw=1.8, color=COLOURS[0])
        ends = steps[PERIOD::PERIOD]
        if hoped is not None:
            look = {"mfc": "white", "mec": "black", "mew": 2, "ms": 10, "ls": "none"}
            expected = hoped[title][: len(ends)]
            ax.plot(ends, expected, marker="D", label="hoped", **look)
        look = {"color": COLOURS[1], "ms": 8, "ls": "none"}
        ax.plot(ends, points[ends], marker="o", label="got", **look)
        for level in (0, 100):
            ax.axhline(level, color="0.35", ls="--", lw=1.2)
        ax.set(title=title, xlabel="control step")
    axes[0, 0].set_ylabel("points")
    last = axes[0, -1]
    for level, words in ((0, "still"), (100, "target")):
        beside = last.get_yaxis_transform()
        last.text(1.02, level, words, transform=beside, fontsize=12, va="center")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper")
    return larger(figure)


def material_map(
    biases: dict[str, np.ndarray],
    cloths: dict[str, Cloth],
    trajectories: dict[str, np.ndarray] | None = None,
    covariances: dict[str, np.ndarray] | None = None,
) -> Figure:
    """Parametric biases on their principal axes (the paper's figure on PB).

    The size of a marker is C_mass, its shape C_damp or the foam.

    Args:
        biases: trained p, `{material: [D_p]}`.
        cloths: of these the ones that are shown, `{material: cloth}`.
        trajectories: estimates over time, `{label: [T, D_p]}`, the last one ringed.
        covariances: `{label: [D_p, D_p]}` of last estimates, shown as 90 % regions.
    """
    pca = principal_axes(biases)
    figure, ((ax,),) = new_axes(size=(7.4, 5.4))

    # The trained ones
    for name, cloth in cloths.items():
        (place,) = pca.transform(biases[name][None])
        _mark(ax, cloth, place)

    # Those that are estimated
    for k, (label, path) in enumerate((trajectories or {}).items()):
        way = pca.transform(path)
        colour = COLOURS[k % 7]
        ax.plot(*way.T, lw=1.5, label=label, zorder=3, **_look(k))
        ax.scatter(*way[-1], s=130, facecolor="none", edgecolor=colour, lw=2, zorder=4)
        if covariances and label in covariances:
            across = pca.components_ @ covariances[label] @ pca.components_.T
            ax.fill(*outline(way[-1], across).T, color=colour, alpha=0.25, zorder=1)

    # Words
    first, second, *_ = pca.explained_variance_ratio_
    ax.margins(0.14)  # room for the labels
    ax.set_xlabel(f"PC1 ({first:.0%} of the variance)")
    ax.set_ylabel(f"PC2 ({second:.0%})")
    if not all(cloth.foam for cloth in cloths.values()):
        ax.set_title("labels: (C_damp [N s/m], C_mass [kg])", fontsize=12)
    if trajectories:
        columns = min(len(trajectories), 3)
        figure.legend(loc="outside lower center", fontsize=12, ncols=columns)
    return figure


def _mark(ax: Axes, cloth: Cloth, place: np.ndarray) -> None:
    """A cloth's marker, and its label beside it."""
    x, y = place
    ax.scatter(
        x,
        y,
        s=900 * cloth.mass,
        marker=MARKERS.get(cloth.foam or cloth.damping, "D"),
        color="0.6",
        edgecolor="0.1",
        zorder=2,
    )
    ax.annotate(
        cloth.label, (x, y), xytext=(8, 5), textcoords="offset points", fontsize=12
    )
