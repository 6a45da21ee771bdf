"""`make reproduce`: everything from nothing: recordings → autoencoders → DPMPBs →
experiments → tables.

Results lie in build/reproduce/data, laid out like `data/`. Each is kept as soon as it
is there, so that the same command goes on where it was interrupted; when the code has
changed, everything is made anew. More in docs/scaling.md.

`make data`, `make train` and `make results` (`--record`, `--train`, `--results`) do one
of these in `data/` itself, and replace what is there. Names after an option choose;
experiments that take hours run only when they are named.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import joblib

import studies
from clothlab import data
from clothlab.method.autoencoder import AutoencoderTraining
from studies import PAPER, report
from studies._parallel import Job, run_jobs
from studies.datasets import (
    DATASETS,
    TARGET_SETS,
    Dataset,
    find_target_set,
    find_targets,
    record,
    record_targets,
)
from studies.training_configs import TRAINING_CONFIGS, TrainingConfig

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path("build") / "reproduce"


@dataclass(frozen=True)
class Plan:
    """How much of everything is made."""

    seeds: int = (
        5  # trainings of each DPMPB: the paper repeats learning and control five times
    )
    paper_only: bool = False  # only what the paper's amount of recordings teaches
    small: bool = (
        False  # tiny sizes, in which everything takes part and nothing is learned
    )

    @property
    def endings(self) -> tuple[str, ...]:
        """Amounts of recordings, by the endings of names."""
        return (PAPER,) if self.paper_only else ("", PAPER)

    def configs(self) -> list[TrainingConfig]:
        """What is trained."""
        configs = [
            TRAINING_CONFIGS[arm + ending]
            for arm in ("torque", "muscle")
            for ending in self.endings
        ]
        if not self.small:
            return configs
        once = AutoencoderTraining(epochs=1)
        return [
            replace(
                c, autoencoder=once, model=replace(c.model, epochs=2, sequence_length=8)
            )
            for c in configs
        ]

    def datasets(self) -> list[Dataset]:
        """What is recorded."""
        names = [name for config in self.configs() for name in config.recordings]
        datasets = [
            DATASETS[name]
            for name in dict.fromkeys([*names, "evaluation", "muscle-evaluation"])
        ]
        if not self.small:
            return datasets
        return [
            replace(
                each, steps=24, repeats=min(each.repeats, 2), policies=("operator",)
            )
            for each in datasets
        ]

    def cases(self, name: str) -> list[dict[str, Any]]:
        """Those of an experiment, with the trainings that there are."""
        experiment = studies.get(name)
        sizes = dict(experiment.paper) if name.endswith(PAPER) else {}
        sizes |= {"model": range(self.seeds)} if "model" in experiment.keys else {}
        if not self.small:
            return experiment.cases(**sizes)
        sizes |= {"steps": 16} if "steps" in experiment.keys else {}
        return experiment.cases(**sizes)[:2]


def train(
    configs: Sequence[TrainingConfig], seeds: Iterable[int], **options: Any
) -> None:
    """Train the autoencoder and the DPMPBs of each configuration, and save them;
    options as `run_jobs` has them.
    """
    jobs = [
        Job(TrainingConfig.train_autoencoder, {"self": each}, each.inputs)
        for each in configs
    ]
    for config, (model, losses) in zip(
        configs, run_jobs("autoencoders", jobs, **options), strict=True
    ):
        data.save_autoencoder(model, losses, config.name, overwrite=True)
    data.write_checksums()
    jobs = [
        Job(
            TrainingConfig.train_model,
            {"self": c, "seed": seed},
            (*c.inputs, f"weights/autoencoder-{c.name}."),
        )
        for c, seed in product(configs, seeds)
    ]
    for trained in run_jobs("models", jobs, **options):
        data.save(trained, overwrite=True)
    data.write_checksums()


def reproduce(plan: Plan, **options: Any) -> None:
    """Make everything, in the data folder that `CLOTHLAB_DATA` names; options as
    `run_jobs` has them.
    """
    for dataset in plan.datasets():
        record(dataset, **options)
    short = {"steps": 40, "seeds": (3000,), "foams": ("soft-1",)}
    record_targets([Job(find_targets, short if plan.small else {})], **options)
    data.write_checksums()
    train(plan.configs(), range(plan.seeds), **options)
    for experiment, ending in product(studies.EXPERIMENTS.values(), plan.endings):
        if not experiment.slow and (experiment.paper or not ending):
            name = experiment.name + ending
            studies.save(studies.get(name).run(plan.cases(name), **options), name)
    data.write_checksums()
    if not plan.small:  # a few cases give no results
        (data.data_folder().parent / "results.md").write_text(results())


def results() -> str:
    """The results as `docs/results.md` has them, from the tables in the data folder."""
    asked, papers = (report.questions(report.stored(ending)) for ending in ("", PAPER))
    return report.in_docs(
        asked or papers, {row.key: row for rows in papers.values() for row in rows}
    )


@contextmanager
def workers_of(address: str | None, data: Path) -> Iterator[None]:
    """Inside, workers of a Dask scheduler do all jobs, also those that join later; else
    processes of this machine.
    """
    if address is None:
        yield
        return
    try:
        from distributed import Client

        client = Client(address, timeout=60)
        client.wait_for_workers(1, timeout=60)
    except (ImportError, OSError) as error:
        sys.exit(
            f"{error}: --scheduler needs clothlab[cluster] installed, `dask scheduler` and `dask worker ADDRESS`"
        )
    with (
        client,
        joblib.parallel_config("dask", client=client, wait_for_workers_timeout=60),
    ):
        client.register_worker_callbacks(partial(_use, str(data)))
        yield


def _use(data: str) -> None:
    os.environ["CLOTHLAB_DATA"] = data


def record_again(names: Sequence[str], **options: Any) -> None:
    """Record these sets of trials, or all trials and targets, into `data/`; what was
    there is replaced.
    """
    files = [
        file for name in names or DATASETS for file in record(DATASETS[name], **options)
    ]
    if not names:
        jobs = [
            Job(find_targets, {}),
            *(Job(find_target_set, {"targets": each}) for each in TARGET_SETS),
        ]
        files += record_targets(jobs, **options)
    say_what_repeats(files)
    data.write_checksums()


def say_what_repeats(files: list[str]) -> None:
    """Say how many of these files of `data/` are the recorded ones bit for bit, before
    new hashes are written.

    The simulation is chaotic: another machine, or another version of MuJoCo or OpenGL,
    may give other bits.
    """
    verdict = data.check_data()
    same, known = (
        sum(verdict[file] in words for file in files)
        for words in (("ok",), ("ok", "altered"))
    )
    print(
        f"{same} of the {known} whose hash was recorded are the same bit for bit; new hashes are written now"
    )


def train_again(names: Sequence[str], **options: Any) -> None:
    """Train these weights, or all, from the recordings in `data/`."""
    train(
        [TRAINING_CONFIGS[name] for name in names or TRAINING_CONFIGS],
        range(Plan.seeds),
        **options,
    )


def run_again(names: Sequence[str], **options: Any) -> None:
    """Run these experiments, or all that do not take hours, and write the results into
    README and `docs/results.md`.
    """
    for name in names or [
        name for name, each in studies.EXPERIMENTS.items() if not each.slow
    ]:
        for ending in ("", PAPER) if studies.EXPERIMENTS[name].paper else ("",):
            table = studies.run(
                name + ending, **options, keep=ROOT / "build" / "experiments"
            )
            studies.save(table, name + ending)
            data.write_checksums()
    for row in report.publish(ROOT):
        print(
            f"{ {True: '✓', False: '✗', None: ' '}[row.met] } {row.label}: {row.here} (aim {row.aim})"
        )


STAGES = {"record": (record_again, DATASETS), "train": (train_again, TRAINING_CONFIGS)}
STAGES["results"] = (run_again, studies.EXPERIMENTS)


def main() -> int:
    """Make what was asked for; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--folder",
        type=Path,
        help=f"of all results: {FOLDER}, or with --small {FOLDER}-small",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=Plan.seeds,
        help="trainings of each DPMPB, by default 5",
    )
    parser.add_argument(
        "--small",
        action="store_true",
        help="tiny sizes, a minute, to see whether it works here",
    )
    parser.add_argument(
        "--paper-only",
        action="store_true",
        help="only what the paper's amount of recordings teaches",
    )
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count(), help="processes in this machine"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, whose workers do the work",
    )
    for stage, (function, choices) in STAGES.items():
        parser.add_argument(
            f"--{stage}",
            nargs="*",
            choices=choices,
            metavar="NAME",
            help=function.__doc__,
        )
    arguments = parser.parse_args()
    options = {"workers": arguments.workers, "progress": True}
    for stage, (function, _) in STAGES.items():
        if (names := getattr(arguments, stage)) is not None:
            function(names, **options)
            return 0
    folder = (
        arguments.folder or FOLDER.with_name(FOLDER.name + "-small" * arguments.small)
    ).absolute()
    data = folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    os.environ["CLOTHLAB_DATA"] = str(data)
    plan = Plan(arguments.seeds, arguments.paper_only, arguments.small)
    try:
        with workers_of(arguments.scheduler, data):
            reproduce(plan, keep=folder / "kept", **options)
    except KeyboardInterrupt:
        print(f"\ninterrupted: the same command goes on from what lies in {folder}")
        return 130
    print(f"everything lies in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
