"""`make results`: run the experiments at full size from `data/`, with fresh simulation.

Writes their tables to `data/results/`, which notebooks and claims read, and the results into the README and
`docs/results.md`, from both amounts of recordings. What takes hours runs only when `--only` names it; otherwise its
stored table stays as it is. An interrupted run goes on where it stopped.
"""

import argparse
import os
import time
from pathlib import Path

from clothlab import artifacts, experiments
from clothlab.experiments import tables

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "experiments"


def main() -> None:
    """Run, store, publish."""
    usual = [name for name, each in experiments.EXPERIMENTS.items() if not each.slow]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=experiments.EXPERIMENTS, default=usual, help="leave the others")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    for name in arguments.only:
        for ending in ("", experiments.PAPER) if experiments.EXPERIMENTS[name].paper else ("",):
            start = time.perf_counter()
            table = experiments.run(name + ending, workers=arguments.workers, progress=True, keep=KEPT)
            experiments.save(table, name + ending)
            artifacts.write_checksums()
            print(f"{name}{ending}: {time.perf_counter() - start:.0f} s")
    for row in tables.publish(ROOT):
        print(f"{ {True: '✓', False: '✗', None: ' '}[row.met] } {row.label}: {row.here} (aim {row.aim})")


if __name__ == "__main__":
    main()
