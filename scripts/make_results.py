"""`make results`: run every experiment at full size from `data/`, with fresh simulation.

Writes the records to `data/results/`, which notebooks and claims read, and the tables into the README. About four
minutes on two cores.
"""

import argparse
import os
import time
from pathlib import Path

from clothlab import artifacts, experiments
from clothlab._files import write_bytes
from clothlab.experiments import tables

README = Path(__file__).resolve().parents[1] / "README.md"


def publish() -> None:
    """Make the tables from the stored records: print them, store them, put them into the README."""
    records = {name: experiments.load(name) for name in experiments.EXPERIMENTS}
    write_bytes(README, tables.in_readme(README.read_text(), records).encode())
    artifacts.save_results({"tables": tables.as_json(records)}, "table")
    artifacts.write_checksums()
    for make in tables.TABLES.values():
        for row in make(records):
            mark = {True: "✓", False: "✗", None: " "}[row.held]
            print(f"{mark} {row.what}: {row.here} (aim {row.aim}, paper {row.paper})")


def main() -> None:
    """Run, store, publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=experiments.EXPERIMENTS, help="leave the others as they are")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    for name in experiments.EXPERIMENTS if arguments.only is None else arguments.only:
        start = time.perf_counter()
        record = experiments.EXPERIMENTS[name].run(workers=arguments.workers, progress=True)
        experiments.save(name, record)
        artifacts.write_checksums()
        print(f"{name}: {time.perf_counter() - start:.0f} s")
    publish()


if __name__ == "__main__":
    main()
