"""`make results`: run the experiments at full size from `data/`, with fresh simulation.

Writes the records to `data/results/`, which notebooks and claims read, and the tables into the README, with
the weights of both amounts of recordings. What takes long runs only when `--only` names it; otherwise its stored record
stays as it is.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

from clothlab import artifacts, experiments
from clothlab._files import write_bytes
from clothlab.experiments import tables

README = Path(__file__).resolve().parents[1] / "README.md"


def publish() -> None:
    """Make the tables from the stored records: print them, store them, put them into the README."""
    records = experiments.load_all()
    write_bytes(README, tables.in_readme(README.read_text(), records).encode())
    artifacts.save_results({"tables": tables.as_json(records)}, "table")
    artifacts.write_checksums()
    for name in tables.TABLES:
        for row in tables.table(name, records):
            mark = {True: "✓", False: "✗", None: " "}[row.held]
            print(f"{mark} {row.what}: {row.here} (from the paper's amount {row.on_papers}, aim {row.aim})")


def main() -> None:
    """Run, store, publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=experiments.EXPERIMENTS, help="leave the others as they are")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    usual = [name for name in experiments.EXPERIMENTS if name not in experiments.SLOW]
    for name in usual if arguments.only is None else arguments.only:
        module = experiments.EXPERIMENTS[name]
        for ending in ("", experiments.PAPER) if name not in experiments.SLOW else ("",):
            start, settings = time.perf_counter(), module.Settings()
            if ending:
                settings = replace(settings, weights=settings.weights + ending)
            experiments.save(name + ending, module.run(settings, workers=arguments.workers, progress=True))
            artifacts.write_checksums()
            print(f"{name}{ending}: {time.perf_counter() - start:.0f} s")
    publish()


if __name__ == "__main__":
    main()
