"""One function per figure: each takes results and returns a matplotlib Figure.

Colours are Okabe and Ito's, which colour-blind readers can tell apart; where lines cross, their style differs too.
"""

import html
import io
from collections.abc import Sequence
from typing import Any, Protocol

import cv2
import imageio_ffmpeg
import IPython.display
import mediapy
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binom

from clothlab.alt_text import describe
from clothlab.analysis import Landscape, principal_axes
from clothlab.learning.calibration import outline
from clothlab.learning.control import ControlSettings
from clothlab.simulation.arm import Arm, MuscleArm
from clothlab.simulation.cloth import DAMPINGS, Cloth
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.simulation.stiffness import static_posture
from clothlab.table_scene.perception import PointCloud
from clothlab.trials import Trial

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":")
MARKERS = {DAMPINGS[0]: "o", DAMPINGS[1]: "s", DAMPINGS[2]: "^", "soft": "o", "hard": "s"}


class Curves(Protocol):
    """A record of quantities that depend on the amount of experience, such as that of `experiments.experience`."""

    def curves(self) -> dict[str, dict[str, np.ndarray]]:
        """Each quantity by arm, `{quantity: {arm: [amounts, trainings]}}`."""

    def steps(self, arm: str) -> dict[float, int]:
        """Control steps that were learned from, by amount."""

    def marks(self) -> dict[str, float]:
        """Amounts to point out, by label."""


class Motion(Protocol):
    """A run whose arm was watched, such as those of `experiments.stiffness`."""

    commands: np.ndarray
    theta: np.ndarray
    distance: np.ndarray


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


def show_video(pictures: Sequence[np.ndarray], about: str, fps: int = 25, width: int = 480) -> None:
    """Play pictures `[h, w, 3]` uint8 in the notebook.

    Args:
        pictures: one for each frame.
        about: what moves in them, for who cannot see it.
        fps: frames a second.
        width: on the page [pixel].
    """
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
    """Training losses over epochs, on a logarithmic scale.

    Args:
        curves: `{label: loss of each epoch}`.
        ylabel: what the loss is, with its unit.
    """
    figure, axes = new_axes()
    ax = axes[0, 0]
    for k, (label, losses) in enumerate(curves.items()):
        ax.semilogy(np.arange(1, len(losses) + 1), losses, STYLES[k % 4], color=COLOURS[k % 7], label=label)
    ax.set(xlabel="epoch", ylabel=ylabel)
    ax.legend()
    return figure


def image_grid(
    images: Sequence[np.ndarray], titles: Sequence[str] | None = None, columns: int = 6, width: float = 2.0
) -> Figure:
    """Pictures or masks in rows.

    Args:
        images: each `[h, w]` (0 to 1 or bool) or `[h, w, 3]` uint8.
        titles: one for each image.
        columns: images in a row.
        width: of each [inch].
    """
    if not len(images):
        raise ValueError("there is no image to show")
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    high = width * max(image.shape[0] / image.shape[1] for image in images)
    figure, axes = new_axes(rows, columns, size=(width, high + (0.25 if titles is not None else 0.05)))
    for ax in axes.flat:
        ax.axis("off")
    for k, (ax, image) in enumerate(zip(axes.flat, images, strict=False)):
        ax.imshow(image, cmap="gray", vmin=0, vmax=1 if image.ndim == 2 else None)
        if titles is not None:
            ax.set_title(titles[k], fontsize=9)
    return figure


def film_strips(rows: dict[str, Sequence[np.ndarray]], titles: Sequence[str]) -> Figure:
    """Several runs of images, one below the other.

    Args:
        rows: `{label: masks [T, H, W]}`.
        titles: one for each of the T columns.
    """
    figure, axes = new_axes(len(rows), len(titles), size=(1.3, 1.05))
    for line, (label, images) in zip(axes, rows.items(), strict=True):
        line[0].set_ylabel(label, fontsize=9)
        for ax, image in zip(line, images, strict=True):
            ax.imshow(image, cmap="gray", vmin=0, vmax=1)
            ax.set(xticks=[], yticks=[])
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=9)
    return figure


def time_series(series: dict[str, np.ndarray], ylabel: str, time: np.ndarray | None = None) -> Figure:
    """Quantities over time.

    Args:
        series: `{label: [T]}`.
        ylabel: what they are, with their unit.
        time: `[T]` [s]; control steps when left out.
    """
    figure, axes = new_axes(size=(8.0, 2.8))
    ax = axes[0, 0]
    for k, (label, values) in enumerate(series.items()):
        t = np.arange(len(values)) * CONTROL_PERIOD if time is None else time
        ax.plot(t, values, STYLES[k % 4], color=COLOURS[k % 7], label=label)
    ax.set(xlabel="time [s]", ylabel=ylabel)
    figure.legend(loc="outside upper right", ncols=min(len(series), 4))
    return figure


def trial_traces(trial: Trial, arm: Arm) -> Figure:
    """Commands as steps, one panel for each, and the joint angles that follow them where the robot senses them."""
    figure, axes = new_axes(len(arm.command_names), size=(8.0, 1.9), sharex=True)
    for k, ax in enumerate(axes[:, 0]):
        ax.step(trial.time, trial.commands[:, k], "--", where="post", color=COLOURS[1], label="commanded")
        ax.set_ylabel(arm.command_names[k])
    for ax, angle in zip(axes[:, 0], trial.robot[:, arm.sensed_angles].T, strict=False):
        ax.plot(trial.time, angle, color=COLOURS[0], label="measured")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    axes[-1, 0].set_xlabel("time [s]")
    return figure


def cloth_profiles(profiles: dict[str, Sequence[np.ndarray]]) -> Figure:
    """Side views of a cloth at several moments, one panel for each label.

    Args:
        profiles: `{label: points of each moment [rows, columns, 3] [m]}`; later moments are drawn darker.
    """
    figure, axes = new_axes(1, len(profiles), size=(3.2, 3.2), sharex=True, sharey=True)
    for ax, (label, moments) in zip(axes.flat, profiles.items(), strict=True):
        for k, points in enumerate(moments):
            side = points.mean(axis=1)
            ax.plot(side[:, 0], side[:, 2], "o-", ms=3, color=COLOURS[0], alpha=0.15 + 0.85 * (k + 1) / len(moments))
        ax.set(title=label, xlabel="forward x [m]", aspect="equal")
    axes[0, 0].set_ylabel("height z [m]")
    return figure


def material_map(
    biases: dict[str, np.ndarray],
    cloths: dict[str, Cloth],
    trajectories: dict[str, np.ndarray] | None = None,
    covariances: dict[str, np.ndarray] | None = None,
) -> Figure:
    """Parametric biases on their principal axes, with online trajectories (the paper's figure on PB in simulation).

    Args:
        biases: trained p of each material `{name: [D_p]}`.
        cloths: the materials; the larger the mass, the larger the marker, whose shape is C_damp's or the foam's.
        trajectories: estimates over time `{label: [T, D_p]}`; the last one is ringed.
        covariances: how sure the last one is `{label: [D_p, D_p]}`: its 90 % region is drawn.
    """
    pca = principal_axes(biases)
    figure, axes = new_axes(size=(6.4, 5.0))
    ax = axes[0, 0]
    for name, cloth in cloths.items():
        x, y = pca.transform(biases[name][None])[0]
        ax.scatter(
            x,
            y,
            s=900 * cloth.mass,
            marker=MARKERS.get(cloth.foam or cloth.damping, "D"),
            color="0.75",
            edgecolor="0.2",
            zorder=2,
        )
        ax.annotate(cloth.label, (x, y), xytext=(8, 5), textcoords="offset points", fontsize=8)
    covariances = covariances or {}
    for k, (label, path) in enumerate((trajectories or {}).items()):
        x, y = pca.transform(path).T
        ax.plot(x, y, STYLES[k % 4], color=COLOURS[k % 7], lw=1.5, label=label, zorder=3)
        ax.scatter(x[-1], y[-1], s=130, facecolor="none", edgecolor=COLOURS[k % 7], lw=2, zorder=4)
        if label in covariances:
            across = pca.components_ @ covariances[label] @ pca.components_.T
            ax.fill(*outline((x[-1], y[-1]), across).T, color=COLOURS[k % 7], alpha=0.25, zorder=1)
    share = pca.explained_variance_ratio_
    ax.margins(0.14)  # room for the labels
    ax.set(xlabel=f"PC1 ({share[0]:.0%} of the variance)", ylabel=f"PC2 ({share[1]:.0%})")
    if not all(cloth.foam for cloth in cloths.values()):
        ax.set_title("labels: (C_damp [N s/m], C_mass [kg])", fontsize=9)
    if trajectories:
        figure.legend(loc="outside lower center", fontsize=8, ncols=min(len(trajectories), 3))
    return figure


def loss_landscapes(
    landscapes: dict[str, Landscape],
    biases: dict[str, np.ndarray],
    right: str | None = None,
    paths: dict[str, np.ndarray] | None = None,
) -> Figure:
    """Loss over the plane of p, in units of its lowest value, a panel for each run.

    Args:
        landscapes: `{title: landscape}`.
        biases: trained p of each material, drawn as dots.
        right: name of the material in the hand, which is ringed.
        paths: estimates over time to draw into the panel of the same title, `{title: [T, D_p]}`.
    """
    figure, axes = new_axes(1, len(landscapes), size=(4.4, 3.8), sharex=True, sharey=True)
    heights = [ground.loss / ground.loss.min() for ground in landscapes.values()]
    levels = np.geomspace(1, max(height.max() for height in heights), 20)  # one scale for all panels
    for ax, (title, ground), height in zip(axes.flat, landscapes.items(), heights, strict=True):
        filled = ax.contourf(ground.x, ground.y, height, levels=levels, cmap="Blues")
        places = ground.axes.transform(np.stack(list(biases.values())))
        ax.scatter(*places.T, s=20, color="0.2", label="trained p")
        ax.plot(*ground.axes.transform(np.zeros((1, len(places.T))))[0], "x", color="k", ms=8, mew=2, label="p = 0")
        if right is not None:
            ring = ground.axes.transform(biases[right][None])[0]
            ax.scatter(*ring, s=160, facecolor="none", edgecolor=COLOURS[1], lw=2.5, label="right p")
        if paths and title in paths:
            path = ground.axes.transform(paths[title])
            ax.plot(*path.T, "-", color=COLOURS[4], lw=2, label="estimate")
            ax.plot(*path[-1], "D", color=COLOURS[4], ms=8, mec="black")
        ax.set(title=title, xlabel="PC1")
        ax.locator_params(nbins=5)
    axes[0, 0].set_ylabel("PC2")
    figure.colorbar(filled, ax=axes[0, -1], label="L over the lowest L", format="%.2f")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


def predicted_states(truth: np.ndarray, predictions: dict[str, np.ndarray], names: Sequence[str]) -> Figure:
    """Measured and predicted states over the steps of a prediction, a panel for each state.

    Args:
        truth: `[T, N]`.
        predictions: `{label: [T, N]}`.
        names: of the N states, with units.
    """
    figure, axes = new_axes(1, len(names), size=(3.2, 2.6))
    t = np.arange(len(truth)) * CONTROL_PERIOD
    for n, (ax, name) in enumerate(zip(axes.flat, names, strict=True)):
        ax.plot(t, truth[:, n], color="0.3", lw=3, alpha=0.5, label="measured")
        for k, (label, predicted) in enumerate(predictions.items()):
            ax.plot(t, predicted[:, n], STYLES[k % 4], color=COLOURS[k % 7], label=label)
        ax.set(xlabel="time [s]", title=name)
    axes[0, 0].legend(fontsize=8)
    return figure


def distance_transition(
    distances: dict[str, np.ndarray], baselines: dict[str, float] | None = None, period: int = ControlSettings.period
) -> Figure:
    """Distance to the target over time, each period's best marked (the paper's figure on the integrated experiment).

    Args:
        distances: `{label: ‖z_ref - z‖₂ [T]}`.
        baselines: distances that stay, `{label: ‖z_ref - z‖₂}`, such as that of a cloth that hangs still.
        period: control steps of one period.
    """
    figure, axes = new_axes(size=(8.0, 2.8))
    ax = axes[0, 0]
    for k, (label, distance) in enumerate(distances.items()):
        colour, distance = COLOURS[k % 7], np.asarray(distance)
        ax.plot(np.arange(len(distance)) * CONTROL_PERIOD, distance, STYLES[k % 4], color=colour, lw=1, label=label)
        whole = len(distance) // period * period
        best = distance[:whole].reshape(-1, period).argmin(axis=1) + np.arange(0, whole, period)
        ax.plot(best * CONTROL_PERIOD, distance[best], "o", ms=4, color=colour)
    for (label, level), style in zip((baselines or {}).items(), ("--", ":", "-."), strict=False):
        ax.axhline(level, color="0.35", ls=style, lw=1.5, label=label)
    ax.set(xlabel="time [s]", ylabel="‖z_ref - z‖ [s.d. of z]", ylim=(0, None))
    figure.legend(loc="outside upper right", ncols=4)
    return figure


def ellipse_at_hand(
    arm: MuscleArm, theta: np.ndarray, f_const: float | Sequence[float], enlarged: float = 10.0
) -> Figure:
    """The arm from the side, and where a push of 1 N from any direction would move its hand.

    Args:
        arm: a muscle arm.
        theta: posture `[2]` [rad].
        f_const: co-contraction, one or several [N].
        enlarged: how much larger than the arm the displacements are drawn.
    """
    angles, tensions = np.linspace(0, 2 * np.pi, 25), np.atleast_1d(f_const)
    theta = np.clip(theta, arm.lower, arm.upper)
    hand = arm.hand(theta)
    elbow = arm.link_length * np.array([np.cos(theta[0]), -np.sin(theta[0])])
    figure, axes = new_axes(size=(4.0, 3.6) if len(tensions) == 1 else (6.4, 4.4))
    ax = axes[0, 0]
    ax.plot(*np.array([[0, 0], elbow, hand]).T, "o-", color="0.6" if len(tensions) == 1 else "0.85", lw=6, zorder=1)
    for k, tension in enumerate(tensions):
        pushed = [static_posture(arm, [*theta, tension], np.array([np.cos(a), np.sin(a)])) for a in angles]
        ellipse = hand + enlarged * (np.array([arm.hand(each) for each in pushed]) - hand)
        ax.plot(*ellipse.T, STYLES[k % 4], color=COLOURS[k % 7], lw=2, label=f"{tension:.0f} N")
    ax.set(aspect="equal", xlabel="forward [m]", ylabel="up [m]")
    if len(tensions) == 1:  # which goes with others of other postures
        ax.set(xlim=(-0.35, 1.0), ylim=(-0.75, 0.75))
    told = f"{tensions[0]:.0f} N; d" if len(tensions) == 1 else "D"
    ax.set_title(f"{told}isplacement by 1 N, enlarged {enlarged:g} times", fontsize=9)
    if len(tensions) > 1:
        figure.legend(loc="outside right center", title="f_const")
    return figure


def success_curves(
    cases: dict[str, dict[str, np.ndarray]],
    thresholds: np.ndarray,
    xlabel: str = "threshold [s.d. of z]",
    ylabel: str = "rate of ‖z_ref - z‖ < threshold",
) -> Figure:
    """Rate of steps below a threshold, mean and standard deviation over repeats, a panel for each case.

    Args:
        cases: `{case: {label: rates of each repeat [R, N]}}`.
        thresholds: `[N]`, in standard deviations of z; or whatever else success depends on.
        xlabel: what they are.
        ylabel: of what the rates are.
    """
    figure, axes = new_axes(1, len(cases), size=(3.3, 3.0), sharex=True, sharey=True)
    for ax, (case, curves) in zip(axes.flat, cases.items(), strict=True):
        for k, (label, rates) in enumerate(curves.items()):
            mean, deviation = np.mean(rates, axis=0), np.std(rates, axis=0)
            ax.plot(thresholds, mean, STYLES[k % 4], color=COLOURS[k % 7], label=label)
            ax.fill_between(thresholds, mean - deviation, mean + deviation, color=COLOURS[k % 7], alpha=0.2, lw=0)
        ax.set(title=case, xlabel=xlabel, ylim=(0, 1.02))
    axes[0, 0].set_ylabel(ylabel)
    axes[0, 0].legend(fontsize=8)
    return figure


def arm_motion(runs: dict[str, Motion], until: int = 40, period: int = ControlSettings.period) -> Figure:
    """Commands, joint angles and distance to the target, a column a run (the paper's figure on the robot).

    Shaded: while the arm comes down, from the moment at which the shoulder's target is highest to the period's end.
    Dashed, below: the distance with which a run begins, of a cloth that hangs still.

    Args:
        runs: `{title: run}` of an arm whose first commands are angles, positive downwards, and whose last is f_const.
        until: control steps that are shown.
        period: control steps of one period.
    """
    names = ("θ shoulder [rad]", "θ elbow [rad]", "f_const [N]", "distance [s.d. of z]")
    figure, axes = new_axes(len(names), len(runs), size=(6.0, 1.75), sharex=True, sharey="row")
    t, fine = np.arange(until) * CONTROL_PERIOD, np.arange(1, 10 * until + 1) * CONTROL_PERIOD / 10
    for column, (title, run) in zip(axes.T, runs.items(), strict=True):
        for n, ax in enumerate(column[:3]):
            ax.step(t, run.commands[:until, n], "--", where="post", color=COLOURS[1], label="commanded")
        for ax, angle in zip(column, run.theta[: 10 * until].T, strict=False):
            ax.plot(fine, angle, color=COLOURS[0], label="measured")
        column[3].plot(t, run.distance[:until], "o-", ms=3, color=COLOURS[3])
        column[3].axhline(run.distance[0], color="0.35", ls="--", lw=1)
        for start in range(0, until - period + 1, period):
            highest = start + run.commands[start : start + period, 0].argmin()
            for ax in column:
                ax.axvspan(highest * CONTROL_PERIOD, (start + period) * CONTROL_PERIOD, color="0.92", zorder=0)
        column[0].set_title(title)
        column[3].set(xlabel="time [s]", ylim=(0, None))
    for ax, name in zip(axes[:, 0], names, strict=True):
        ax.set_ylabel(name)
    axes[2, 0].set_ylim(0, 75)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return figure


def bars(panels: dict[str, dict[str, dict[str, np.ndarray]]]) -> Figure:
    """Mean and standard deviation as bars, a row for each quantity, a column for each case; a dot for each repeat.

    Args:
        panels: `{quantity, with its unit: {case: {label: values of the repeats [R]}}}`.
    """
    cases = list(next(iter(panels.values())))
    figure, axes = new_axes(len(panels), len(cases), size=(3.6, 1.9), sharex=True, sharey="row")
    for row, (quantity, columns) in zip(axes, panels.items(), strict=True):
        row[0].set_ylabel(quantity)
        for ax, case in zip(row, cases, strict=True):
            for k, (label, values) in enumerate(columns[case].items()):
                look: dict[str, Any] = {"color": COLOURS[k % 7], "hatch": ("", "//", "..", "xx")[k % 4]}
                ax.bar(label, np.mean(values), 0.6, yerr=np.std(values), capsize=4, alpha=0.6, **look)
                places = k + np.linspace(-0.15, 0.15, len(values))
                ax.plot(places, values, "o", ms=3, color="black", zorder=3, clip_on=False)
        row[0].set_ylim(0, None)
    for ax, case in zip(axes[0], cases, strict=True):
        ax.set_title(case)
    return figure


def chamfer_scatter(log_chamfer: np.ndarray, z_distance: np.ndarray) -> Figure:
    """Distance in z against the logarithm of the chamfer distance (the paper's last figure on simulation)."""
    figure, axes = new_axes()
    ax = axes[0, 0]
    ax.scatter(log_chamfer, z_distance, s=10, alpha=0.5, color=COLOURS[0], edgecolor="none")
    r = np.corrcoef(log_chamfer, z_distance)[0, 1]
    slope, offset = np.polyfit(log_chamfer, z_distance, 1)
    ends = np.array([log_chamfer.min(), log_chamfer.max()])
    ax.plot(ends, slope * ends + offset, "--", color=COLOURS[1], label=f"correlation {r:.3f}")
    ax.set(xlabel="log chamfer distance [log pixel]", ylabel="‖z_ref - z‖ [s.d. of z]")
    ax.legend()
    return figure


def experience(record: Curves, columns: int = 5) -> Figure:
    """What grows with the number of recorded steps: mean and standard deviation over trainings, a panel a quantity.

    Args:
        record: of the experiment on experience.
        columns: panels in a row.
    """
    curves = record.curves()
    looks = {arm: k for k, arm in enumerate(dict.fromkeys(arm for arms in curves.values() for arm in arms))}
    figure, axes = new_axes(-(-len(curves) // columns), columns, size=(2.9, 2.4))
    for ax in axes.flat[len(curves) :]:
        ax.axis("off")
    for ax, (quantity, arms) in zip(axes.flat, curves.items(), strict=False):
        for arm, values in arms.items():
            steps, colour = record.steps(arm), COLOURS[looks[arm]]
            mean, deviation = values.mean(axis=1), values.std(axis=1)
            ax.plot(list(steps.values()), mean, STYLES[looks[arm]], marker=".", color=colour, label=f"{arm} arm")
            ax.fill_between(list(steps.values()), mean - deviation, mean + deviation, color=colour, alpha=0.2, lw=0)
            at = dict(zip(steps, zip(steps.values(), mean, strict=True), strict=True))
            for amount, marker in zip(record.marks().values(), "oD", strict=True):
                if amount in at:
                    ax.scatter(*at[amount], s=40, marker=marker, color=colour, edgecolor="black", zorder=3)
        ax.set(xscale="log", xlabel="steps learned from")
        ax.set_title(quantity, fontsize=9)
    for label, marker in zip(record.marks(), "oD", strict=True):
        axes[0, 0].scatter([], [], marker=marker, color="white", edgecolor="black", label=label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def promise_scatter(panels: dict[str, tuple[np.ndarray, np.ndarray]], picked: int = 10) -> Figure:
    """Promised distance against the one that came, a panel for each target; the best promises stand out.

    Args:
        panels: `{title: (promised [N], came [N])}`, distances to the target [s.d. of z].
        picked: how many of the best promises.
    """
    figure, axes = new_axes(1, len(panels), size=(3.4, 3.2))
    for ax, (title, (promised, came)) in zip(axes[0], panels.items(), strict=True):
        best, end = np.argsort(promised)[:picked], 1.05 * max(np.max(promised), np.max(came))
        ax.plot([0, end], [0, end], color="0.35", ls="--", lw=1, label="as promised")
        ax.scatter(promised, came, s=10, alpha=0.5, color=COLOURS[0], edgecolor="none", label="a plan")
        look: dict[str, Any] = {"s": 28, "marker": "D", "color": COLOURS[1], "edgecolor": "black"}
        ax.scatter(promised[best], came[best], label=f"the {picked} best promises", **look)
        ax.set(xlabel="promised ‖z_ref - z‖ [s.d. of z]", title=title, xlim=(0, end), ylim=(0, end), aspect="equal")
    axes[0, 0].set_ylabel("came [s.d. of z]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def period_bests(series: dict[str, np.ndarray], baselines: dict[str, float], ax: Axes | None = None) -> Figure:
    """Each period's distance to the target, on a logarithmic scale.

    Args:
        series: `{label: distance in each period, from the second on [periods] or one row a run [runs, periods]}`;
            of several runs, each is a thin line and their median a thick one [s.d. of z].
        baselines: distances that stay, by label [s.d. of z].
        ax: where to draw; else on a figure of its own.
    """
    figure: Any = ax.figure if ax else None
    if ax is None:
        figure, ((ax,),) = new_axes(size=(7.0, 3.2))
    for k, (label, values) in enumerate(series.items()):
        rows: np.ndarray = np.atleast_2d(values)
        look: dict[str, Any] = {"color": COLOURS[k % 7], "ls": STYLES[k % 4]}
        periods = np.arange(2, rows.shape[1] + 2)
        for row in rows if len(rows) > 1 else ():
            ax.plot(periods, row, lw=0.8, alpha=0.5, **look)
        ax.plot(periods, np.median(rows, axis=0), lw=2, marker="os"[k % 2], ms=3, label=label, **look)
    for k, (label, level) in enumerate(baselines.items()):
        style = ("--", ":", "-.", (0, (8, 2, 1, 2, 1, 2)), "-")[k % 5]
        ax.axhline(level, color=f"{0.15 + 0.12 * (k % 5):.2f}", ls=style, lw=1.3, label=label)
    ax.set(xlabel="period", ylabel="‖z_ref - z‖ [s.d. of z]", yscale="log")
    ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def dots(rows: dict[str, dict[str, np.ndarray]], xlabel: str, xscale: str = "log") -> Figure:
    """A row of dots for each label, and their median as a bar.

    Args:
        rows: `{label: {group: values [N]}}`; the first row is the uppermost. A group may be missing in some.
        xlabel: what the values are.
        xscale: "log" or "linear".
    """
    groups = list(dict.fromkeys(group for row in rows.values() for group in row))
    figure, ((ax,),) = new_axes(size=(8.0, 0.9 + 0.27 * len(rows)))
    for k, group in enumerate(groups):
        look: dict[str, Any] = {"color": COLOURS[k], "marker": "osD^"[k % 4]}
        for n, row in enumerate(rows.values()):
            if group not in row:
                continue
            y = n + 0.3 * (k - (len(groups) - 1) / 2)
            ax.plot(row[group], np.full(len(row[group]), y), ls="none", ms=4, alpha=0.6, **look)
            ax.plot([np.median(row[group])] * 2, [y - 0.18, y + 0.18], color=COLOURS[k], lw=2.5)
        ax.plot([], [], ls="none", label=group, **look)
    ax.set_yticks(range(len(rows)), rows)
    ax.set(xscale=xscale, xlabel=xlabel, ylim=(len(rows) - 0.5, -0.5))
    ax.legend(fontsize=8)
    return figure


def fall_off(panels: dict[str, dict[str, dict[str, np.ndarray]]], sizes: dict[str, np.ndarray]) -> Figure:
    """What becomes of some quantities when something is displaced: a row a quantity, a column a kind of displacement.

    Args:
        panels: `{quantity: {kind: {direction: [hows, sizes]}}}`; of two hows, the second is drawn dashed.
        sizes: of the displacements `{kind, with its unit: [sizes]}`, above zero.
    """
    figure, axes = new_axes(len(panels), len(sizes), size=(4.2, 2.2), sharey="row", sharex="col")
    for row, (quantity, kinds) in zip(axes, panels.items(), strict=True):
        row[0].set_ylabel(quantity, fontsize=9)
        for ax, (kind, at) in zip(row, sizes.items(), strict=True):
            for colour, (direction, hows) in zip(COLOURS, kinds[kind].items(), strict=False):
                for k, values in enumerate(hows):
                    label = direction if not k else "_again"
                    ax.plot(at, values, STYLES[k], marker="os"[k], ms=4, color=colour, label=label)
            ax.set(xscale="log")
            ax.set_xticks(at, [f"{size:g}" for size in at])
            ax.minorticks_off()
    for ax, top, kind in zip(axes[-1], axes[0], sizes, strict=True):
        ax.set_xlabel(kind)
        top.legend(fontsize=8)
    return figure


def intervals(rows: dict[str, tuple[float, float, float]], xlabel: str) -> Figure:
    """Means with their intervals, and a line at zero.

    Args:
        rows: `{label: (mean, lower end, upper end)}`, as `difference_interval` has them.
        xlabel: what they are.
    """
    figure, ((ax,),) = new_axes(size=(8.0, 0.9 + 0.32 * len(rows)))
    for n, (mean, low, high) in enumerate(rows.values()):
        colour = COLOURS[0] if low <= 0 <= high else COLOURS[1]
        ax.errorbar(mean, n, xerr=[[mean - low], [high - mean]], fmt="o", color=colour, capsize=3, ms=5)
    ax.axvline(0, color="0.35", lw=1)
    ax.set_yticks(range(len(rows)), rows)
    ax.set(xlabel=xlabel, ylim=(len(rows) - 0.5, -0.5))
    return figure


def bounds_over_time(panels: dict[str, dict[str, np.ndarray]], time: np.ndarray) -> Figure:
    """How well a constant can be known at best after some time, a panel for each, on logarithmic scales.

    A grey line falls with the root of time, as a bound does while the motion goes on as it is. What is not known at
    all, an infinite bound, is not drawn.

    Args:
        panels: `{quantity: {sensors: least standard deviation of its logarithm [N]}}`.
        time: `[N]` [s].
    """
    figure, axes = new_axes(1, len(panels), size=(3.2, 3.2), sharex=True, sharey=True)
    for ax, (quantity, curves) in zip(axes[0], panels.items(), strict=True):
        known = []
        for k, (label, values) in enumerate(curves.items()):
            shown = np.where(np.isfinite(values), values, np.nan)
            look: dict[str, Any] = {"color": COLOURS[k % 7], "ls": STYLES[k % 4], "marker": "os^Dv"[k % 5], "ms": 3}
            ax.plot(time, shown, label=label, **look)
            known += shown[np.isfinite(shown)].tolist()
        if known:
            guide = known[-1] * np.sqrt(np.max(time) / np.asarray(time))
            ax.plot(time, guide, color="0.6", lw=1, label="_root of time")
        ax.set(xscale="log", yscale="log", xlabel="time [s]", title=quantity)
    axes[0, 0].set_ylabel("least standard deviation of the log")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def race(
    curves: dict[str, dict[str, np.ndarray]],
    times: np.ndarray,
    bounds: dict[str, dict[str, np.ndarray]] | None = None,
    quantities: Sequence[str] = ("C_damp", "C_mass", "C_damp / C_mass"),
) -> Figure:
    """Errors of what is found against the time for which a cloth is moved: the median over runs, and its middle half.

    Args:
        curves: absolute errors of the logarithm, `{quantity: {method: [runs, times]}}`.
        times: when answers were asked for `[times]` [s].
        bounds: what nobody could do better than, drawn without a spread, `{label: {quantity: [times]}}`; a quantity
            may be missing.
        quantities: which of them, a panel each.
    """
    figure, axes = new_axes(1, len(quantities), size=(3.9, 3.6), sharey=True)
    for ax, quantity in zip(axes[0], quantities, strict=True):
        for k, (method, errors) in enumerate(curves[quantity].items()):
            low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75], axis=0)
            look: dict[str, Any] = {"color": COLOURS[k % 7], "ls": STYLES[k % 4]}
            ax.plot(times, middle, marker="osD^"[k % 4], ms=4, label=method, **look)
            ax.fill_between(times, low, high, color=look["color"], alpha=0.15, lw=0)
        for k, (label, known) in enumerate((bounds or {}).items()):
            if quantity in known:
                ax.plot(times, known[quantity], color="black", ls=(0, (1 + 3 * k, 1)), lw=1.5, label=label)
        ax.set(xscale="log", yscale="log", xlabel="time in motion [s]", title=f"log ({quantity})")
        ax.set_xticks(times, [f"{t:g}" for t in times])
        ax.minorticks_off()
    axes[0, 0].set_ylabel("absolute error of the logarithm")
    shown = {label: line for ax in axes[0] for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(list(shown.values()), list(shown), loc="outside lower center", ncols=4)
    return figure


def cloud_views(cloud: PointCloud, marks: dict[str, np.ndarray] | None = None, most: int = 20_000) -> Figure:
    """A cloud of points in its own colours, from the side and from above.

    Args:
        cloud: what a camera saw.
        marks: what was found in it, drawn over it as lines `{label: points [N, 3] [m]}`.
        most: of so many of its points.
    """
    some = cloud[:: max(1, -(-len(cloud) // most))]
    low, high = some.points.min(axis=0) - 0.05, some.points.max(axis=0) + 0.05
    margin = (np.max((high - low)[1:]) - (high - low)) / 2  # both views are equally high, so that x stands below x
    figure, axes = new_axes(2, 1, size=(8.0, 0.6 + 7.2 * np.max((high - low)[1:]) / (high - low)[0]))
    for ax, across in zip(axes[:, 0], (2, 1), strict=True):
        nearest_last = np.argsort(-some.points[:, 1] if across == 2 else some.points[:, 2])
        shown = some.points[nearest_last]
        ax.scatter(shown[:, 0], shown[:, across], s=2, c=some.colours[nearest_last] / 255, edgecolor="none")
        for k, (label, places) in enumerate((marks or {}).items()):
            x, y = np.asarray(places)[:, [0, across]].T
            ax.plot(x, y, STYLES[k % 4], color=COLOURS[k % 7], lw=2.5, marker="os^D"[k % 4], ms=5, label=label)
        ends = low[across] - margin[across], high[across] + margin[across]
        ax.set(xlim=(low[0], high[0]), ylim=ends, aspect="equal")
    axes[0, 0].set(title="from the side", ylabel="height z [m]")
    axes[1, 0].set(title="from above", ylabel="to the robot's left y [m]", xlabel="forward x [m]")
    if marks:
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(marks))
    return figure


def repetitions(counts: dict[str, np.ndarray], repeats: int) -> Figure:
    """How many of some throws worked so often again; dots: what equally good ones would have given, by chance alone.

    Args:
        counts: of the repetitions of each throw, those that worked `{foam: [throws]}`.
        repeats: how often each was repeated.
    """
    figure, ((ax,),) = new_axes(size=(6.4, 3.2))
    again, below, total = np.arange(repeats + 1), np.zeros(repeats + 1), np.concatenate(list(counts.values()))
    for k, (label, values) in enumerate(counts.items()):
        bar = np.bincount(values, minlength=repeats + 1)
        ax.bar(
            again,
            bar,
            0.7,
            below,
            color=COLOURS[k % 7],
            edgecolor="white",
            hatch=("", "//", "..", "xx")[k % 4],
            label=label,
        )
        below += bar
    expected = len(total) * binom.pmf(again, repeats, total.mean() / repeats)
    ax.plot(again, expected, "o--", color="black", label="if all were equally good")
    ax.set(xlabel=f"worked again, of {repeats} repetitions", ylabel="throws", xticks=again)
    ax.yaxis.get_major_locator().set_params(integer=True)
    figure.legend(loc="outside right upper", fontsize=9)
    return figure
