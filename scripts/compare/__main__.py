"""`python -m scripts.compare`: every number of the old records is in the new tables."""

import importlib
import json
import pkgutil
import subprocess
from typing import Any

import numpy as np

import scripts.compare
from clothlab.experiments import load

BEFORE = "66ec033"  # the last commit with records


def old(name: str) -> dict[str, Any]:
    """A record as it was stored."""
    shown = subprocess.run(
        ["git", "show", f"{BEFORE}:data/results/{name}.json"], capture_output=True, text=True, check=True
    )
    return json.loads(shown.stdout)["record"]


def numbers(value: Any) -> int:
    """How many numbers JSON has here."""
    if isinstance(value, dict):
        return sum(map(numbers, value.values()))
    if isinstance(value, list):
        return sum(map(numbers, value))
    return int(isinstance(value, int | float) and not isinstance(value, bool))


def compare(name: str, wanted: list[dict[str, Any]]) -> int:
    """Assert that a table has these rows, in this order, and perhaps more columns; how many numbers were compared."""
    table, count = load(name), 0
    assert len(table) == len(wanted), (name, len(table), len(wanted))
    for (_, found), row in zip(table.iterrows(), wanted, strict=True):
        for column, value in row.items():
            here = found[column]
            if value is None:
                assert np.isnan(here), (name, column)
            else:
                assert np.array_equal(np.asarray(here), np.asarray(value)), (name, column, here, value)
            count += numbers(value)
    return count


def main() -> None:
    """Compare all."""
    for each in pkgutil.iter_modules(scripts.compare.__path__):
        if each.name == "__main__":
            continue
        module = importlib.import_module(f"scripts.compare.{each.name}")
        for name in module.NAMES:
            record = old(name)
            tables = module.tables(name, record)
            counts = {table: compare(table, rows) for table, rows in tables.items()}
            print(f"{name}: {numbers(record)} numbers before,", ", ".join(f"{k} {v}" for k, v in counts.items()))


if __name__ == "__main__":
    main()
