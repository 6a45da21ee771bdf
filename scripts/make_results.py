"""`make results`: compute every figure of the results tables from `data/` with fresh simulation.

Prints the tables, writes `data/results/*.json`, which the notebooks read, and puts the tables into the README. About
six minutes on two cores.
"""

import argparse
import os
import time

import results_simulation
import results_stiffness
from reporting import publish

EXPERIMENTS = {"simulation": results_simulation, "stiffness": results_stiffness}


def main() -> None:
    """Compute, print, save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=EXPERIMENTS, help="leave the other as it is")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    for name in [arguments.only] if arguments.only else EXPERIMENTS:
        start = time.perf_counter()
        results = EXPERIMENTS[name].compute(arguments.workers)
        publish(results, EXPERIMENTS[name].table(results), name)
        print(f"{time.perf_counter() - start:.0f} s; data/results/{name}.json")


if __name__ == "__main__":
    main()
