"""`make data`: record all trials and find all targets, about nine minutes on two cores.

What is there already is recorded anew, trial by trial: an interruption loses none, and the next run begins again.
"""

import argparse
import os
import time

from clothlab import artifacts
from clothlab.datasets import RECORDINGS, find_targets, jobs, record_all


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
    parser.add_argument("--sets", choices=RECORDINGS, nargs="+", default=list(RECORDINGS), help="of trials")
    arguments = parser.parse_args()
    start, files = time.perf_counter(), []
    if arguments.only != "targets":
        todo = jobs(arguments.sets)
        record_all(todo, artifacts.data_folder() / "trials", arguments.workers)
        files += [f"trials/{path.as_posix()}" for path, *_ in todo]
    if arguments.only != "trials":
        targets = find_targets(arguments.workers)
        for name, mask in targets.items():
            artifacts.save_target(mask, name)
        files += [f"targets/{name}.png" for name in targets]
    print(f"{len(files)} trials and targets in {time.perf_counter() - start:.0f} s")
    say_what_repeats(files)
    artifacts.write_checksums()


if __name__ == "__main__":
    main()
