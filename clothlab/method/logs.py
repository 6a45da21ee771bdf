"""Runs of what a robot wrote down: tables in memory, and folders of files.

A log has a row whenever something was written, never quite evenly, with gaps where the
writing stopped and numbers that are missing. A run has a state and a command every so
many milliseconds.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tqdm.auto import tqdm

from clothlab._validation import check_each, check_kind, check_number, choose
from clothlab.method._inputs import SHORTEST, long_enough
from clothlab.method._log_files import log_files, read_file
from clothlab.method._table import (
    at_even_times,
    check_dense,
    column,
    column_names,
    hold,
    pieces,
    read_table,
    refuse_missing,
    stretches,
)
from clothlab.method.data import Run

# Steps that a gap may last: then few states lie on a line that nobody measured.
_LONGEST_GAP = 3
_MISSING = {"refuse": "refuse", "hold": "hold", "split": "split"}
_AVERAGE = {"average": True, "last": False}


def runs_from_dataframe(
    data: Any,
    material: str,
    *,
    time: str,
    states: Sequence[str],
    commands: Sequence[str],
    step: float,
    longest_gap: float | None = None,
    missing: str = "refuse",
    resample_commands: str = "average",
    shortest: int = SHORTEST,
) -> list[Run]:
    """Make runs of a log of one material: evenly spaced, without gaps.

    From the first row on, and again after each gap, there is a state and a command
    every step:

    * A state lies on the straight line between the rows before and after it. An angle
      that jumps from π to -π has no such line: log its cosine and sine.
    * A command is the average of those sent from then until the next state, each held
      until the following row: what moves the robot from one state to the next, and
      nothing that was sent later. With `resample_commands="last"` it is the last one
      sent until then, for commands that have no average, or that a fast controller
      sends in answer to what happens within a step. A change of command then counts up
      to a step late.

    Args:
        data: A table of pandas, polars or PyArrow, or a mapping of columns.
        material: Name of what stays the same within the log, such as "heavy".
        time: Name of the column of times [s], or dates, which must rise.
        states: Names of the columns of the state `[D_s]`.
        commands: Names of the columns of the command `[D_u]`.
        step: Between two states of a run [s]; the log may have more rows than that.
        longest_gap: Rows that are further apart [s] end a run, and begin another; three
            steps by default.
        missing: What becomes of NaN, infinity or nothing at all in these columns:
            "refuse" says where it is; "hold" takes the value before, for at most
            `longest_gap`, and splits where it lasts longer; "split" leaves the row out,
            and ends the run before it.
        resample_commands: "average" of what is sent in a step, or the "last" before it.
        shortest: Runs of fewer steps are left out, and a warning counts them.

    Returns:
        The runs, with `step` and the names of their columns.

    Raises:
        KeyError: No such column, or no such way with what is missing.
        ValueError: A number is missing, times do not rise, rows are too far apart for
            the step, or no run is long enough.
    """
    columns = _columns(time, states, commands)
    recipe = _recipe(columns, step, longest_gap, missing, resample_commands)
    check_kind("material", material, str)
    check_number("shortest", shortest, int, at_least=1)
    return long_enough(recipe.runs(data, material), shortest)


def read_runs(
    files: str | Path | Iterable[str | Path],
    material: Callable[[Path], str] | str | None = None,
    *,
    time: str,
    states: Sequence[str],
    commands: Sequence[str],
    step: float,
    longest_gap: float | None = None,
    missing: str = "refuse",
    resample_commands: str = "average",
    shortest: int = SHORTEST,
    progress: bool = True,
) -> list[Run]:
    """Read logs from CSV and Parquet files, each as `runs_from_dataframe` does.

    Args:
        files: A folder, of which all `.csv` and `.parquet` below are read; a pattern
            such as "logs/*/run-*.csv"; or paths. Folders are read in order of names.
        material: A function of a file's path; or the name of the column that says it,
            of which each stretch of one name is a log; by default the name of the
            folder in which a file lies.
        time: Name of the column of times [s], which must rise.
        states: Names of the columns of the state `[D_s]`.
        commands: Names of the columns of the command `[D_u]`.
        step: Between two states of a run [s].
        longest_gap: Rows that are further apart [s] end a run.
        missing: "refuse", "hold" or "split".
        resample_commands: "average" or "last".
        shortest: Runs of fewer steps are left out, and a warning counts them.
        progress: Whether a bar shows how many files are read.

    Raises:
        ValueError: As of `runs_from_dataframe`, after the name of the file.
    """
    columns = _columns(time, states, commands)
    recipe = _recipe(columns, step, longest_gap, missing, resample_commands)
    check_number("shortest", shortest, int, at_least=1)
    paths = log_files(files)

    # A file that can't be used is named.
    runs = []
    for path in tqdm(paths, desc="logs", unit="file", disable=not progress):
        data = read_file(path)
        try:
            for name, part in _by_material(data, path, material):
                runs += recipe.runs(part, name)
        except (KeyError, ValueError) as error:
            raise ValueError(f"{path}: {error.args[0]}") from error
    return long_enough(runs, shortest)


class _Columns(NamedTuple):
    """Names of columns."""

    time: str
    states: tuple[str, ...]
    commands: tuple[str, ...]


@dataclass(frozen=True)
class _Recipe:
    """How any log becomes runs, wherever it comes from."""

    columns: _Columns
    step: float
    longest_gap: float
    missing: str
    average: bool  # of commands

    def runs(self, data: Any, material: str) -> list[Run]:
        """All runs of one log, however short."""
        time, states, commands = self.columns
        table = read_table(data, time, states, commands)
        if self.missing == "refuse":
            refuse_missing(table, (*states, *commands))
        check_dense(table, self.step)
        if self.missing == "hold":
            table = hold(table, self.longest_gap)
        parts = pieces(table, self.longest_gap)
        if not parts:
            raise ValueError("each row of the log lacks some number")

        # Each piece has even steps of its own.
        runs = []
        for part in parts:
            s, u = at_even_times(part, self.step, self.average)
            run = Run(
                s,
                u,
                material,
                step=self.step,
                state_names=states,
                command_names=commands,
            )
            runs.append(run)
        return runs


def _recipe(
    columns: _Columns,
    step: float,
    longest_gap: float | None,
    missing: str,
    resample_commands: str,
) -> _Recipe:
    """The recipe that is asked for; an error if it makes no sense."""
    step = check_number("step", step, above=0)
    if longest_gap is None:
        longest_gap = _LONGEST_GAP * step
    longest_gap = check_number("longest_gap", longest_gap, at_least=step)
    choose("way with what is missing", missing, _MISSING)
    average = choose("way to resample commands", resample_commands, _AVERAGE)
    return _Recipe(columns, step, longest_gap, missing, average)


def _columns(time: str, states: Sequence[str], commands: Sequence[str]) -> _Columns:
    """The columns that are asked for; a ValueError for one that is given twice."""
    check_kind("time", time, str)
    columns = _Columns(time, _names("states", states), _names("commands", commands))
    every = [time, *columns.states, *columns.commands]
    double = sorted({name for name in every if every.count(name) > 1})
    if double:
        raise ValueError(
            f"columns that are given twice: {', '.join(double)}. Each is the time, a "
            "state or a command"
        )
    return columns


def _names(what: str, names: Sequence[str]) -> tuple[str, ...]:
    """Names of columns; a single one may be given as it is."""
    listed = [names] if isinstance(names, str) else check_each(what, names, str)
    if not listed:
        raise ValueError(f"{what} are names of columns, got none")
    return tuple(listed)


def _by_material(
    data: Any, path: Path, material: Callable[[Path], str] | str | None
) -> list[tuple[str, Any]]:
    """Each material of a file, and the rows that belong to it."""
    if material is None:
        return [(path.resolve().parent.name, data)]
    if not isinstance(material, str):
        return [(check_kind(f"material of {path.name}", material(path), str), data)]

    # Only columns are cut, so that any table will do.
    labels = column(data, material).astype(str)
    columns = {name: column(data, name) for name in column_names(data)}
    return [
        (str(labels[rows][0]), {name: each[rows] for name, each in columns.items()})
        for rows in stretches(labels)
    ]
