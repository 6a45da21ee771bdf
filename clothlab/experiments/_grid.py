"""One shape for all experiments: a function from one case to one row, a grid of cases, a tidy table.

    control = Experiment("control", run_one, cases, seconds=13)   # in the experiment's module
    table = control.run(control.cases(models=[0], steps=24))      # a pandas.DataFrame, one row a case
    table.groupby(["target", "cloth"]).agg(...)

A row holds the case's own parameters and what was measured: numbers, words, and arrays such as a distance at each step.
So any row can be made anew: `experiment.run_one(**case)`. Tables are stored as CSV, arrays in them as JSON.
"""

import hashlib
import inspect
import io
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
import torch
from tqdm.auto import tqdm

import clothlab
from clothlab import artifacts
from clothlab._files import write_bytes
from clothlab.artifacts import Folder

PAPER = "-paper"  # ending of tables, as of weights: the same with what the paper's amount of recordings teaches

Case = dict[str, Any]  # parameters of `run_one`
Row = dict[str, Any]  # what it found


@dataclass(frozen=True)
class Experiment:
    """An experiment.

    Attributes:
        name: of its table in `data/results`.
        run_one: case → what was measured, `{column: number, word or array}`.
        cases: sizes → the grid of cases; the defaults are the full size.
        seconds: about how long one case takes on one core [s].
        slow: whether it takes hours, so that it runs only when asked for by name.
        paper: the sizes with which it runs on the paper's amount of recordings; none where it does not.
    """

    name: str
    run_one: Callable[..., Row]
    cases: Callable[..., list[Case]]
    seconds: float
    slow: bool = False
    paper: Mapping[str, Any] = field(default_factory=dict)

    @property
    def keys(self) -> list[str]:
        """Columns that say which case a row is."""
        return list(inspect.signature(self.run_one).parameters)

    def run(
        self, cases: Iterable[Case] | None = None, *, workers: int = 1, progress: bool = False, keep: Path | None = None
    ) -> pd.DataFrame:
        """Run the cases, by default all, several at once.

        Args:
            cases: parameters of `run_one`.
            workers: processes; a `joblib.parallel_config` around the call chooses another backend, such as Dask.
            progress: show a progress bar.
            keep: folder where rows are kept, so that an interrupted run goes on where it stopped.

        Returns:
            One row for each case, in their order.
        """
        cases = self.cases() if cases is None else list(cases)
        compute = _compute if keep is None else joblib.Memory(keep, verbose=0).cache(_compute, ignore=["run_one"])
        jobs = (joblib.delayed(compute)(self.run_one, self.name, case, version()) for case in cases)
        rows = joblib.Parallel(n_jobs=workers, return_as="generator")(jobs)
        rows = tqdm(rows, total=len(cases), desc=self.name, unit="run", disable=not progress)
        return pd.DataFrame([case | row for case, row in zip(cases, rows, strict=True)])

    def recompute(self, *, data: Folder = None, **which: Any) -> pd.DataFrame:
        """Make one stored row anew: a table of two rows, "stored" and "here".

        Raises:
            ValueError: no row fits, or several; the message lists them.
        """
        table = load(self.name, data=data)
        for column, value in which.items():
            if column not in self.keys:
                raise ValueError(f"{self.name} has no {column!r}; choose by {', '.join(self.keys)}")
            table = table[table[column] == value]
        if len(table) != 1:
            choices = table[self.keys].head(20).to_string(index=False) if len(table) else "none"
            raise ValueError(f"{len(table)} rows of {self.name} fit; name more of {', '.join(self.keys)}:\n{choices}")
        case = {key: table.iloc[0][key] for key in self.keys}
        here = pd.DataFrame([case | _compute(self.run_one, self.name, case, version())])
        return pd.concat([table, here[table.columns]], keys=["stored", "here"]).droplevel(1)


def _compute(run_one: Callable[..., Row], name: str, case: Case, version: str) -> Row:
    """One row, on one core: cases run side by side, and matrices this small gain nothing from a second.

    The name and the version are there for the cache, to tell experiments apart and to know when code or data changed.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return run_one(**case)
    finally:
        torch.set_num_threads(threads)


@cache
def version() -> str:
    """Hash of the code and of the data that experiments read: work is done again when either changes."""
    digest = hashlib.sha256()
    for path in sorted(Path(clothlab.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    recorded = artifacts.data_folder() / artifacts.CHECKSUMS
    lines = recorded.read_text().splitlines() if recorded.exists() else []
    digest.update("\n".join(line for line in lines if "  results/" not in line).encode())
    return digest.hexdigest()


def save(table: pd.DataFrame, name: str, *, data: Folder = None) -> None:
    """Write a table as `data/results/NAME.csv`."""
    text = table.map(_as_text).to_csv(index=False)
    write_bytes(artifacts.data_folder(data) / "results" / f"{name}.csv", text.encode())


def load(name: str, *, data: Folder = None) -> pd.DataFrame:
    """Read a stored table: one row a case, arrays as NumPy arrays.

    Raises:
        KeyError: unknown name; the message lists the choices.
        ValueError: a damaged or altered file.
    """
    content = artifacts.read_results(name, ".csv", data=data)
    table = pd.read_csv(io.BytesIO(content), float_precision="round_trip", keep_default_na=False, na_values=[""])
    for column in table.columns[table.dtypes == "str"]:
        if table[column].str.startswith("[").any():
            table[column] = table[column].map(_as_array, na_action="ignore")
    return table


def _as_text(value: Any) -> Any:
    if isinstance(value, np.ndarray | list | tuple):
        array = np.asarray(value)
        # By way of text, float32 keeps the few digits that it has: 0.1, not 0.10000000149.
        return json.dumps((array.astype(str).astype(float) if array.dtype == np.float32 else array).tolist())
    return value


def _as_array(text: str) -> np.ndarray:
    return np.asarray(json.loads(text))
