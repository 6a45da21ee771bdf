"""One shape for all experiments: a function from a case to a row, a grid, a table.

    cases = over(target=TARGETS, model=range(5))
    control = Experiment("control", run_one, cases)

    # A pandas.DataFrame, one row a case
    table = control.run(control.cases(model=0, steps=24))
    table.groupby(["target", "cloth"]).agg(...)

A row holds the case's own parameters and what was measured: numbers, words, and arrays
such as a distance at each step. So any row can be made anew: `run_one(**case)`. Tables
are stored as CSV, arrays in them as JSON.
"""

import functools
import inspect
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from clothlab.data import Folder, load_table
from studies._parallel import kept, side_by_side

# Ending of tables, as of weights: the same with what the paper's amount of recordings
# teaches
PAPER = "-paper"

Case = dict[str, Any]  # parameters of `run_one`
_T = TypeVar("_T")


def grid(**axes: Any) -> list[Case]:
    """All combinations of the values of each parameter, the last one running fastest.

    Words and numbers are one value:
    `grid(cloth=["hard-1", "soft-1"], model=range(5), steps=250)` has ten cases.
    """
    lists = []
    for values in axes.values():
        several = isinstance(values, Iterable) and not isinstance(values, str)
        lists.append(values if several else [values])
    return [dict(zip(axes, each, strict=True)) for each in itertools.product(*lists)]


def over(**axes: Any) -> Callable[..., list[Case]]:
    """The function from sizes to cases of a full grid.

    Such as `over(cloth=CLOTHS, model=range(5))(model=0, steps=24)`.
    """
    return lambda **sizes: grid(**(axes | sizes))


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    Attributes:
        name: of its table in `data/results`.
        run_one: case → what was measured, `{column: number, word or array}`.
        cases: sizes → the grid of cases; the defaults are the full size.
        slow: whether all of it takes hours, so that it runs only when asked for by
            name.
        paper: the sizes with which it also runs on the paper's amount of recordings;
            none where it does not.
    """

    name: str
    run_one: Callable[..., dict[str, Any]]
    cases: Callable[..., list[Case]]
    slow: bool = False
    paper: Mapping[str, Any] = field(default_factory=dict)

    @property
    def keys(self) -> list[str]:
        """Columns that say which case a row is."""
        return list(inspect.signature(self.run_one).parameters)

    def run(
        self,
        cases: Iterable[Case] | None = None,
        *,
        workers: int = 1,
        progress: bool = False,
    ) -> pd.DataFrame:
        """One row for each case, by default for all.

        Parameters that a case leaves out have their defaults. How rows are kept and
        computed elsewhere, `studies._parallel` says.
        """
        chosen = self.cases() if cases is None else cases
        cases = [self.defaults | case for case in chosen]
        fixed = {"run_one": self.run_one, "name": self.name}
        calls = [fixed | {"case": case} for case in cases]
        rows = side_by_side(
            _kept_row, calls, self.name, workers=workers, progress=progress
        )
        return pd.DataFrame([case | row for case, row in zip(cases, rows, strict=True)])

    def recompute(self, *, data: Folder = None, **which: Any) -> pd.DataFrame:
        """Make one stored row anew: a table of two rows, "stored" and "here"."""
        table = self._find(load_table(self.name, data=data), which)
        case = {key: _as_parameter(table.iloc[0][key]) for key in self.keys}
        (row,) = side_by_side(self.run_one, [case], self.name)
        here = pd.DataFrame([case | row])
        both = pd.concat([table, here[table.columns]], keys=["stored", "here"])
        return both.droplevel(1)

    def _find(self, table: pd.DataFrame, which: Case) -> pd.DataFrame:
        """The one row of a table that fits; a ValueError says how to choose one."""
        for column, value in which.items():
            if column not in self.keys:
                raise ValueError(
                    f"{self.name} has no {column!r}; choose by {', '.join(self.keys)}"
                )
            fits = table[column].isna() if value is None else table[column] == value
            table = table[fits]
        if len(table) == 1:
            return table

        # By what those that fit differ, and what there is
        varied = self.keys
        choices = ""
        if len(table):
            varied = [key for key in self.keys if table[key].nunique() > 1]
            choices = f":\n{table[varied].head(20).to_string(index=False)}"
        raise ValueError(
            f"{len(table)} rows of {self.name} fit; "
            f"choose by {', '.join(varied)}{choices}"
        )

    @property
    def defaults(self) -> Case:
        """Parameters of `run_one` that have a default."""
        parameters = inspect.signature(self.run_one).parameters.values()
        return {
            each.name: each.default
            for each in parameters
            if each.default is not inspect.Parameter.empty
        }


def shared(function: Callable[..., _T]) -> Callable[..., _T]:
    """Decorate work that several cases share, such as a training.

    It is done once in each process, and once at all where rows are kept.
    """

    @functools.cache
    @functools.wraps(function)
    def once(*arguments: Any) -> _T:
        return kept().cache(function)(*arguments)

    return once


def _kept_row(run_one: Callable[..., dict], name: str, case: Case) -> dict[str, Any]:
    compute = kept().cache(_row, ignore=["run_one"])
    return compute(run_one, name, case)


def _row(run_one: Callable[..., dict], name: str, case: Case) -> dict[str, Any]:
    """A row, which is found again by the experiment's name and the case."""
    return run_one(**case)


def _as_parameter(value: Any) -> Any:
    """A stored parameter as `run_one` takes it: an empty field is None."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and np.isnan(value) else value
