"""Make recordings, trainings and results anew, or everything from nothing.

Six commands; `make` calls five of them under names of its own:

    reproduce.py record [SET ...]           make data: trials and targets
    reproduce.py train [WEIGHTS ...]        make train: autoencoders and DPMPBs
    reproduce.py results [EXPERIMENT ...]   make results: every figure of the tables
    reproduce.py everything [OPTIONS]       make reproduce: all of these from nothing
    reproduce.py worlds [OPTIONS]           make worlds: so ten times, from other seeds
    reproduce.py costs                      how long each table of the results takes

The first three work in `data/` itself, and replace what is there. Names choose;
experiments that take hours run only when they are named. `everything` writes into
build/reproduce/data, laid out like `data/`: recordings → autoencoders → DPMPBs →
experiments → tables. Each is kept as soon as it is there, so that the same command goes
on where it was interrupted; when the code has changed, everything is made anew. More in
docs/scaling.md.
"""

import argparse
import contextlib
import inspect
import os
import subprocess
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import joblib
import pandas as pd

import studies
from clothlab import _store
from clothlab.data import _writing
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
_APART = 10_000_000  # seeds of one world from those of the next
FOLDER = Path("build") / "reproduce"


@dataclass(frozen=True)
class Plan:
    """How much of everything is made."""

    # Trainings of each DPMPB: the paper repeats learning and control five times
    seeds: int = 5
    paper_only: bool = False  # only what the paper's amount of recordings teaches
    # Tiny sizes, in which everything takes part and nothing is learned
    small: bool = False
    # Other recordings, autoencoders, W and p, all from seeds of their own; targets are
    # part of the task, and stay. World 0 is the one in `data/`.
    world: int = 0

    @property
    def offset(self) -> int:
        """How far the seeds of this world are from those of world 0."""
        return self.world * _APART

    @property
    def endings(self) -> tuple[str, ...]:
        """Amounts of recordings, by the endings of names."""
        return (PAPER,) if self.paper_only else ("", PAPER)

    def configs(self) -> list[TrainingConfig]:
        """What is trained."""
        names = [arm + end for arm in ("torque", "muscle") for end in self.endings]
        configs = [
            replace(TRAINING_CONFIGS[name], first_seed=self.offset) for name in names
        ]
        return [_shortened(each) for each in configs] if self.small else configs

    def datasets(self) -> list[Dataset]:
        """What is recorded."""
        names = [name for config in self.configs() for name in config.recordings]
        names += ["evaluation", "muscle-evaluation"]
        datasets = []
        for name in dict.fromkeys(names):
            dataset = DATASETS[name]
            first = dataset.first_seed + self.offset
            datasets.append(replace(dataset, first_seed=first))
        if not self.small:
            return datasets
        short: dict[str, Any] = {"steps": 24, "policies": ("operator",)}
        return [replace(d, repeats=min(d.repeats, 2), **short) for d in datasets]

    def cases(self, name: str) -> list[dict[str, Any]]:
        """Those of an experiment, with the trainings that there are."""
        experiment = studies.get(name)
        sizes = dict(experiment.paper) if name.endswith(PAPER) else {}
        sizes |= {"model": range(self.seeds)} if "model" in experiment.keys else {}
        if self.seeds == 1 and "repeat" in experiment.keys:
            sizes["repeat"] = 0  # what repeats a world is another one
        if not self.small:
            return experiment.cases(**sizes)
        sizes |= {"steps": 16} if "steps" in experiment.keys else {}
        return experiment.cases(**sizes)[:2]


def _shortened(config: TrainingConfig) -> TrainingConfig:
    """The same training, of a minute, in which nothing is learned."""
    return replace(
        config,
        autoencoder=AutoencoderTraining(epochs=1),
        model=replace(config.model, epochs=2, sequence_length=8),
    )


def train(
    configs: Sequence[TrainingConfig], seeds: Iterable[int], **options: Any
) -> None:
    """Train the autoencoder and the DPMPBs of each configuration, and save them.

    Options are those of `run_jobs`.
    """
    # Autoencoders first: DPMPBs learn from what they see
    jobs = [
        Job(TrainingConfig.train_autoencoder, {"self": config}, config.inputs)
        for config in configs
    ]
    done = run_jobs("autoencoders", jobs, **options)
    for config, (model, losses) in zip(configs, done, strict=True):
        _writing.save_autoencoder(model, losses, config.name)
    _store.write_checksums()

    # And several DPMPBs on top of each
    jobs = []
    for config, seed in product(configs, seeds):
        inputs = (*config.inputs, f"weights/autoencoder-{config.name}.")
        arguments = {"self": config, "seed": seed}
        jobs.append(Job(TrainingConfig.train_model, arguments, inputs))
    for trained in run_jobs("models", jobs, **options):
        _writing.save(trained)
    _store.write_checksums()


def reproduce(plan: Plan, **options: Any) -> None:
    """Make everything, in the data folder that `CLOTHLAB_DATA` names.

    Options are those of `run_jobs`.
    """
    # Recordings and targets
    for dataset in plan.datasets():
        record(dataset, **options)
    short = {"steps": 40, "seeds": (3000,), "foams": ("soft-1",)}
    record_targets([Job(find_targets, short if plan.small else {})], **options)
    _store.write_checksums()

    # What learns from them, and is put to the test
    train(plan.configs(), range(plan.seeds), **options)
    for experiment, ending in product(studies.EXPERIMENTS.values(), plan.endings):
        if not experiment.slow and (experiment.paper or not ending):
            name = experiment.name + ending
            table = studies.get(name).run(plan.cases(name), **options)
            studies.save(table, name)
    _store.write_checksums()

    # The page; a few cases give no results
    if not plan.small:
        (_store.data_folder().parent / "results.md").write_text(results())


def results() -> str:
    """The results as `docs/results.md` has them, from the tables in the data folder."""
    asked = report.questions(report.stored())
    papers = report.questions(report.stored(PAPER))
    return report.page(report.verdicts(), asked or papers, report.by_key(papers))


@contextlib.contextmanager
def workers_of(address: str | None, data: Path) -> Iterator[None]:
    """Inside, the workers of a Dask scheduler do all jobs, also those that join later.

    Without an address, processes of this machine do them.
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
            f"{error}: --scheduler needs clothlab[cluster] installed, "
            "`dask scheduler` and `dask worker ADDRESS`"
        )
    dask = joblib.parallel_config("dask", client=client, wait_for_workers_timeout=60)
    with client, dask:
        client.register_worker_callbacks(partial(_use, str(data)))
        yield


def _use(data: str) -> None:
    os.environ["CLOTHLAB_DATA"] = data


def record_again(names: Sequence[str], **options: Any) -> None:
    """Record these sets of trials, or all trials and targets, into `data/`.

    What was there is replaced.
    """
    files = []
    for name in names or DATASETS:
        files += record(DATASETS[name], **options)
    if not names:
        jobs = [Job(find_targets, {})]
        jobs += [Job(find_target_set, {"targets": each}) for each in TARGET_SETS]
        files += record_targets(jobs, **options)
    say_what_repeats(files)
    _store.write_checksums()


def say_what_repeats(files: list[str]) -> None:
    """Say how many files of `data/` are the recorded ones bit for bit.

    That is before new hashes are written. The simulation is chaotic: another machine,
    or another version of MuJoCo or OpenGL, may give other bits.
    """
    verdict = _store.check_data()
    same = sum(verdict[file] == "ok" for file in files)
    altered = sum(verdict[file] == "altered" for file in files)
    print(
        f"{same} of the {same + altered} whose hash was recorded are the same "
        "bit for bit; new hashes are written now"
    )


def train_again(names: Sequence[str], **options: Any) -> None:
    """Train these weights, or all, from the recordings in `data/`."""
    configs = [TRAINING_CONFIGS[name] for name in names or TRAINING_CONFIGS]
    train(configs, range(Plan.seeds), **options)


def run_again(names: Sequence[str], **options: Any) -> None:
    """Run these experiments, or all that do not take hours, and write their results.

    They go into `data/results`, README and `docs/results.md`. With the paper's amount
    of recordings, most experiments are run in worlds alone; those that are not have a
    table of that amount, which is made anew, too.
    """
    usual = [name for name, each in studies.EXPERIMENTS.items() if not each.slow]
    hours = sum(studies.EXPERIMENTS[name].cost for name in names or usual) / 3600
    print(f"about {hours:.1f} hours of one core, on {options['workers']} of them")
    stored = report.stored(PAPER)
    keep = ROOT / "build" / "experiments"
    for name in names or usual:
        for ending in ("", PAPER) if name in stored else ("",):
            table = studies.run(name + ending, **options, keep=keep)
            studies.save(table, name + ending)
            _store.write_checksums()
    marks = {True: "✓", False: "✗", None: " "}
    for row in report.publish(ROOT):
        print(f"{marks[row.met]} {row.label}: {row.figure} (aim {row.aim})")


def costs(arguments: argparse.Namespace) -> int:
    """What each table of results costs: cases, seconds each, minutes on one core.

    Those with a star run only if they are named. Returned is the exit status.
    """
    total = 0.0
    for name, each in studies.EXPERIMENTS.items():
        star = "*" if each.slow else " "
        count = len(each.cases())
        print(f"{name:26}{star}{count:6}{each.seconds:6g} s {each.cost / 60:6.0f} min")
        total += each.cost
    print(f"all: {total / 3600:.1f} hours on one core")
    return 0


def from_nothing(arguments: argparse.Namespace) -> int:
    """Everything from nothing, in a folder of its own.

    Returned is the exit status.
    """
    name = f"{FOLDER.name}-small" if arguments.small else FOLDER.name
    folder = (arguments.folder or FOLDER.with_name(name)).absolute()
    data = folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    os.environ["CLOTHLAB_DATA"] = str(data)
    plan = Plan(arguments.seeds, arguments.paper_only, arguments.small, arguments.world)
    options = {"workers": arguments.workers, "progress": True, "keep": folder / "kept"}
    try:
        with workers_of(arguments.scheduler, data):
            reproduce(plan, **options)
    except KeyboardInterrupt:
        print(f"\ninterrupted: the same command goes on from what lies in {folder}")
        return 130
    print(f"everything lies in {folder}")
    return 0


def worlds(arguments: argparse.Namespace) -> int:
    """Several worlds from nothing, and their tables side by side.

    In each, recordings, autoencoders and DPMPBs are made from seeds of its own; world 0
    is the one in `data/`, on which all choices were made, and not among them. A table
    of all, with a column `world`, goes into `data/results`; what it has of other worlds
    stays. Returned is the exit status.
    """
    home = _store.data_folder()
    kind = "worlds-small" if arguments.small else "worlds"
    numbers = range(arguments.first, arguments.first + arguments.count)
    folders = {k: ROOT / "build" / kind / str(k) for k in numbers}
    for k, folder in folders.items():
        words = ["everything", "--world", str(k), "--seeds", "1"]
        words += ["--folder", str(folder), "--workers", str(arguments.workers)]
        words += ["--small"] * arguments.small + ["--paper-only"] * arguments.paper_only
        status = subprocess.run([sys.executable, __file__, *words]).returncode
        if status:
            return status
    if not arguments.small:
        worlds = {k: folder / "data" for k, folder in folders.items()}
        save_side_by_side(worlds, home)
    return 0


def save_side_by_side(worlds: Mapping[int, Path], home: Path) -> None:
    """Save each table that the data folders of all these worlds have as one.

    It is called `worlds-NAME`, and keeps the rows that it has of other worlds.
    """
    folders = [data / "results" for data in worlds.values()]
    named = [{path.stem for path in folder.glob("*.csv")} for folder in folders]
    for name in sorted(set.intersection(*named)):
        parts = {k: studies.load(name, data=data) for k, data in worlds.items()}
        for k, part in parts.items():
            part.insert(0, "world", k)

        # Those made before
        with contextlib.suppress(KeyError):
            stored = studies.load(f"worlds-{name}", data=home)
            others = stored[~stored["world"].isin(worlds)]
            parts |= dict([*others.groupby("world")])

        in_order = [parts[k] for k in sorted(parts)]
        table = pd.concat(in_order, ignore_index=True)
        studies.save(table, f"worlds-{name}", data=home)
    _store.write_checksums(home)


def _again(function: Callable[..., None], arguments: argparse.Namespace) -> int:
    """One of the first three commands; returns the exit status."""
    function(arguments.names, workers=arguments.workers, progress=True)
    return 0


def command_line() -> argparse.ArgumentParser:
    """A parser with a command for each of the four programs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _again_command(commands, "record", record_again, DATASETS)
    _again_command(commands, "train", train_again, TRAINING_CONFIGS)
    _again_command(commands, "results", run_again, studies.EXPERIMENTS)

    _everything_command(commands)
    _command(commands, "costs", costs).set_defaults(run=costs)

    # Several of these
    several = _command(commands, "worlds", worlds)
    several.set_defaults(run=worlds)
    several.add_argument("--count", type=int, default=10, help="by default 10")
    several.add_argument("--first", type=int, default=1, help="number of the first")
    _sizes(several)
    return parser


def _everything_command(commands: Any) -> None:
    """All of them, with sizes and a folder of its own."""
    everything = _command(commands, "everything", from_nothing)
    everything.set_defaults(run=from_nothing)

    # Where, and how much
    everything.add_argument(
        "--folder",
        type=Path,
        help=f"of all results: {FOLDER}, or with --small {FOLDER}-small",
    )
    everything.add_argument(
        "--seeds",
        type=int,
        default=Plan.seeds,
        help=f"trainings of each DPMPB, by default {Plan.seeds}",
    )
    everything.add_argument(
        "--world",
        type=int,
        default=0,
        help="another one has recordings and trainings from other seeds",
    )
    _sizes(everything)

    # And by whom
    everything.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, whose workers do the work",
    )


def _sizes(command: argparse.ArgumentParser) -> None:
    """Options that make less of everything."""
    command.add_argument(
        "--small",
        action="store_true",
        help="tiny sizes, a minute, to see whether it works here",
    )
    command.add_argument(
        "--paper-only",
        action="store_true",
        help="only what the paper's amount of recordings teaches",
    )


def _again_command(
    commands: Any, name: str, function: Callable[..., None], choices: Collection[str]
) -> None:
    """A command that works in `data/` itself, and takes names."""
    command = _command(commands, name, function)
    command.set_defaults(run=partial(_again, function))
    listed = ", ".join(choices)

    def known(word: str) -> str:
        # Not argparse's `choices`, which refuse that nothing is named
        if word not in choices:
            raise argparse.ArgumentTypeError(f"unknown {word!r}; choose from {listed}")
        return word

    command.add_argument(
        "names", nargs="*", type=known, metavar="NAME", help=f"by default all: {listed}"
    )


def _command(
    commands: Any, name: str, function: Callable[..., Any]
) -> argparse.ArgumentParser:
    """A command that says of itself what its function's docstring says."""
    about = inspect.getdoc(function) or ""
    summary, _, _ = about.partition("\n")
    command = commands.add_parser(name, help=summary, description=about)
    command.add_argument(
        "--workers", type=int, default=os.cpu_count(), help="processes in this machine"
    )
    return command


def main() -> int:
    """Make what was asked for; returns the exit status."""
    arguments = command_line().parse_args()
    return arguments.run(arguments)


if __name__ == "__main__":
    sys.exit(main())
