"""`make bench`: speed in one table of ratios, some minutes on two cores.

Both sides of a ratio are measured alternately in one run, since milliseconds vary from
run to run on a shared machine. `--only solve` runs one part. `--against CHECKOUT`
measures the package of another checkout, too, and puts its ratios beside these.
"""

import argparse
import contextlib
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import mujoco
import numpy as np
import pandas as pd
import torch
from browser_lab import Lab, Notebook, launch_options
from playwright.sync_api import sync_playwright

from clothlab import data
from clothlab._extras import bring
from clothlab.method.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.method.cloth_task import control_loss, period_mask
from clothlab.method.control import ControlSettings, Limits, optimise_commands
from clothlab.method.data import Run
from clothlab.method.fast_rollout import FastDPMPB
from clothlab.method.model import Memory, predict
from clothlab.method.onnx_export import export_solve
from clothlab.method.training import train_dpmpb
from clothlab.simulation.env import ClothEnv
from studies.datasets import DATASETS, record
from studies.training_configs import TRAINING_CONFIGS


class Row(NamedTuple):
    """One figure."""

    measured: str  # what, in words
    ratio: float
    aim: str
    time: str = ""  # the times behind it


def alternate(
    functions: dict[str, Callable[[], object]], repeats: int
) -> dict[str, float]:
    """Medians [s] of the times of functions that are called in turn."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in range(repeats):
        for name, function in functions.items():
            start = time.perf_counter()
            function()
            times[name].append(time.perf_counter() - start)
    return {name: float(np.median(values)) for name, values in times.items()}


def bench_step() -> Iterator[Row]:
    """`env.step` against the bare MuJoCo step and bare rendering of the same scene.

    Both under commands of the same kind.
    """
    env = ClothEnv()
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    renderer = env.renderer(96, 128)

    def command() -> np.ndarray:
        return rng.uniform(env.arm.command_lower, env.arm.command_upper)

    def bare() -> None:
        env.data.ctrl[:] = command()
        mujoco.mj_step(env.model, env.data, env.scene.substeps)
        # The picture is to show where the last step has led
        mujoco.mj_forward(env.model, env.data)
        renderer.update_scene(env.data, "camera")
        renderer.render()

    def ours() -> None:
        env.step(command())

    # In turn, each a thousand times
    times = alternate({"bare": bare, "ours": ours}, 1000)
    env.close()
    ratio = times["ours"] / times["bare"]
    shown = f"{1e3 * times['ours']:.2f} ms"
    yield Row("env.step / bare step and rendering", ratio, "≤ 1.05", shown)


def bench_recording() -> Iterator[Row]:
    """Recording on two cores against one: what the paper recorded, and evaluation."""
    todo = [dataset for dataset in DATASETS.values() if dataset.repeats == 1]
    cores = os.sched_getaffinity(0)
    seconds = {}
    for used in (1, 2):
        # Workers inherit it; drawing would otherwise take a second core
        os.sched_setaffinity(0, sorted(cores)[:used])
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            for dataset in todo:
                record(dataset, data=folder, workers=used)
            seconds[used] = time.perf_counter() - start

    # Later parts have all cores again
    os.sched_setaffinity(0, cores)
    shown = f"{seconds[1]:.0f} s / {seconds[2]:.0f} s"
    yield Row("recording, 1 core / 2 cores", seconds[1] / seconds[2], "≥ 1.7", shown)


def solves(name: str) -> dict[str, Callable[[], object]]:
    """One solve of the controller for an arm, by a loop over `nn.LSTM` and by ours."""
    # The arm's model and limits
    learned = data.load(f"{name}-0")
    model = learned.model
    settings = ControlSettings()
    lower = torch.as_tensor(learned.arm.command_lower, dtype=torch.float32)
    upper = torch.as_tensor(learned.arm.command_upper, dtype=torch.float32)

    # A state, a plan and a target as they may come
    torch.manual_seed(0)
    s = model.s_mean + model.s_std * torch.randn(model.state_size)
    u = lower + (upper - lower) * torch.rand(settings.horizon, model.command_size)
    memory = Memory(*0.3 * torch.randn(2, 2, 1, 30))
    z_ref = torch.randn(3)
    mask = torch.as_tensor(period_mask(3, settings))
    tensions = learned.layout.tensions

    def loss(states: torch.Tensor) -> torch.Tensor:
        weight = settings.tension_weight
        return control_loss(states, z_ref, mask, tensions, weight)

    # The same descent over two rollouts
    p = torch.as_tensor(next(iter(learned.biases.values())))
    fast = FastDPMPB(model, p)
    limits = Limits(lower, upper, model.u_std)

    def plain(plans: torch.Tensor) -> torch.Tensor:
        return loss(predict(model, s, plans, p, memory))

    def ours(plans: torch.Tensor) -> torch.Tensor:
        return loss(fast(s, plans, memory))

    return {
        "plain": lambda: optimise_commands(plain, u, limits, settings),
        "ours": lambda: optimise_commands(ours, u, limits, settings),
    }


def bench_solve() -> Iterator[Row]:
    """One solve of the controller on one core, for each arm."""
    torch.set_num_threads(1)
    for name in ("torque", "muscle"):
        times = alternate(solves(name), 100)
        what = f"one solve of the {name} arm, loop over nn.LSTM / ours"
        ratio = times["plain"] / times["ours"]
        yield Row(what, ratio, "≥ 2", f"{1e3 * times['ours']:.1f} ms")


def exported_solves(name: str, folder: str) -> dict[str, Callable[[], object]]:
    """One solve of the controller for an arm, by PyTorch and as a graph."""
    # The controller of a target, whose loss has target and mask as inputs
    learned = data.load(f"{name}-0")
    bias = next(iter(learned.biases))
    policy = learned.controller(data.load_target("target-1"), bias)
    controller = policy.controller
    settings = controller.settings

    def loss(
        states: torch.Tensor, plans: torch.Tensor, z_ref: torch.Tensor, mask: Any
    ) -> torch.Tensor:
        weight = settings.tension_weight
        return control_loss(states, z_ref, mask, policy.layout.tensions, weight)

    # The same state for both
    problem = controller.problem(learned.model.s_mean)
    mask = torch.as_tensor(period_mask(3, settings))
    wanted = {"z_ref": policy.loss.z_ref, "mask": mask}
    given = {"s": problem.s, "u": problem.plan, "p": torch.as_tensor(problem.p)}
    given |= problem.memory._asdict() | wanted

    # As a graph
    onnxruntime = bring("bench --only onnx", "onnxruntime", "onnx")
    path = Path(folder) / f"{name}.onnx"
    export_solve(path, controller, loss=loss, inputs=wanted)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options)
    arrays = {key: np.asarray(each) for key, each in given.items()}

    def ours(plans: torch.Tensor) -> torch.Tensor:
        return loss(problem.predict(plans), plans, **wanted)

    return {
        "torch": lambda: optimise_commands(
            ours, problem.plan, problem.limits, settings
        ),
        "onnx": lambda: session.run(None, arrays),
    }


def bench_onnx() -> Iterator[Row]:
    """One solve of the torque arm's controller on one core, as a graph."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        times = alternate(exported_solves("torque", folder), 100)
    ratio = times["onnx"] / times["torch"]
    shown = f"{1e3 * times['onnx']:.1f} ms / {1e3 * times['torch']:.1f} ms"
    yield Row(
        "one solve of the torque arm, onnxruntime / torch", ratio, "≤ 0.33", shown
    )


def bench_training() -> Iterator[Row]:
    """Trainings side by side, one on each core, against one after the other.

    `make train` runs them side by side.
    """
    # Made-up recordings, and short trainings of them
    cores = len(os.sched_getaffinity(0))
    images = np.random.default_rng(0).random((64 * 10, 96, 128)) > 0.9
    runs = [Run(np.zeros((2000, 7)), np.zeros((2000, 2)), "made up")] * 9
    model = replace(TRAINING_CONFIGS["torque"].model, epochs=2)
    eyes = AutoencoderTraining(epochs=3)
    jobs = {
        "autoencoder": joblib.delayed(train_autoencoder)(images, eyes, progress=False),
        "DPMPB": joblib.delayed(train_dpmpb)(runs, model, progress=False),
    }

    # One of them, and as many at once as there are cores
    with joblib.Parallel(n_jobs=cores, max_nbytes=None) as side_by_side:
        for name, job in jobs.items():
            one = partial(side_by_side, [job])
            several = partial(side_by_side, [job] * cores)
            times = alternate({"one": one, "all": several}, 3)
            what = f"{cores} trainings of the {name}, one after another / side by side"
            ratio = cores * times["one"] / times["all"]
            yield Row(what, ratio, "≥ 1.5", f"{times['one']:.1f} s each")


def bench_lab() -> Iterator[Row]:
    """The live lab in a browser, from "Run All Cells" to a robot that moves."""
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        lab = stack.enter_context(contextlib.closing(Lab(Path(folder))))
        lab.wait()
        chromium = stack.enter_context(sync_playwright()).chromium
        browser = chromium.launch(**launch_options())
        page = browser.new_page(viewport={"width": 1500, "height": 1100})
        seconds = Notebook(lab, page, "08_live_lab.ipynb").start_panel()
    yield Row("live lab, from run all to a moving robot [s]", seconds, "≤ 15")


BENCHES = {
    "step": bench_step,
    "recording": bench_recording,
    "solve": bench_solve,
    "onnx": bench_onnx,
    "training": bench_training,
    "lab": bench_lab,
}


def ratios_there(checkout: Path, names: Sequence[str]) -> pd.Series:
    """The ratios of the package in another checkout, by this very script."""
    command = [sys.executable, __file__, "--csv", "--only", *names]
    path = {"PYTHONPATH": str(checkout.resolve())}
    said = subprocess.check_output(command, env=os.environ | path, text=True)
    return pd.read_csv(io.StringIO(said))["ratio"]


def main() -> None:
    """Run all, or those named, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", choices=BENCHES, default=list(BENCHES), help="which parts"
    )
    parser.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="measure that package, too"
    )
    parser.add_argument("--csv", action="store_true", help="print CSV")
    arguments = parser.parse_args()

    # Ours, and beside them those of the other checkout
    rows = [row for name in arguments.only for row in BENCHES[name]()]
    table = pd.DataFrame(rows, columns=Row._fields).round(3)
    if arguments.against:
        table["there"] = ratios_there(arguments.against, arguments.only)
    print(table.to_csv(index=False) if arguments.csv else table.to_string(index=False))


if __name__ == "__main__":
    main()
