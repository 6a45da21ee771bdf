"""Columns of a log, and evenly spaced states and commands made of them."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

# Times that differ by less than this share of a step are the same: decimal fractions
# of a second have no exact binary ones.
_ROUNDING = 1e-6
# Rows further apart than so many steps leave states in between that nobody measured.
_SPARSE = 1.5


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of a log, as they were written."""

    time: np.ndarray  # of each row [R] [s]
    s: np.ndarray  # states [R, D_s], NaN where there is none
    u: np.ndarray  # commands [R, D_u], likewise

    def __len__(self) -> int:
        """Return the number of rows R."""
        return len(self.time)

    def __getitem__(self, rows: Any) -> "Table":
        """Return some of the rows."""
        return Table(self.time[rows], self.s[rows], self.u[rows])


def column_names(data: Any) -> list[str]:
    """Names of the columns of a table of pandas, polars or PyArrow, or of a mapping."""
    for name in ("column_names", "columns", "keys"):
        names = getattr(data, name, None)
        if names is not None:
            return [str(each) for each in (names() if callable(names) else names)]
    raise ValueError(
        "a log is a table of pandas, polars or PyArrow, or columns by name "
        f"{{'time': [...]}}, got {type(data).__name__} {data!s:.60}"
    )


def column(data: Any, name: str) -> np.ndarray:
    """One column `[R]`; a KeyError lists the columns that there are."""
    names = column_names(data)
    if name not in names:
        raise KeyError(f"no column {name!r}; choose from {', '.join(names)}")
    return np.asarray(data[name])


def read_table(
    data: Any, time: str, states: Sequence[str], commands: Sequence[str]
) -> Table:
    """The columns that are asked for, NaN where a number is missing or not finite.

    A ValueError names row and column of what is no number at all.
    """
    columns = {name: _numbers(data, name) for name in (*states, *commands)}
    seconds = _seconds(data, time)
    for name, values in columns.items():
        if len(values) != len(seconds):
            raise ValueError(
                f"column {name!r} has {len(values)} rows, {time!r} has {len(seconds)}"
            )

    s = np.stack([columns[name] for name in states], axis=1)
    u = np.stack([columns[name] for name in commands], axis=1)
    return Table(seconds, s, u)


def _numbers(data: Any, name: str) -> np.ndarray:
    """One column as float64 `[R]`, NaN where it has none or one that isn't finite."""
    values = column(data, name)
    try:
        numbers = values.astype(np.float64)
    except (TypeError, ValueError):
        row, value = next(_no_numbers(values))
        raise ValueError(
            f"row {row} (counted from 0), column {name!r} is no number: "
            f"{str(value)!r:.60}"
        ) from None
    if numbers.ndim != 1:
        raise ValueError(
            f"column {name!r} holds {list(numbers.shape[1:])} numbers in each row: "
            "give each a column of its own"
        )
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _no_numbers(values: np.ndarray) -> Iterator[tuple[int, Any]]:
    for row, value in enumerate(values):
        try:
            np.asarray(value).astype(np.float64)
        except (TypeError, ValueError):
            yield row, value


def _seconds(data: Any, name: str) -> np.ndarray:
    """The times of rows `[R]` [s], rising; dates count from the first."""
    values = column(data, name)
    if not len(values):
        raise ValueError("the log is empty: it has no rows")
    if values.dtype.kind == "M":
        since = (values - values[0]) / np.timedelta64(1, "ns") / 1e9
        seconds = np.where(np.isnat(values), np.nan, since)
    elif hasattr(values[0], "timestamp"):  # dates with a time zone
        stamps = np.array([each.timestamp() for each in values])
        seconds = stamps - stamps[0]
    else:
        seconds = _numbers({name: values}, name)

    # Each row has a time, after the one before.
    if np.isnan(seconds).any():
        row = int(np.isnan(seconds).argmax())
        raise ValueError(
            f"row {row} (counted from 0) has no time (column {name!r}): leave it out"
        )
    late = np.diff(seconds) <= 0
    if late.any():
        row = int(late.argmax()) + 1
        raise ValueError(
            f"times must rise, but row {row} (counted from 0) with "
            f"{seconds[row]:.10g} s comes after {seconds[row - 1]:.10g} s: leave "
            "doubles out, sort the rows, or cut the log where its clock began anew"
        )
    return seconds


def refuse_missing(table: Table, names: Sequence[str]) -> None:
    """A ValueError names row and column of the first number that is missing."""
    lacking = np.isnan(np.hstack([table.s, table.u]))
    if lacking.any():
        row = int(lacking.any(1).argmax())
        name = names[int(lacking[row].argmax())]
        raise ValueError(
            f"row {row} (counted from 0), column {name!r} is NaN, infinite or empty, "
            f"as is something in {int(lacking.any(1).sum())} of {len(table)} rows: "
            'missing="hold" takes the value before, missing="split" cuts the run there'
        )


def hold(table: Table, longest: float) -> Table:
    """Fill what is missing with the value before, if that is at most so old [s]."""
    filled = [_held(table.time, each, longest) for each in (table.s, table.u)]
    return replace(table, s=filled[0], u=filled[1])


def _held(time: np.ndarray, values: np.ndarray, longest: float) -> np.ndarray:
    """Columns `[R, D]` in which the last number that there was is held."""
    there = ~np.isnan(values)
    rows = np.arange(len(time))[:, None]
    last = np.maximum.accumulate(np.where(there, rows, -1), axis=0)
    held = np.take_along_axis(values, np.maximum(last, 0), axis=0)
    age = time[:, None] - time[np.maximum(last, 0)]
    recent = age <= longest * (1 + _ROUNDING)
    return np.where((last >= 0) & recent, held, np.nan)


def pieces(table: Table, longest: float) -> list[Table]:
    """Stretches without a gap longer than this [s], and with all their numbers."""
    whole = ~np.isnan(np.hstack([table.s, table.u])).any(1)
    rows = np.flatnonzero(whole)
    if not len(rows):
        return []
    # A row that was left out is a gap, too: nothing tells what was in it.
    apart = np.diff(table.time[rows]) > longest * (1 + _ROUNDING)
    gaps = apart | (np.diff(rows) > 1)
    parts = np.split(rows, np.flatnonzero(gaps) + 1)
    return [table[part] for part in parts]


def check_dense(table: Table, step: float) -> None:
    """A ValueError where rows are much further apart than the step [s]."""
    if len(table) < 2:
        return
    usual = float(np.median(np.diff(table.time)))
    if usual > _SPARSE * step:
        raise ValueError(
            f"rows are {usual:.4g} s apart (median) and the step is {step:g} s: states "
            "in between were not measured. Choose a step that is at least as long; or "
            "is the time in other units than seconds?"
        )


def at_even_times(
    table: Table, step: float, average: bool
) -> tuple[np.ndarray, np.ndarray]:
    """States `[T, D_s]` and commands `[T, D_u]` every `step` [s] from the first row on.

    A state lies on the straight line between those measured before and after it. A
    command is the average of those sent from then until the next state, or else the
    last one sent until then.
    """
    since = table.time - table.time[0]
    count = int(since[-1] / step + _ROUNDING) + 1
    even = step * np.arange(count)
    s = [np.interp(even, since, values) for values in table.s.T]

    # The row of the last command until each state, and of the last before the next
    tolerance = _ROUNDING * step
    until = np.searchsorted(since, even + tolerance, side="right") - 1
    u = table.u[until]
    if average:
        before_next = np.searchsorted(since, even + step - tolerance) - 1
        several = before_next > until
        u[several] = _averages(since, table.u, even[several], step)
    return np.stack(s, axis=1), u


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


def stretches(labels: ArrayLike) -> list[slice]:
    """Where successive rows have the same label `[R]`."""
    labels = np.asarray(labels)
    changes = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    edges = [0, *changes.tolist(), len(labels)]
    return [slice(first, last) for first, last in itertools.pairwise(edges)]
