"""The paper's figures again, from the stored tables.

`FIGURES` has their functions by the paper's labels. They take `claims.Evidence` of one
amount of recordings or of several, and draw a row of panels for each. Lines are means
over units, which are worlds or trainings, and bands their standard deviation; the paper
has five of each.
"""

import contextlib
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from clothlab import plots
from clothlab.analysis import best_per_period, principal_axes
from clothlab.simulation.cloth import CLOTHS
from clothlab.simulation.env import CONTROL_PERIOD
from studies._runs import HEAVY, LIGHT
from studies.claims import (
    AMOUNTS_IN_WORDS,
    PAPERS_THRESHOLD,
    SHOWN,
    Evidence,
    Judged,
    NotMeasured,
    biases_of,
    nearness,
)
from studies.joint_estimation_control import ESTIMATED, HELD, KNOWLEDGE
from studies.stiffness import CORRECT, FIXED, HELD as FOAMS, RANDOM, WARM, WRONG

# Sizes of words [pt]
_WORDS: dict[Any, Any] = {
    "axes.labelsize": 11,
    "axes.titlesize": 12,
    "xtick.labelsize": 10,
    "ytick.labelsize": 10,
}
_CONDITIONS = (CORRECT, WRONG, FIXED, WARM, RANDOM)
# Where curves of foams are read, over the hanging foam's distance: nearness ends at
# half, and the paper reads 0.5 of 0.86
_READ_AT = {0.5: "-", PAPERS_THRESHOLD: "-."}
# Colours of verdicts; words stand beside them
VERDICT_COLOURS = {
    "holds": plots.COLOURS[2],
    "equal": plots.COLOURS[5],
    "contradicted": plots.COLOURS[1],
    "inconclusive": "0.55",
}


def maps(*evidences: Evidence) -> Figure:
    """Trained p on its principal axes, a map for each unit; first with estimates."""
    found = _with("trained_p", evidences)
    trained = [biases_of(evidence, "torque") for evidence in found]
    figure, axes = _small_multiples(found, trained, height=2.4)
    for row, evidence, of_units in zip(axes, found, trained, strict=True):
        runs = evidence["estimation"]
        for ax, (unit, biases) in zip(row, of_units.items(), strict=False):
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
    sizes: dict[str, Any] = {"color": "0.3", "marker": "o", "ls": "none"}
    key.append(Line2D([], [], label="larger mark: larger C_mass", **sizes))
    key.append(Line2D([], [], color="0.3", label="estimate, from p = 0"))
    _explain(figure, key, 5)
    return figure


def _with(name: str, evidences: Iterable[Evidence]) -> list[Evidence]:
    """Those that have a table; `NotMeasured` if none has it."""
    found = []
    for evidence in evidences:
        with contextlib.suppress(NotMeasured):
            evidence[name]
            found.append(evidence)
    if not found:
        raise NotMeasured(f"no table {name}: run `make results`")
    return found


def _amount(evidence: Evidence, table: pd.DataFrame) -> str:
    """An amount of recordings, and over how many units a table of it goes."""
    return _amount_of(evidence, table["unit"].nunique())


def _amount_of(evidence: Evidence, count: int) -> str:
    units = f"{count} {evidence.of}{'s' * (count > 1)}"
    return f"{AMOUNTS_IN_WORDS[evidence.amount]}, {units}"


def _name_row(ax: Axes, label: str) -> None:
    """Say left of a row of panels what it shows."""
    ax.annotate(
        "\n".join(textwrap.fill(part, 13) for part in label.split(", ")),
        (0, 0.5),
        xytext=(-6, 0),
        xycoords=ax.yaxis.label,
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="center",
        ma="center",
        fontsize=11,
        fontweight="bold",
    )


def _new_axes(
    rows: int, columns: int, size: tuple[float, float], **options: Any
) -> tuple[Figure, np.ndarray]:
    """As `plots.new_axes`, with words that a projector shows."""
    with matplotlib.rc_context(_WORDS):
        return plots.new_axes(rows, columns, size=size, **options)


def _explain(figure: Figure, handles: Sequence[Any], columns: int) -> None:
    """A legend below all panels, which folds where the figure is narrow."""
    if figure.get_figwidth() < 10:
        columns = -(-columns // 2)
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=columns,
        columnspacing=1.4,
        fontsize=11,
    )


def _small_multiples(
    evidences: Sequence[Evidence], trained: Sequence[Mapping[int, Any]], height: float
) -> tuple[Figure, list[np.ndarray]]:
    """Maps for each evidence, one for each unit, all of one scale, at most five a row.

    Returned are the figure, and the axes of each evidence's units.
    """
    columns = min(5, max(3, *map(len, trained)))
    rows = [-(-len(of_units) // columns) for of_units in trained]
    size = (min(12.8 / columns, 3.2), height)
    figure, axes = _new_axes(sum(rows), columns, size, sharex=True, sharey=True)

    # Each evidence has the rows below those of the one before
    found = []
    for part, evidence, of_units in zip(
        np.split(axes, np.cumsum(rows)[:-1]), evidences, trained, strict=True
    ):
        for ax, unit in zip(part.flat, of_units, strict=False):
            ax.set_title(f"{evidence.of} {unit}")
            ax.margins(0.12)
            ax.tick_params(labelbottom=True)
        for ax in part.flat[len(of_units) :]:
            ax.set_axis_off()
        _name_row(part[0, 0], _amount_of(evidence, len(of_units)))
        found.append(part.ravel())
    return figure, found


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
    _name_principal_axes(ax, pca)


def _name_principal_axes(ax: Axes, pca: Any) -> None:
    """Axes of a map with their shares of the variance."""
    first, second = pca.explained_variance_ratio_
    ax.set_xlabel(f"PC1 ({first:.2f})")
    ax.set_ylabel(f"PC2 ({second:.2f})")


def _draw_mean(
    ax: Axes, x: np.ndarray, values: np.ndarray, k: int, label: str = ""
) -> None:
    """Mean of runs `[runs, x]` in the look `k`, with their standard deviation."""
    mean = values.mean(axis=0)
    spread = values.std(axis=0)
    colour = plots.COLOURS[k]
    ax.plot(x, mean, label=label, lw=2, color=colour, ls=plots.STYLES[k % 4])
    ax.fill_between(x, mean - spread, mean + spread, color=colour, alpha=0.15, lw=0)


def _rates(distances: Iterable[np.ndarray], thresholds: np.ndarray) -> np.ndarray:
    """Share of the steps below each threshold, `[runs, thresholds]`."""
    return np.array([(d[1:, None] < thresholds).mean(axis=0) for d in distances])


def _draw_rates(
    ax: Axes, runs: Mapping[str, Sequence[np.ndarray]], still: float, end: float
) -> None:
    """Curves of several kinds of runs, and where the hanging cloth is."""
    thresholds = np.linspace(0, end, 160)
    for k, (label, distances) in enumerate(runs.items()):
        _draw_mean(ax, thresholds, 100 * _rates(distances, thresholds), k, label)
    ax.axvline(still, color="0.2", lw=1.2, ls=":")
    ax.set(xlim=(0, end), ylim=(0, 100))


def _rates_key(figure: Figure, ax: Axes, more: Iterable[Line2D] = ()) -> None:
    """Name curves of rates below all panels."""
    handles, _ = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], color="0.2", lw=1.2, ls=":", label="hanging still"))
    _explain(figure, [*handles, *more], 6)


def control_rates(*evidences: Evidence) -> Figure:
    """Share of steps below a threshold, for both targets and cloths."""
    # Panels of one scale: a row for each amount of recordings
    found = _with("control", evidences)
    end = 1.6 * max(evidence["control"]["still"].max() for evidence in found)
    tasks = [*product(("target-1", "target-2"), (LIGHT, HEAVY))]
    figure, axes = _new_axes(len(found), 4, (3.2, 2.8), sharex=True, sharey=True)

    # Curves
    for row, evidence in zip(axes, found, strict=True):
        table = evidence["control"]
        for ax, (target, cloth) in zip(row, tasks, strict=True):
            runs = table[(table["target"] == target) & (table["cloth"] == cloth)]
            kinds = {"Control": list(runs["control"]), "Random": list(runs["random"])}
            _draw_rates(ax, kinds, float(runs["still"].mean()), end)
        row[0].set_ylabel("steps nearer [%]")
        _name_row(row[0], _amount(evidence, table))

    # Words
    for ax, (target, cloth) in zip(axes[0], tasks, strict=True):
        ax.set_title(f"{target.capitalize()}, {CLOTHS[cloth].label}")
    for ax in axes[-1]:
        ax.set_xlabel("threshold [s.d. of z]")
    _rates_key(figure, axes[0, 0])
    return figure


def integrated(*evidences: Evidence) -> Figure:
    """Best distance of each period with p estimated, wrong and right; way to p."""
    found = _with("joint_arms", evidences)
    size = (5.8, 2.4 + 0.9 / len(found))  # with room for words below
    figure, axes = _new_axes(len(found), 2, size, sharex=True, sharey="col")
    for (left, right), evidence in zip(axes, found, strict=True):
        _draw_best(left, evidence)
        _draw_way(right, evidence)
        _name_row(left, _amount(evidence, evidence["joint_arms"]))

    # Words
    axes[0, 0].set(xlim=(0, None), ylim=(0, None))
    axes[0, 1].set_ylim(0, None)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    handles, _ = axes[0, 0].get_legend_handles_labels()
    way: dict[str, Any] = {"color": plots.COLOURS[0], "lw": 1}
    handles.append(Line2D([], [], label="right panels: one run each", **way))
    _explain(figure, handles, 4)
    return figure


def _draw_best(ax: Axes, evidence: Evidence) -> None:
    """Best distance of each period, by what the robot knows of p."""
    arms = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    for k, knowledge in enumerate(KNOWLEDGE):
        runs = arms[arms["knowledge"] == knowledge]["distance"]
        best = np.array([best_per_period(distance) for distance in runs])
        seconds = (1 + np.arange(best.shape[1])) * 8 * CONTROL_PERIOD
        _draw_mean(ax, seconds, best, k, f"p {knowledge}")
    ax.set_ylabel("distance [s.d. of z],\nbest of each period")


def _draw_way(ax: Axes, evidence: Evidence) -> None:
    """How far each run's estimate is on its way to the right p."""
    trained = biases_of(evidence, "torque")
    joint = evidence["joint_estimation_control"]
    for trace, unit in zip(joint["trace"], joint["unit"], strict=True):
        right = trained[unit][HELD]
        left = np.linalg.norm(np.asarray(trace) - right, axis=1)
        left = left / np.linalg.norm(trained[unit][HEAVY] - right)
        seconds = (1 + np.arange(len(left))) * CONTROL_PERIOD
        ax.plot(seconds, left, color=plots.COLOURS[0], lw=1, alpha=0.7)
    ax.axhline(1, color="0.4", lw=1, ls=":")
    ax.set_ylabel(f"{ESTIMATED} p to the right one,\nstart = 1")


def chamfer_scatter(*evidences: Evidence) -> Figure:
    """Two distances of an image to a target, of random commands."""
    found = _with("chamfer", evidences)
    figure, axes = _new_axes(len(found), 2, (5.2, 2.8), sharex=True, sharey=True)
    for row, evidence in zip(axes, found, strict=True):
        table = evidence["chamfer"]
        for ax, target in zip(row, ("target-1", "target-2"), strict=True):
            runs = table[table["target"] == target]
            for x, y in zip(runs["log_chamfer"], runs["z_distance"], strict=True):
                ax.plot(x, y, ".", ms=3, alpha=0.4, color=plots.COLOURS[0])
            of = runs["correlation"]
            ends = dict.fromkeys((f"{of.min():.2f}", f"{of.max():.2f}"))
            papers = " (paper: 0.811)" if target == "target-2" else ""
            ax.set_title(f"{target.capitalize()}: r = {' to '.join(ends)}{papers}")
        row[0].set_ylabel("distance of z [s.d.]")
        _name_row(row[0], _amount(evidence, table))
    for ax in axes[-1]:
        ax.set_xlabel("log chamfer distance [log pixel]")
    return figure


def foam_maps(*evidences: Evidence) -> Figure:
    """Trained p of four foams, and estimates of three under control."""
    found = _with("trained_p", evidences)
    trained = [biases_of(evidence, "muscle") for evidence in found]
    figure, axes = _small_multiples(found, trained, height=2.15)
    for row, evidence, of_units in zip(axes, found, trained, strict=True):
        runs = evidence["foam_estimation"]
        for ax, (unit, biases) in zip(row, of_units.items(), strict=False):
            _draw_foam_map(ax, biases, runs[runs["unit"] == unit])
            ax.set_aspect("equal")  # whether they lie on a line
    handles, _ = axes[0][0].get_legend_handles_labels()
    _explain(figure, handles, 7)
    return figure


def _draw_foam_map(
    ax: Axes, biases: dict[str, np.ndarray], estimates: pd.DataFrame
) -> None:
    """Trained p of the foams on their principal axes, and the ways of estimates."""
    pca = principal_axes(biases)
    for k, (name, p) in enumerate(biases.items()):
        look: dict[str, Any] = {
            "color": plots.COLOURS[k],
            "marker": "os^D"[k],
            "ls": "none",
        }
        ax.plot(*pca.transform(p[None])[0], ms=8, label=name, **look)
    ways = zip(estimates["trace"], estimates["cloth"], strict=True)
    for k, (trace, name) in enumerate(ways):
        way = pca.transform(np.asarray(trace))
        look = {"color": "0.3", "ls": plots.STYLES[k], "lw": 1}
        ax.plot(*way.T, label=f"estimate of {name}", **look)
    _name_principal_axes(ax, pca)


def foam_throws(*evidences: Evidence) -> Figure:
    """Joint angles and f_const with each foam, ten seconds of each run, and means."""
    found = _with("foam_control", evidences)
    figure, axes = _new_axes(2, 2 * len(found), (3.2, 2.5), sharex=True, sharey="row")
    for column, (evidence, foam) in zip(axes.T, product(found, FOAMS), strict=True):
        table = evidence["foam_control"].query(
            "condition == @CORRECT and cloth == @foam"
        )
        runs = table[table["theta"].map(len) > 0]
        _draw_throws(column, runs)
        column[0].set_title(f"{foam}\n{_amount(evidence, runs)}", fontsize=11)
        column[1].set(xlabel="time [s]", xlim=(5, 15))
    axes[0, 0].set_ylabel("joint angle [°],\nlarger is lower")
    axes[1, 0].set_ylabel("f_const [N]")

    # What lines say
    handles, _ = axes[0, 0].get_legend_handles_labels()
    handles.append(Line2D([], [], color="0.4", lw=0.8, label="thin: one run each"))
    handles.append(Line2D([], [], color="0.4", lw=2.5, label="thick: mean of the runs"))
    _explain(figure, handles, 4)
    return figure


def _draw_throws(column: Sequence[Axes], runs: pd.DataFrame) -> None:
    """Angles of each run above, its tensions below; means are thick."""
    theta = np.rad2deg(np.stack([*runs["theta"]]))  # [runs, samples, joints]
    tension = np.stack([*runs["commands"]])[..., 2]  # [runs, steps]
    steps = np.arange(tension.shape[1]) * CONTROL_PERIOD
    seconds = np.linspace(0, tension.shape[1] * CONTROL_PERIOD, theta.shape[1])
    for k, joint in enumerate(("shoulder", "elbow")):
        look: dict[str, Any] = {"color": plots.COLOURS[k], "ls": plots.STYLES[k]}
        column[0].plot(seconds, theta[..., k].T, lw=0.8, alpha=0.7, **look)
        column[0].plot(seconds, theta[..., k].mean(axis=0), lw=2.5, label=joint, **look)
    look = {"color": plots.COLOURS[2], "where": "post"}
    for run in tension:
        column[1].step(steps, run, lw=0.8, alpha=0.7, **look)
    column[1].step(steps, tension.mean(axis=0), lw=2.5, **look)


def foam_rates(*evidences: Evidence) -> Figure:
    """Share of steps below a threshold under each condition, for both foams."""
    found = _with("foam_control", evidences)
    tables = [evidence["foam_control"] for evidence in found]
    end = 1.6 * max(table["distance"].str[0].max() for table in tables)
    figure, axes = _new_axes(len(found), 2, (5.8, 2.9), sharex=True, sharey=True)
    for row, evidence, table in zip(axes, found, tables, strict=True):
        for ax, foam in zip(row, FOAMS, strict=True):
            of_foam = table[table["cloth"] == foam]
            kinds = {}
            for condition in _CONDITIONS:
                runs = of_foam[of_foam["condition"] == condition]
                kinds[condition] = list(runs["distance"])
            still = float(of_foam["distance"].str[0].mean())
            _draw_rates(ax, kinds, still, end)
            for share, style in _READ_AT.items():
                ax.axvline(share * still, color="0.5", lw=1, ls=style)
        row[0].set_ylabel("steps nearer [%]")
        _name_row(row[0], _amount(evidence, table))

    # Words
    for ax, foam in zip(axes[0], FOAMS, strict=True):
        ax.set_title(foam)
    for ax in axes[-1]:
        ax.set_xlabel("threshold of the distance [s.d. of z]")
    read = []
    for share, style in _READ_AT.items():
        words = f"{100 * share:.0f} % of it"
        read.append(Line2D([], [], color="0.5", lw=1, ls=style, label=words))
    _rates_key(figure, axes[0, 0], read)
    return figure


def foam_quantities(*evidences: Evidence) -> Figure:
    """Nearness, least and largest distance and hand speed, by condition."""
    # A row for each amount of recordings
    found = _with("foam_control", evidences)
    size = (3.2, 2.0 + 1.6 / len(found))  # with room for words below
    figure, axes = _new_axes(len(found), 4, size, sharex=True, sharey="col")
    for row, evidence in zip(axes, found, strict=True):
        table = evidence["foam_control"]
        for ax, (label, values) in zip(row, _quantities(table).items(), strict=True):
            _draw_quantity(ax, values, table)
            ax.set_ylabel(label)
        _name_row(row[0], _amount(evidence, table))

    # Words
    names = [name.removeprefix("Correct").strip(", ") or name for name in _CONDITIONS]
    for ax in axes[-1]:
        ax.set_xticks(range(len(names)), names, rotation=50, ha="right")
    handles, _ = axes[0, 0].get_legend_handles_labels()
    _explain(figure, handles, 2)
    return figure


def _quantities(table: pd.DataFrame) -> dict[str, pd.Series]:
    """What is shown of each run, by its label."""
    speed = table["peak_hand_speed"].map(lambda row: row[0] if len(row) else np.nan)
    return {
        "nearness [0 to 1]": table["distance"].map(nearness),
        "least distance\n[s.d. of z]": table["distance"].map(np.min),
        "largest distance\n[s.d. of z]": table["distance"].map(np.max),
        "highest hand speed\n[m/s]": speed,
    }


def _draw_quantity(ax: Axes, values: pd.Series, table: pd.DataFrame) -> None:
    """Means and standard deviations of both foams, side by side by condition."""
    for k, foam in enumerate(FOAMS):
        of_foam = values[table["cloth"] == foam].groupby(table["condition"])
        mean = of_foam.mean().reindex(_CONDITIONS).dropna()
        spread = of_foam.std().reindex(mean.index).fillna(0)
        x = [_CONDITIONS.index(name) + 0.2 * (k - 0.5) for name in mean.index]
        look: dict[str, Any] = {"color": plots.COLOURS[k], "fmt": "os"[k], "capsize": 3}
        ax.errorbar(x, mean, spread, label=foam, **look)


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
    figure, ((ax,),) = _new_axes(1, 1, (11.0, 0.8 * len(parts) + 1.2))
    ticks = []
    for n, part in enumerate(parts):
        for k, (label, found) in enumerate(judged.items()):
            y = n + 0.36 * (k - 0.5)
            words = [each.verdict for each in found if each.claim.part == part]
            _draw_counts(ax, y, words)
            ticks.append((y, f"{part}, {label}" if k == 0 else label))

    # Words
    ax.set_yticks([y for y, _ in ticks], [label for _, label in ticks])
    ax.set_ylim(len(parts) - 0.5, -0.5)
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.set_xlabel("claims of the paper")
    key = _verdict_key()
    figure.legend(handles=key, loc="outside upper center", ncols=4, fontsize=11)
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
    figure, ((ax,),) = _new_axes(1, 1, (11.0, 1.4 + 0.62 * len(rows)))
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


def _draw_counts(ax: Axes, y: float, words: Sequence[str]) -> None:
    """One bar: its pieces are verdicts, with their numbers in them."""
    start = 0
    for verdict, colour in VERDICT_COLOURS.items():
        count = words.count(verdict)
        if count:
            ax.barh(y, count, 0.3, left=start, color=colour)
            ax.text(
                start + count / 2, y, str(count), ha="center", va="center", fontsize=10
            )
        start += count


FIGURES: dict[str, Callable[..., Figure]] = {
    "sim-pb": maps,
    "sim-control": control_rates,
    "sim-integrated": integrated,
    "sim-zchamfer": chamfer_scatter,
    "act-pb": foam_maps,
    "test-control": foam_throws,
    "eval-graph": foam_rates,
    "eval-all": foam_quantities,
}
