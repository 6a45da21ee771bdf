"""`make data`: record all trials and find all targets, about nine minutes on two cores.

What is there already is recorded anew and replaced, trial by trial.
"""

import argparse
import os
import time

from clothlab import artifacts
from clothlab._parallel import Job
from clothlab.datasets import DATASETS, TARGET_SETS, find_target_set, find_targets, record, record_targets


def say_what_repeats(files: list[str]) -> None:
    """Say how many of these files of `data/` are the recorded ones bit for bit, before new hashes are written.

    The simulation is chaotic: another machine, or another version of MuJoCo or OpenGL, may give other bits.
    """
    verdict = artifacts.check_data()
    same, known = (sum(verdict[file] in words for file in files) for words in (("ok",), ("ok", "altered")))
    print(f"{same} of the {known} whose hash was recorded are the same bit for bit; new hashes are written now")


def main() -> None:
    """Record everything and write it to `data/`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--only", choices=["trials", "targets"], help="leave the other as it is")
    parser.add_argument("--sets", choices=DATASETS, nargs="+", default=list(DATASETS), help="of trials")
    arguments = parser.parse_args()
    start, options, files = time.perf_counter(), {"workers": arguments.workers, "progress": True}, []
    if arguments.only != "targets":
        for name in arguments.sets:
            files += record(DATASETS[name], **options)
    if arguments.only != "trials":
        jobs = [Job(find_targets, {}), *(Job(find_target_set, {"targets": each}) for each in TARGET_SETS)]
        files += record_targets(jobs, **options)
    print(f"{len(files)} trials and targets in {time.perf_counter() - start:.0f} s")
    say_what_repeats(files)
    artifacts.write_checksums()


if __name__ == "__main__":
    main()
