"""The paper's figures again, from the stored tables of one amount of recordings.

`FIGURES` has their functions, which take `claims.Evidence`, by the paper's labels.
Lines are means over units, which are worlds or trainings, and bands their standard
deviation; the paper has five of each.
"""

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from clothlab import plots
from clothlab.analysis import best_per_period, principal_axes
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import CONTROL_PERIOD
from studies._rows import Row
from studies._runs import HEAVY, LIGHT
from studies.claims import SHOWN, Evidence, Judged, biases_of, nearness
from studies.joint_estimation_control import ESTIMATED, HELD, KNOWLEDGE
from studies.stiffness import CORRECT, FIXED, HELD as FOAMS, RANDOM, WARM, WRONG

_DISTANCE = "distance to the target [s.d. of z]"
_CONDITIONS = (CORRECT, WRONG, FIXED, WARM, RANDOM)
# Colours of verdicts; words stand beside them
VERDICT_COLOURS = {
    "holds": plots.COLOURS[2],
    "equal": plots.COLOURS[5],
    "contradicted": plots.COLOURS[1],
    "inconclusive": "0.55",
}


def maps(evidence: Evidence) -> Figure:
    """Trained p on its principal axes, a map for each unit; first with estimates."""
    trained = biases_of(evidence, "torque")
    runs = evidence["estimation"]
    figure, axes = _small_multiples([*trained], evidence.of)
    for ax, (unit, biases) in zip(axes, trained.items(), strict=True):
        estimates = runs[(runs["unit"] == unit) & runs["cloth"].isin(SHOWN)]
        _draw_map(ax, biases, estimates.drop_duplicates("cloth"))

    # What colours, markers and lines say
    key = []
    for k, damping in enumerate((0.03, 0.05, 0.07)):
        look: dict[str, Any] = {
            "color": plots.COLOURS[k],
            "marker": "os^"[k],
            "ls": "none",
        }
        key.append(Line2D([], [], label=f"C_damp {damping} N s/m", **look))
    key.append(Line2D([], [], color="0.3", label="estimate, from p = 0"))
    figure.legend(handles=key, loc="outside lower center", ncols=4, fontsize=10)
    return figure


def _small_multiples(units: Sequence[int], of: str) -> tuple[Figure, list[Axes]]:
    """A small panel for each unit, at most five in a row."""
    columns = min(max(len(units), 3), 5)
    rows = -(-len(units) // columns)
    figure, axes = plots.new_axes(rows, columns, size=(2.9, 2.7))
    for ax, unit in zip(axes.flat, units, strict=False):
        ax.set_title(f"{of} {unit}", fontsize=11)
    for ax in axes.flat[len(units) :]:
        ax.set_axis_off()
    return figure, [*axes.flat[: len(units)]]


def _draw_map(ax: Axes, biases: dict[str, np.ndarray], estimates: pd.DataFrame) -> None:
    """Nine cloths, their size is C_mass, and the ways of estimates."""
    pca = principal_axes(biases)
    for name, p in biases.items():
        cloth = CLOTHS[name]
        k = (0.03, 0.05, 0.07).index(cloth.damping)
        x, y = pca.transform(p[None])[0]
        look: dict[str, Any] = {"color": plots.COLOURS[k], "marker": "os^"[k]}
        ax.scatter(x, y, s=800 * cloth.mass, zorder=3, **look)
    for trace, name in zip(estimates["trace"], estimates["cloth"], strict=True):
        way = pca.transform(np.vstack([np.zeros(2), trace]))
        k = (0.03, 0.05, 0.07).index(CLOTHS[name].damping)
        ax.plot(*way.T, lw=1, color=plots.COLOURS[k], alpha=0.8)
    first, second = pca.explained_variance_ratio_
    ax.set_xlabel(f"PC1 ({first:.2f})", fontsize=10)
    ax.set_ylabel(f"PC2 ({second:.2f})", fontsize=10)
    ax.tick_params(labelsize=8)


def _rates(distances: Iterable[np.ndarray], thresholds: np.ndarray) -> np.ndarray:
    """Share of the steps below each threshold, `[runs, thresholds]`."""
    return np.array([(d[1:, None] < thresholds).mean(axis=0) for d in distances])


def _draw_rates(
    ax: Axes, runs: Mapping[str, Sequence[np.ndarray]], still: float
) -> None:
    """Curves of several kinds of runs, and where the hanging cloth is."""
    thresholds = np.linspace(0, 1.6 * still, 120)
    for k, (label, distances) in enumerate(runs.items()):
        rates = 100 * _rates(distances, thresholds)
        mean = rates.mean(axis=0)
        spread = rates.std(axis=0)
        look: dict[str, Any] = {"color": plots.COLOURS[k], "ls": plots.STYLES[k % 4]}
        ax.plot(thresholds, mean, label=label, lw=2, **look)
        ax.fill_between(
            thresholds, mean - spread, mean + spread, color=look["color"], alpha=0.2
        )
    ax.axvline(still, color="0.4", lw=1, ls=":")
    ax.text(still, 3, " hanging still", fontsize=9, color="0.3")
    ax.set(xlim=(0, 1.6 * still), ylim=(0, 100))


def control_rates(evidence: Evidence) -> Figure:
    """Share of steps below a threshold, for both targets and cloths."""
    figure, axes = plots.new_axes(2, 2, size=(4.6, 3.0), sharey=True)
    table = evidence["control"]
    for row, target in zip(axes, ("target-1", "target-2"), strict=True):
        for ax, cloth in zip(row, (LIGHT, HEAVY), strict=True):
            runs = table[(table["target"] == target) & (table["cloth"] == cloth)]
            kinds = {"Control": list(runs["control"]), "Random": list(runs["random"])}
            _draw_rates(ax, kinds, float(runs["still"].mean()))
            about = f"{target.capitalize()}, {CLOTHS[cloth].label}"
            ax.set_title(about, fontsize=11)
        row[0].set_ylabel("steps nearer [%]")
    for ax in axes[-1]:
        ax.set_xlabel("threshold of the distance [s.d. of z]")
    axes[0, 0].legend(fontsize=10)
    return figure


def integrated(evidence: Evidence) -> Figure:
    """Best distance of each period with p estimated, wrong and right; way to p."""
    figure, axes = plots.new_axes(1, 2, size=(5.0, 3.3))
    arms = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    for k, knowledge in enumerate(KNOWLEDGE):
        runs = arms[arms["knowledge"] == knowledge]["distance"]
        best = np.array([best_per_period(distance) for distance in runs])
        look: dict[str, Any] = {
            "color": plots.COLOURS[k],
            "ls": plots.STYLES[k],
            "lw": 2,
        }
        seconds = (1 + np.arange(best.shape[1])) * 8 * CONTROL_PERIOD
        axes[0, 0].plot(seconds, best.mean(axis=0), label=f"p {knowledge}", **look)
    axes[0, 0].set(xlabel="time [s]", ylabel=_DISTANCE + ",\nbest of each period")
    axes[0, 0].set_ylim(0, None)
    axes[0, 0].legend(fontsize=10)

    # How far the estimate is on its way
    ax = axes[0, 1]
    trained = biases_of(evidence, "torque")
    joint = evidence["joint_estimation_control"]
    for trace, unit in zip(joint["trace"], joint["unit"], strict=True):
        right = trained[unit][HELD]
        left = np.linalg.norm(np.asarray(trace) - right, axis=1)
        left = left / np.linalg.norm(trained[unit][HEAVY] - right)
        seconds = (1 + np.arange(len(left))) * CONTROL_PERIOD
        ax.plot(seconds, left, color=plots.COLOURS[0], lw=1, alpha=0.6)
    ax.axhline(1, color="0.4", lw=1, ls=":")
    ax.set(xlabel="time [s]", ylim=(0, None))
    ax.set_ylabel(f"distance of the {ESTIMATED} p\nto the right one, start = 1")
    return figure


def chamfer_scatter(evidence: Evidence) -> Figure:
    """Two distances of an image to a target, of random commands."""
    figure, axes = plots.new_axes(1, 2, size=(4.4, 3.3))
    table = evidence["chamfer"]
    for ax, target in zip(axes[0], ("target-1", "target-2"), strict=True):
        runs = table[table["target"] == target]
        for x, y in zip(runs["log_chamfer"], runs["z_distance"], strict=True):
            ax.plot(x, y, ".", ms=2, alpha=0.4, color=plots.COLOURS[0])
        of = runs["correlation"]
        ends = (
            f"{of.min():.2f} to {of.max():.2f}" if len(of) > 1 else f"{of.iloc[0]:.2f}"
        )
        ax.set_title(f"{target.capitalize()}: r = {ends} (paper: 0.811)", fontsize=11)
        ax.set_xlabel("log chamfer distance [log pixel]")
    axes[0, 0].set_ylabel(_DISTANCE)
    return figure


def foam_maps(evidence: Evidence) -> Figure:
    """Trained p of four foams, and estimates of three under control."""
    trained = biases_of(evidence, "muscle")
    runs = evidence["foam_estimation"].query("motion == 'control'")
    figure, axes = _small_multiples([*trained], evidence.of)
    for ax, (unit, biases) in zip(axes, trained.items(), strict=True):
        # The trained ones
        for k, (name, p) in enumerate(biases.items()):
            look: dict[str, Any] = {
                "color": plots.COLOURS[k],
                "marker": "os^D"[k],
                "ls": "none",
            }
            ax.plot(*p, ms=9, label=name, **look)

        # The ways of the estimates
        of_unit = runs[runs["unit"] == unit]
        ways = zip(of_unit["trace"], of_unit["cloth"], strict=True)
        for k, (trace, name) in enumerate(ways):
            look = {"color": "0.3", "ls": plots.STYLES[k], "lw": 1}
            ax.plot(*np.asarray(trace).T, label=f"estimate of {name}", **look)
        ax.set(xlabel="p, first number", ylabel="p, second number")
    lines = axes[0].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=4, fontsize=10)
    return figure


def foam_throws(evidence: Evidence) -> Figure:
    """Joint angles and f_const of one run with each foam, ten seconds of it."""
    figure, axes = plots.new_axes(2, 2, size=(5.2, 2.5), sharex=True, sharey="row")
    table = evidence["foam_control"]
    table = table[(table["condition"] == CORRECT) & (table["theta"].map(len) > 0)]
    for column, foam in zip(axes.T, FOAMS, strict=True):
        # One run's angles and tensions
        run = table[table["cloth"] == foam].iloc[0]
        theta = np.asarray(run["theta"])
        tension = np.asarray(run["commands"])[:, 2]
        seconds = np.linspace(0, len(tension) * CONTROL_PERIOD, len(theta))
        steps = np.arange(len(tension)) * CONTROL_PERIOD

        # Angles above, tension below
        for k, joint in enumerate(("shoulder", "elbow")):
            look: dict[str, Any] = {
                "color": plots.COLOURS[k],
                "ls": plots.STYLES[k],
                "lw": 2,
            }
            column[0].plot(seconds, np.rad2deg(theta[:, k]), label=joint, **look)
        column[1].step(steps, tension, where="post", color=plots.COLOURS[2], lw=2)
        column[0].set_title(foam)
        column[1].set(xlabel="time [s]", xlim=(5, 15))
    axes[0, 0].set_ylabel("joint angle [°],\nlarger is lower")
    axes[1, 0].set_ylabel("f_const [N]")
    axes[0, 0].legend(fontsize=10)
    return figure


def foam_rates(evidence: Evidence) -> Figure:
    """Share of steps below a threshold under each condition, for both foams."""
    figure, axes = plots.new_axes(1, 2, size=(5.0, 3.4), sharey=True)
    table = evidence["foam_control"]
    for ax, foam in zip(axes[0], FOAMS, strict=True):
        of_foam = table[table["cloth"] == foam]
        kinds = {}
        for condition in _CONDITIONS:
            runs = of_foam[of_foam["condition"] == condition]
            kinds[condition] = list(runs["distance"])
        _draw_rates(ax, kinds, float(of_foam["distance"].str[0].mean()))
        ax.set(title=foam, xlabel="threshold of the distance [s.d. of z]")
    axes[0, 0].set_ylabel("steps nearer [%]")
    axes[0, 1].legend(fontsize=9, loc="upper left")
    return figure


def foam_quantities(evidence: Evidence) -> Figure:
    """Nearness, least and largest distance and hand speed, by condition."""
    figure, axes = plots.new_axes(1, 4, size=(3.2, 3.2))
    table = evidence["foam_control"]

    # What is shown of each run
    speed = table["peak_hand_speed"].map(lambda row: row[0] if len(row) else np.nan)
    quantities = {
        "nearness [0 to 1]": table["distance"].map(nearness),
        "least distance\n[s.d. of z]": table["distance"].map(np.min),
        "largest distance\n[s.d. of z]": table["distance"].map(np.max),
        "highest hand speed\n[m/s]": speed,
    }

    # A panel for each, with both foams side by side under each condition
    names = [name.removeprefix("Correct").strip(", ") or name for name in _CONDITIONS]
    for ax, (label, values) in zip(axes[0], quantities.items(), strict=True):
        for k, foam in enumerate(FOAMS):
            of_foam = values[table["cloth"] == foam].groupby(table["condition"])
            mean = of_foam.mean().reindex(_CONDITIONS).dropna()
            spread = of_foam.std().reindex(mean.index).fillna(0)
            x = [_CONDITIONS.index(name) + 0.2 * (k - 0.5) for name in mean.index]
            look: dict[str, Any] = {
                "color": plots.COLOURS[k],
                "fmt": "os"[k],
                "capsize": 3,
            }
            ax.errorbar(x, mean, spread, label=foam, **look)
        ax.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=9)
        ax.set_ylabel(label)
    axes[0, 0].legend(fontsize=10)
    return figure


def verdicts(judged: Mapping[str, Sequence[Judged]]) -> Figure:
    """Means and intervals of claims in units of their margins, by amount.

    Args:
        judged: for each amount of recordings, by its label, claims in their order.
    """
    # A row for each claim, in which the amounts stand below each other
    claims = {
        each.claim.name: each.claim for found in judged.values() for each in found
    }
    rows = {name: k for k, name in enumerate(claims)}
    height = 1.5 + 0.42 * len(rows)
    figure, ((ax,),) = plots.new_axes(size=(11.0, height))
    ax.axvspan(-1, 1, color="0.9", zorder=0)
    for k, found in enumerate(judged.values()):
        for each in found:
            y = rows[each.claim.name] + 0.32 * (k - 0.5)
            _draw_interval(ax, each, y, "oD"[k])

    # What rows, colours and markers say
    ax.set_yticks(range(len(rows)), [claim.short for claim in claims.values()])
    ax.set_ylim(len(rows) - 0.5, -0.5)
    edge = 1.03 * _scaled(np.inf)
    ax.set_xlim(-edge, edge)
    ticks = (-30, -10, -3, -1, 0, 1, 3, 10, 30)
    ax.set_xticks([_scaled(tick) for tick in ticks], [str(tick) for tick in ticks])
    ax.set_xlabel("against the paper  ←  number over its margin  →  as the paper says")
    markers = _verdict_key()
    for k, label in enumerate(judged):
        markers.append(
            Line2D([], [], color="0.3", marker="oD"[k], ls="none", label=label)
        )
    figure.legend(handles=markers, loc="outside upper center", ncols=3, fontsize=11)
    return figure


def _verdict_key() -> list[Line2D]:
    """Entries of a legend for the colours of verdicts."""
    look: dict[str, Any] = {"marker": "s", "ls": "none"}
    return [
        Line2D([], [], color=colour, label=verdict, **look)
        for verdict, colour in VERDICT_COLOURS.items()
    ]


def verdict_counts(judged: Mapping[str, Sequence[Judged]]) -> Figure:
    """How many claims have which verdict, by part of the paper and amount."""
    # A bar for each part and amount
    parts = dict.fromkeys(
        each.claim.part for found in judged.values() for each in found
    )
    figure, ((ax,),) = plots.new_axes(size=(9.5, 0.9 * len(parts) + 1.2))
    ticks = []
    for n, part in enumerate(parts):
        for k, (label, found) in enumerate(judged.items()):
            y = n + 0.36 * (k - 0.5)
            words = [each.verdict for each in found if each.claim.part == part]
            _draw_counts(ax, y, words)
            ticks.append((y, f"{part}, {label}" if k == 0 else label))

    # Words
    ax.set_yticks([y for y, _ in ticks], [label for _, label in ticks], fontsize=10)
    ax.set_ylim(len(parts) - 0.5, -0.5)
    ax.set_xlabel("claims of the paper")
    figure.legend(handles=_verdict_key(), loc="outside upper center", ncols=4)
    return figure


def differences(
    effects: pd.DataFrame, questions: Iterable[str], margin: float
) -> Figure:
    """Differences of two ways with their intervals, by question and group of tasks.

    Args:
        effects: rows by question and group, with `difference`, `low` and `high`.
        questions: which of them, from above.
        margin: a difference within it counts for nothing.
    """
    # The margin, and how many marks a question has
    rows = [*questions]
    groups = effects.loc[rows].index.unique("group")
    figure, ((ax,),) = plots.new_axes(size=(11.0, 1.4 + 0.62 * len(rows)))
    ax.axvspan(-margin, margin, color="0.9", zorder=0)
    ax.axvline(0, color="0.5", lw=0.8)

    # Intervals of each group of tasks
    for k, group in enumerate(groups):
        of_group = effects.xs(group, level="group").reindex(rows)
        look: dict[str, Any] = {"color": plots.COLOURS[k], "marker": "osDv"[k]}
        for n, effect in enumerate(of_group.itertuples()):
            y = n + 0.19 * (k - (len(groups) - 1) / 2)
            ends = [effect.low, effect.high]
            ax.plot(ends, [y, y], color=look["color"], lw=2.5, solid_capstyle="butt")
            ax.plot(effect.difference, y, ms=6, **look)
        ax.plot([], [], lw=2.5, label=group, **look)

    # Words
    ax.set_yticks(range(len(rows)), rows)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlabel("nearer  ←  difference, over random commands' distance  →  farther")
    figure.legend(loc="outside upper center", ncols=len(groups), fontsize=11)
    return figure


_MET_COLOURS = {True: plots.COLOURS[2], False: plots.COLOURS[1], None: plots.COLOURS[0]}


def own_rows(rows: Sequence[Row], beside: Mapping[str, Row]) -> Figure:
    """Rows of this project's own, with their intervals and aims; a panel for each unit.

    Args:
        rows: from above.
        beside: those of the paper's amount of recordings, by key.
    """
    # Panels as high as their rows are many
    by_unit: dict[str, list[Row]] = {}
    for row in rows:
        by_unit.setdefault(row.unit, []).append(row)
    heights = [0.8 + len(those) for those in by_unit.values()]
    size = (11.0, (0.8 + 0.55 * sum(heights)) / len(heights))  # of a panel
    figure, axes = plots.new_axes(
        len(by_unit), size=size, gridspec_kw={"height_ratios": heights}
    )

    # A row is a number, an interval and an aim
    for (ax,), (unit, those) in zip(axes, by_unit.items(), strict=True):
        for y, row in enumerate(those):
            _draw_row(ax, y, row)
            if row.key in beside:
                ax.plot(beside[row.key].value, y, "o", mfc="none", color="0.3", ms=7)
        labels = [textwrap.fill(row.label, 58) for row in those]
        ax.set_yticks(range(len(those)), labels, fontsize=10)
        ax.set_ylim(len(those) - 0.5, -0.5)
        if unit:
            ax.set_xlabel(unit.strip())
    figure.legend(handles=_row_key(), loc="outside upper center", ncols=5, fontsize=11)
    return figure


def _draw_row(ax: Axes, y: float, row: Row) -> None:
    """A dot in the colour of its aim, its interval, and the aim's bounds as marks."""
    colour = _MET_COLOURS[row.met]
    if row.interval is not None:
        ax.plot(row.interval, [y, y], color=colour, lw=2.5, solid_capstyle="butt")
    face = "none" if row.of_paper else colour
    ax.plot(row.value, y, "o", color=colour, mfc=face, ms=7)
    for bound, marker in ((row.at_least, ">"), (row.at_most, "<")):
        if bound is not None:
            ax.plot(bound, y, marker, color="0.55", ms=8)


def _row_key() -> list[Line2D]:
    """Entries of a legend for rows with aims."""
    labels = {True: "aim met", False: "aim not met", None: "no aim"}
    key = []
    for met, colour in _MET_COLOURS.items():
        look: dict[str, Any] = {"marker": "o", "color": colour, "label": labels[met]}
        key.append(Line2D([], [], ls="none", **look))
    hollow: dict[str, Any] = {"marker": "o", "mfc": "none", "color": "0.3"}
    hollow |= {"label": "hollow: the paper's recordings"}
    key.append(Line2D([], [], ls="none", **hollow))
    key.append(Line2D([], [], ls="none", marker=">", color="0.55", label="aim"))
    return key


def _draw_counts(ax: Axes, y: float, words: Sequence[str]) -> None:
    """One bar: its pieces are verdicts, with their numbers in them."""
    start = 0
    for verdict, colour in VERDICT_COLOURS.items():
        count = words.count(verdict)
        if count:
            ax.barh(y, count, 0.3, left=start, color=colour)
            ax.text(
                start + count / 2, y, str(count), ha="center", va="center", fontsize=9
            )
        start += count


def _scaled(number: float) -> float:
    """Linear within a margin, logarithmic beyond, and cut at 30 margins."""
    number = float(np.clip(number, -30, 30))
    size = abs(number)
    return number if size <= 1 else float(np.sign(number) * (1 + np.log(size)))


def _draw_interval(ax: Axes, judged: Judged, y: float, marker: str) -> None:
    """A claim's mean as a marker, its interval as a line."""
    margin = judged.claim.margin
    ends = [_scaled(each / margin) for each in (judged.low, judged.high)]
    colour = VERDICT_COLOURS[judged.verdict]
    ax.plot(ends, [y, y], color=colour, lw=2.5, solid_capstyle="butt")
    ax.plot(_scaled(judged.mean / margin), y, marker, color=colour, ms=6)


FIGURES: dict[str, Callable[[Evidence], Figure]] = {
    "sim-pb": maps,
    "sim-control": control_rates,
    "sim-integrated": integrated,
    "sim-zchamfer": chamfer_scatter,
    "act-pb": foam_maps,
    "test-control": foam_throws,
    "eval-graph": foam_rates,
    "eval-all": foam_quantities,
}
