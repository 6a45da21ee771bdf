"""Tables of results in `data/results/`: one row a case, as CSV, with arrays as JSON."""

import io
import json
from typing import Any

import numpy as np
import pandas as pd

from clothlab._store import Folder, load_results, save_results


def save(table: pd.DataFrame, name: str, *, data: Folder = None) -> None:
    """Write a table as `data/results/NAME.csv`."""
    text = table.map(_as_text).to_csv(index=False)
    save_results(text.encode(), name, ".csv", data=data)


def load(name: str, *, data: Folder = None) -> pd.DataFrame:
    """Read a stored table: one row a case, arrays as NumPy arrays."""
    content = load_results(name, ".csv", data=data)
    table = pd.read_csv(io.BytesIO(content), keep_default_na=False, na_values=[""])
    for column in table.columns[table.dtypes == "str"]:
        if table[column].str.startswith("[").any():
            table[column] = table[column].map(_as_array, na_action="ignore")
    return table


def _as_text(value: Any) -> Any:
    """An array, or a list of numbers, as JSON; all else as it is."""
    if not isinstance(value, np.ndarray | list | tuple):
        return value
    array = np.asarray(value)
    if array.dtype == np.float32:
        # By way of text, it keeps the few digits that it has: 0.1, not 0.10000000149
        array = array.astype(str).astype(float)
    return json.dumps(array.tolist())


def _as_array(text: str) -> np.ndarray:
    return np.asarray(json.loads(text))
