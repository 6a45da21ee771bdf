"""Figures that two notebooks, or a notebook and the lab, draw: each function takes arrays and returns a Figure.

Colours are Okabe and Ito's, which colour-blind readers can tell apart; where lines cross, their style differs too.
"""

import html
import io
from collections.abc import Sequence
from typing import Any

import cv2
import imageio_ffmpeg
import IPython.display
import mediapy
import numpy as np
from matplotlib.figure import Figure

from clothlab.alt_text import describe
from clothlab.analysis import principal_axes
from clothlab.learning.calibration import outline
from clothlab.learning.control import ControlSettings
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import DAMPINGS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.stiffness import static_posture

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":")
MARKERS = {DAMPINGS[0]: "o", DAMPINGS[1]: "s", DAMPINGS[2]: "^", "soft": "o", "hard": "s"}


class _Shown(Figure):
    """A figure that a notebook shows although pyplot, whose back end would show it, has never been used."""

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """The picture, and the figure in words as its metadata: web pages take `alt` from there."""
        png, words = io.BytesIO(), describe(self)
        self.savefig(png, format="png")
        return png.getvalue(), {"alt": words.summary, "details": list(words.details)}


def new_axes(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (5.0, 3.2), **options: Any
) -> tuple[Figure, np.ndarray]:
    """Figure and its axes `[rows, columns]`, made without pyplot: widgets may then draw in a thread of their own."""
    figure = _Shown(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(alpha=0.25)
    return figure, axes


def _look(k: int) -> dict[str, Any]:
    """Colour and style of the k-th line."""
    return {"color": COLOURS[k % 7], "ls": STYLES[k % 4]}


def show_video(pictures: Sequence[np.ndarray], about: str, fps: int = 25, width: int = 480) -> None:
    """Play pictures `[h, w, 3]` uint8 in the notebook, `width` pixels wide; `about` says what moves in them."""
    mediapy.set_ffmpeg(imageio_ffmpeg.get_ffmpeg_exe())
    page = mediapy.show_video(pictures, fps=fps, width=width, codec="h264", return_html=True)
    label = html.escape(f"{about}; a video of {len(pictures) / fps:.1f} s without sound")
    IPython.display.display(IPython.display.HTML(str(page).replace("<video ", f'<video aria-label="{label}" ', 1)))


def captioned(picture: np.ndarray, text: str) -> np.ndarray:
    """The picture `[h, w, 3]` uint8 with a line of text in its upper left corner, as high as a sixteenth of it."""
    size = picture.shape[0] / 16 / 22  # OpenCV's capitals are 22 pixels high
    place, thick = (round(12 * size) + 2, round(36 * size) + 2), max(1, round(2 * size))
    return cv2.putText(picture.copy(), text, place, cv2.FONT_HERSHEY_SIMPLEX, size, (20, 20, 20), thick, cv2.LINE_AA)


def loss_curves(curves: dict[str, Sequence[float]], ylabel: str) -> Figure:
    """Training losses over epochs, on a logarithmic scale: `{label: loss of each epoch}`."""
    figure, ((ax,),) = new_axes()
    for k, (label, losses) in enumerate(curves.items()):
        ax.semilogy(np.arange(1, len(losses) + 1), losses, label=label, **_look(k))
    ax.set(xlabel="epoch", ylabel=ylabel)
    ax.legend()
    return figure


def image_grid(
    images: Sequence[np.ndarray], titles: Sequence[str] = (), columns: int = 6, width: float = 2.0
) -> Figure:
    """Images `[h, w]` (0 to 1 or bool) or `[h, w, 3]` uint8 in rows, each `width` inches wide."""
    if not len(images):
        raise ValueError("there is no image to show")
    columns = min(columns, len(images))
    height = width * max(image.shape[0] / image.shape[1] for image in images)
    title_height = 0.25 if len(titles) else 0.05
    figure, axes = new_axes(-(-len(images) // columns), columns, size=(width, height + title_height))
    for ax in axes.flat:
        ax.axis("off")
    for ax, image in zip(axes.flat, images, strict=False):
        ax.imshow(image, cmap="gray", vmin=0, vmax=1 if image.ndim == 2 else None)
    for ax, title in zip(axes.flat, titles, strict=False):
        ax.set_title(title, fontsize=9)
    return figure


def film_strips(rows: dict[str, Sequence[np.ndarray]], titles: Sequence[str]) -> Figure:
    """Several runs of masks, one below the other: `{label: masks [T, H, W]}`, and a title for each of the T columns."""
    figure, axes = new_axes(len(rows), len(titles), size=(1.3, 1.05))
    for line, (label, images) in zip(axes, rows.items(), strict=True):
        line[0].set_ylabel(label, fontsize=9)
        for ax, image, title in zip(line, images, titles, strict=True):
            ax.imshow(image, cmap="gray", vmin=0, vmax=1)
            ax.set(xticks=[], yticks=[], label=f"{label}, {title}")  # the label is for `alt_text`
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=9)
    return figure


def time_series(series: dict[str, np.ndarray], ylabel: str) -> Figure:
    """Quantities over the control steps of a run: `{label: [T]}`."""
    figure, ((ax,),) = new_axes(size=(8.0, 2.8))
    for k, (label, values) in enumerate(series.items()):
        ax.plot(np.arange(len(values)) * CONTROL_PERIOD, values, label=label, **_look(k))
    ax.set(xlabel="time [s]", ylabel=ylabel)
    figure.legend(loc="outside upper right", ncols=min(len(series), 4))
    return figure


def material_map(
    biases: dict[str, np.ndarray],
    cloths: dict[str, Cloth],
    trajectories: dict[str, np.ndarray] | None = None,
    covariances: dict[str, np.ndarray] | None = None,
) -> Figure:
    """Parametric biases on their principal axes, with online trajectories (the paper's figure on PB in simulation).

    `trajectories` are estimates over time `{label: [T, D_p]}`, the last one ringed, with a 90 % region where there are
    `covariances` `{label: [D_p, D_p]}`. The size of a marker is C_mass, its shape C_damp or the foam.
    """
    pca = principal_axes(biases)
    figure, ((ax,),) = new_axes(size=(6.4, 5.0))
    for name, cloth in cloths.items():
        (place,) = pca.transform(biases[name][None])
        marker = MARKERS.get(cloth.foam or cloth.damping, "D")
        ax.scatter(*place, s=900 * cloth.mass, marker=marker, color="0.75", edgecolor="0.2", zorder=2)
        ax.annotate(cloth.label, place, xytext=(8, 5), textcoords="offset points", fontsize=8)
    for k, (label, path) in enumerate((trajectories or {}).items()):
        ways, colour = pca.transform(path), COLOURS[k % 7]
        ax.plot(*ways.T, lw=1.5, label=label, zorder=3, **_look(k))
        ax.scatter(*ways[-1], s=130, facecolor="none", edgecolor=colour, lw=2, zorder=4)
        if covariances and label in covariances:
            across = pca.components_ @ covariances[label] @ pca.components_.T
            ax.fill(*outline(ways[-1], across).T, color=colour, alpha=0.25, zorder=1)
    share = pca.explained_variance_ratio_
    ax.margins(0.14)  # room for the labels
    ax.set(xlabel=f"PC1 ({share[0]:.0%} of the variance)", ylabel=f"PC2 ({share[1]:.0%})")
    if not all(cloth.foam for cloth in cloths.values()):
        ax.set_title("labels: (C_damp [N s/m], C_mass [kg])", fontsize=9)
    if trajectories:
        figure.legend(loc="outside lower center", fontsize=8, ncols=min(len(trajectories), 3))
    return figure


def distance_transition(
    distances: dict[str, np.ndarray], baselines: dict[str, float] | None = None, period: int = ControlSettings.period
) -> Figure:
    """Distance to the target over time, each period's best marked (the paper's figure on the integrated experiment).

    `distances` are `{label: [T]}`, `baselines` those that stay, `{label: distance}`, as of a cloth that hangs still.
    """
    figure, ((ax,),) = new_axes(size=(8.0, 2.8))
    for k, (label, distance) in enumerate(distances.items()):
        ax.plot(np.arange(len(distance)) * CONTROL_PERIOD, distance, lw=1, label=label, **_look(k))
        whole = len(distance) // period * period
        best = np.reshape(distance[:whole], (-1, period)).argmin(axis=1) + np.arange(0, whole, period)
        ax.plot(best * CONTROL_PERIOD, np.asarray(distance)[best], "o", ms=4, color=COLOURS[k % 7])
    for (label, level), style in zip((baselines or {}).items(), ("--", ":", "-."), strict=False):
        ax.axhline(level, color="0.35", ls=style, lw=1.5, label=label)
    ax.set(xlabel="time [s]", ylabel="‖z_ref - z‖ [s.d. of z]", ylim=(0, None))
    figure.legend(loc="outside upper right", ncols=4)
    return figure


def ellipse_at_hand(
    arm: MuscleArm, theta: np.ndarray, f_const: float | Sequence[float], enlarged: float = 10.0
) -> Figure:
    """The arm from the side, and where a push of 1 N from any direction would move its hand.

    In the posture θ `[2]` [rad], with one or several co-contractions [N]; displacements are `enlarged` beside the arm.
    """
    angles, tensions = np.linspace(0, 2 * np.pi, 25), np.atleast_1d(f_const)
    theta = np.clip(theta, arm.lower, arm.upper)
    hand = arm.hand(theta)
    elbow = arm.link_length * np.array([np.cos(theta[0]), -np.sin(theta[0])])
    alone = len(tensions) == 1
    figure, ((ax,),) = new_axes(size=(4.0, 3.6) if alone else (6.4, 4.4))
    ax.plot(*np.array([[0, 0], elbow, hand]).T, "o-", color="0.6" if alone else "0.85", lw=6, zorder=1)
    for k, tension in enumerate(tensions):
        pushed = [static_posture(arm, [*theta, tension], np.array([np.cos(a), np.sin(a)])) for a in angles]
        ellipse = hand + enlarged * (np.array([arm.hand(each) for each in pushed]) - hand)
        ax.plot(*ellipse.T, lw=2, label=f"{tension:.0f} N", **_look(k))
    ax.set(aspect="equal", xlabel="forward [m]", ylabel="up [m]")
    ax.set_title(f"displacement by 1 N, enlarged {enlarged:g} times", fontsize=9)
    if alone:
        ax.set(xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))  # the same for every posture
    else:
        figure.legend(loc="outside right center", title="f_const")
    return figure


def success_curves(
    cases: dict[str, dict[str, np.ndarray]],
    thresholds: np.ndarray,
    xlabel: str = "threshold [s.d. of z]",
    ylabel: str = "rate of ‖z_ref - z‖ < threshold",
) -> Figure:
    """Rates `{case: {label: [R, N]}}` over N thresholds, mean and standard deviation over R repeats, a panel a case."""
    figure, axes = new_axes(1, len(cases), size=(3.3, 3.0), sharex=True, sharey=True)
    for ax, (case, curves) in zip(axes.flat, cases.items(), strict=True):
        for k, (label, rates) in enumerate(curves.items()):
            mean, deviation = np.mean(rates, axis=0), np.std(rates, axis=0)
            ax.plot(thresholds, mean, label=label, **_look(k))
            ax.fill_between(thresholds, mean - deviation, mean + deviation, color=COLOURS[k % 7], alpha=0.2, lw=0)
        ax.set(title=case, xlabel=xlabel, ylim=(0, 1.02))
    axes[0, 0].set_ylabel(ylabel)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center")
    return figure


def chamfer_scatter(log_chamfer: np.ndarray, z_distance: np.ndarray) -> Figure:
    """Distance in z against the logarithm of the chamfer distance (the paper's last figure on simulation)."""
    figure, ((ax,),) = new_axes()
    ax.scatter(log_chamfer, z_distance, s=10, alpha=0.5, color=COLOURS[0], edgecolor="none")
    r = np.corrcoef(log_chamfer, z_distance)[0, 1]
    slope, offset = np.polyfit(log_chamfer, z_distance, 1)
    ends = np.array([log_chamfer.min(), log_chamfer.max()])
    ax.plot(ends, slope * ends + offset, "--", color=COLOURS[1], label=f"correlation {r:.3f}")
    ax.set(xlabel="log chamfer distance [log pixel]", ylabel="‖z_ref - z‖ [s.d. of z]")
    ax.legend()
    return figure


def dots(rows: dict[str, dict[str, np.ndarray]], xlabel: str) -> Figure:
    """A row of dots for each label, the uppermost first, and their median as a bar: `{label: {group: values [N]}}`."""
    groups = list(dict.fromkeys(group for row in rows.values() for group in row))
    figure, ((ax,),) = new_axes(size=(8.0, 0.9 + 0.27 * len(rows)))
    for k, group in enumerate(groups):
        look: dict[str, Any] = {"color": COLOURS[k], "marker": "osD^"[k % 4]}
        for n, row in enumerate(rows.values()):
            y = n + 0.3 * (k - (len(groups) - 1) / 2)
            ax.plot(row[group], np.full(len(row[group]), y), ls="none", ms=4, alpha=0.6, **look)
            ax.plot([np.median(row[group])] * 2, [y - 0.18, y + 0.18], color=COLOURS[k], lw=2.5)
        ax.plot([], [], ls="none", label=group, **look)
    ax.set_yticks(range(len(rows)), rows)
    ax.set(xlabel=xlabel, ylim=(len(rows) - 0.5, -0.5))
    ax.legend(fontsize=8)
    return figure
