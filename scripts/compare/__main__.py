"""`python -m scripts.compare`: every number of the old records is in the new tables."""

import importlib
import json
import pkgutil
import subprocess
from typing import Any

import numpy as np

import scripts.compare
from clothlab.experiments import load
from clothlab.experiments.tables import questions, stored

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


def compare_rows() -> None:
    """Assert that rows of the results have the figures of the README's tables before, by `FIGURES` of each module."""
    shown = subprocess.run(
        ["git", "show", f"{BEFORE}:data/results/table.json"], capture_output=True, text=True, check=True
    )
    before = {row["what"]: row for rows in json.loads(shown.stdout)["tables"].values() for row in rows}
    for ending, column in (("", "here"), ("-paper", "on_papers")):
        rows = [row for each in questions(stored(ending)).values() for row in each]
        assert len({row.key for row in rows}) == len(rows)
        found = {row.key: row for row in rows}
        known = {key: label for module in modules() for key, label in getattr(module, "FIGURES", {}).items()}
        for key, label in known.items():
            if key in found:
                text = before[label][column]
                assert text == found[key].figure or text.startswith(found[key].figure + " "), (key, text, found[key])
        print(
            f"rows{ending}: {len(known.keys() & found.keys())} equal, not known before: {found.keys() - known.keys()}"
        )


def modules() -> list:
    """Those of this folder."""
    names = [each.name for each in pkgutil.iter_modules(scripts.compare.__path__) if each.name != "__main__"]
    return [importlib.import_module(f"scripts.compare.{name}") for name in names]


def main() -> None:
    """Compare all."""
    for module in modules():
        for name in module.NAMES:
            record = old(name)
            tables = module.tables(name, record)
            counts = {table: compare(table, rows) for table, rows in tables.items()}
            print(f"{name}: {numbers(record)} numbers before,", ", ".join(f"{k} {v}" for k, v in counts.items()))
    compare_rows()


if __name__ == "__main__":
    main()
