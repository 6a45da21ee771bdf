"""Runs of what a robot wrote down: a table of pandas with a row for each moment.

A log has a row whenever something was written, never quite evenly, with gaps where the
writing stopped. A run has a state and a command every so many milliseconds.
"""

import warnings
from collections.abc import Sequence

import numpy as np
import pandas as pd

from clothlab._validation import check_number, choose
from clothlab.method.data import Run, too_far_from_zero

# Times that differ by less than this share of a step are the same: decimal fractions
# of a second have no exact binary ones.
_ROUNDING = 1e-6
# Rows further apart than so many steps leave states in between that nobody measured.
_SPARSE = 1.5
_LONGEST_GAP = 3  # steps
_AVERAGE = {"average": True, "last": False}


def runs_from_table(
    table: pd.DataFrame,
    material: str,
    *,
    time: str,
    states: Sequence[str],
    commands: Sequence[str],
    step: float,
    longest_gap: float | None = None,
    resample_commands: str = "average",
    shortest: int = 31,
) -> list[Run]:
    """Make runs of a log of one material: evenly spaced, without gaps.

    From the first row on, and again after each gap, there is a state and a command
    every step:

    * A state lies on the straight line between the rows before and after it. An angle
      that jumps from π to -π has no such line: log its cosine and sine. Nor has a
      quaternion that changes its sign: log it with the sign of the row before.
    * A command is the average of those sent from then until the next state, each held
      until the following row: what moves the robot from one state to the next, and
      nothing that was sent later. With `resample_commands="last"` it is the last one
      sent until then, for commands that have no average. A change of command then
      counts up to a step late.

    Args:
        table: The log, in the order of its rows.
        material: Name of what stays the same within the log, such as "heavy".
        time: Name of the column of times [s], or dates, which must rise.
        states: Names of the columns of the state `[D_s]`.
        commands: Names of the columns of the command `[D_u]`.
        step: Between two states of a run [s]; the log may have more rows than that.
        longest_gap: Rows that are further apart [s] end a run, and begin another; three
            steps by default.
        resample_commands: "average" of what is sent in a step, or the "last" before it.
        shortest: Runs of fewer steps are left out, and a warning counts them.

    Returns:
        The runs, with `step` and the names of their columns.

    Raises:
        KeyError: No such column.
        ValueError: A number is missing, times do not rise, rows are too far apart for
            the step, or no run is long enough.
    """
    step = check_number("step", step, above=0)
    longest_gap = _LONGEST_GAP * step if longest_gap is None else longest_gap
    check_number("longest_gap", longest_gap, at_least=step)
    average = choose("way to resample commands", resample_commands, _AVERAGE)
    seconds = _seconds(table, time)
    s = _numbers(table, states)
    u = _numbers(table, commands)
    _check_dense(seconds, step)
    _check_digits([*states, *commands], np.hstack([s, u]))

    # Each stretch without a gap has even steps of its own.
    gaps = np.flatnonzero(np.diff(seconds) > longest_gap * (1 + _ROUNDING)) + 1
    runs = []
    for rows in np.split(np.arange(len(seconds)), gaps):
        even_s, even_u = _at_even_times(seconds[rows], s[rows], u[rows], step, average)
        run = Run(
            even_s,
            even_u,
            material,
            step=step,
            state_names=tuple(map(str, states)),
            command_names=tuple(map(str, commands)),
        )
        runs.append(run)
    return _long_enough(runs, shortest)


def _column(table: pd.DataFrame, name: str) -> pd.Series:
    """One column; an error if there is none of this name, or more than one."""
    names = [str(each) for each in table.columns]
    if name not in table.columns:
        raise KeyError(f"no column {name!r}; choose from {', '.join(names)}")
    column = table[name]
    if column.ndim != 1:
        raise ValueError(f"{names.count(str(name))} columns have the name {name!r}")
    return column


def _numbers(table: pd.DataFrame, names: Sequence[str]) -> np.ndarray:
    """Columns `[R, D]`; a ValueError names row and column of what is no number."""
    if isinstance(names, str) or not names:
        raise ValueError(f"states and commands are lists of columns, got {names!r}")
    columns = []
    for name in names:
        column = _column(table, name)
        numbers = pd.to_numeric(column, errors="coerce")
        numbers = numbers.to_numpy(np.float64, na_value=np.nan)
        missing = ~np.isfinite(numbers)
        if missing.any():
            row = int(missing.argmax())
            raise ValueError(
                f"row {row} (counted from 0), column {name!r} is no finite number: "
                f"{column.iloc[row]!r}, as in {int(missing.sum())} of {len(numbers)} "
                "rows. table.ffill(limit=3) takes the value before, table.dropna() "
                "leaves such rows out"
            )
        columns.append(numbers)
    return np.stack(columns, axis=1)


def _seconds(table: pd.DataFrame, name: str) -> np.ndarray:
    """Time since the first row `[R]` [s], rising."""
    times = _column(table, name)
    if not len(times):
        raise ValueError("the log is empty: it has no rows")
    if times.isna().any():
        row = int(times.isna().to_numpy().argmax())
        raise ValueError(
            f"row {row} (counted from 0) has no time (column {name!r}): leave it out"
        )

    # What is counted since 1970 keeps its digits: the first comes off before it is
    # rounded.
    if not pd.api.types.is_numeric_dtype(times):
        times = pd.to_datetime(times)
    since = times - times.iloc[0]
    if not pd.api.types.is_numeric_dtype(since):
        since = since.dt.total_seconds()
    seconds = since.to_numpy(np.float64)

    # Each row comes after the one before.
    late = ~(np.diff(seconds) > 0)
    if late.any():
        row = int(late.argmax()) + 1
        raise ValueError(
            f"times must rise, but row {row} (counted from 0) with {times.iloc[row]} "
            f"comes after {times.iloc[row - 1]}: leave doubles out, sort the rows, or "
            "cut the log where its clock began again"
        )
    return seconds


def _check_dense(seconds: np.ndarray, step: float) -> None:
    """A ValueError where rows are much further apart than the step [s]."""
    usual = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    if usual > _SPARSE * step:
        raise ValueError(
            f"rows are {usual:.4g} s apart (median) and the step is {step:g} s: states "
            "in between were not measured. Choose a step that is at least as long; or "
            "is the time in other units than seconds?"
        )


def _check_digits(names: Sequence[str], values: np.ndarray) -> None:
    """A ValueError for what is so far from zero that single precision rounds it."""
    lost = too_far_from_zero(values)
    if lost.any():
        k = int(lost.argmax())
        raise ValueError(
            f"column {names[k]!r} varies by {values[:, k].std():.3g} around "
            f"{values[:, k].mean():.8g}, of which the single precision of networks "
            "keeps too little: take a constant off"
        )


def _at_even_times(
    seconds: np.ndarray, s: np.ndarray, u: np.ndarray, step: float, average: bool
) -> tuple[np.ndarray, np.ndarray]:
    """States `[T, D_s]` and commands `[T, D_u]` every `step` [s] from the first row on.

    A state lies on the straight line between those measured before and after it. A
    command is the average of those sent from then until the next state, or else the
    last one sent until then.
    """
    since = seconds - seconds[0]
    count = int(since[-1] / step + _ROUNDING) + 1
    even = step * np.arange(count)
    even_s = [np.interp(even, since, values) for values in s.T]

    # The row of the last command until each state, and of the last before the next
    tolerance = _ROUNDING * step
    until = np.searchsorted(since, even + tolerance, side="right") - 1
    even_u = u[until]
    if average:
        before_next = np.searchsorted(since, even + step - tolerance) - 1
        several = before_next > until
        even_u[several] = _averages(since, u, even[several], step)
    return np.stack(even_s, axis=1), even_u


def _averages(
    since: np.ndarray, u: np.ndarray, starts: np.ndarray, step: float
) -> np.ndarray:
    """Averages over a step from each start `[N, D_u]` of commands held from row to row.

    `since` are the rows' times `[R]`, `u` their commands `[R, D_u]`.
    """
    # The last is held for longer than any step that begins before it.
    edges = np.append(since, since[-1] + 2 * step)
    sums = np.cumsum(u * np.diff(edges)[:, None], axis=0)
    integrals = np.vstack([np.zeros(u.shape[1]), sums]).T
    means = [
        (np.interp(starts + step, edges, each) - np.interp(starts, edges, each)) / step
        for each in integrals
    ]
    return np.stack(means, axis=1)


def _long_enough(runs: Sequence[Run], shortest: int) -> list[Run]:
    """The runs of at least so many steps; a warning counts those that are left out."""
    kept = [run for run in runs if len(run) >= shortest]
    lengths = [len(run) for run in runs]
    if not kept:
        raise ValueError(
            f"none of {len(runs)} runs has {shortest} steps, the longest has "
            f"{max(lengths)}: record longer runs, or set `shortest` to as many as are "
            "enough for you, one more than the sequence that is trained on"
        )
    left_out = sum(lengths) - sum(map(len, kept))
    if left_out:
        warnings.warn(
            f"{len(runs) - len(kept)} of {len(runs)} runs have fewer than {shortest} "
            f"steps and are left out, {left_out} of {sum(lengths)} steps",
            stacklevel=3,
        )
    return kept
