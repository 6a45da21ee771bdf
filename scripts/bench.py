"""`make bench`: speed, about 15 minutes on two cores, of which the live lab takes 12 in a browser.

Ratios are measured in one run against a stated reference. `python scripts/bench.py solve` runs one of them.

The machine may be shared, so that milliseconds vary from run to run; both sides of a ratio are measured alternately.
"""

import argparse
import contextlib
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import joblib
import mujoco
import numpy as np
import psutil
import torch
from browser_lab import Lab, Notebook, answers, frame, launch_options
from playwright.sync_api import sync_playwright
from threadpoolctl import threadpool_limits
from torch.utils.flop_counter import FlopCounterMode
from tqdm.auto import tqdm, trange

from clothlab import artifacts
from clothlab.datasets import DATASETS, record
from clothlab.learning.autoencoder import Autoencoder, AutoencoderTraining, train_autoencoder
from clothlab.learning.control import ControlSettings, control_loss, optimise_commands, period_mask
from clothlab.learning.dpmpb import DPMPB, Memory, Sequences, predict, stretches, train_dpmpb
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.policies import Timed
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import CONTROL_PERIOD, ClothEnv, build_spec
from clothlab.table_scene.table_env import TableEnv
from clothlab.training_configs import TRAINING_CONFIGS

COMPARED = {name: get_arm(name) for name in ("torque", "muscle")}


def alternate(functions: dict[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """Time functions in turn, `{name: seconds [repeats]}`."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in tqdm(range(repeats), leave=False):
        for name, function in functions.items():
            start = time.perf_counter()
            function()
            times[name].append(time.perf_counter() - start)
    return {name: np.array(values) for name, values in times.items()}


def bench_step() -> None:
    """`env.step` against the bare MuJoCo step and bare rendering of the same scene, under commands of the same kind."""
    env = ClothEnv()
    env.reset(seed=0)
    env.step(env.arm.home_command)
    rng = np.random.default_rng(0)
    renderer = env.renderer(96, 128)

    def command() -> np.ndarray:
        return rng.uniform(env.arm.command_lower, env.arm.command_upper)

    def bare() -> None:
        env.data.ctrl[:] = command()
        mujoco.mj_step(env.model, env.data, env.scene.substeps)
        mujoco.mj_forward(env.model, env.data)  # the picture is to show where the last step has led
        renderer.update_scene(env.data, "camera")
        renderer.render()

    def full() -> None:
        env.step(command())

    times = alternate({"bare": bare, "env.step": full}, 1000)
    env.close()
    bare_ms, full_ms = (1e3 * np.median(times[name]) for name in ("bare", "env.step"))
    ratio = full_ms / bare_ms
    print(f"env.step / bare MuJoCo step and rendering: {ratio:.2f}  ({full_ms:.2f} / {bare_ms:.2f} ms; ≤ 1.05)")


def bench_collection() -> None:
    """Recording what the paper recorded, and trials to evaluate, on two cores against one."""
    todo = [dataset for dataset in DATASETS.values() if dataset.repeats == 1]
    cores = sorted(os.sched_getaffinity(0))[:2]
    seconds = {}
    for used in (cores[:1], cores):
        os.sched_setaffinity(0, used)  # workers inherit it; drawing would otherwise take a second core
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            files = [file for dataset in todo for file in record(dataset, data=folder, workers=len(used))]
            seconds[len(used)] = time.perf_counter() - start
    print(
        f"recording {len(files)} trials, 1 core / 2 cores: {seconds[1] / seconds[2]:.2f}"
        f"  ({seconds[1]:.0f} / {seconds[2]:.0f} s; ≥ 1.7)"
    )


def bench_arms() -> None:
    """Physics of the muscle arm against the torque arm's, both with a cloth in the hand."""
    models = {name: build_spec(arm, get_cloth("damp0.05-mass0.10")).compile() for name, arm in COMPARED.items()}
    data = {name: mujoco.MjData(model) for name, model in models.items()}
    for name, arm in COMPARED.items():
        arm.reset(data[name], arm.home_command)
    steps = 500
    times = alternate(
        {name: lambda name=name: mujoco.mj_step(models[name], data[name], steps) for name in COMPARED}, 20
    )
    rate = {name: steps / np.median(times[name]) for name in COMPARED}
    ratio = rate["muscle"] / rate["torque"]
    print(
        f"physics, muscle arm / torque arm: {ratio:.2f}  ({rate['muscle']:,.0f} / {rate['torque']:,.0f} steps a second)"
    )


def bench_table() -> None:
    """Physics of the table's scene against the muscle arm's, a control period with the same cloth in the hand."""
    scenes = {"muscle": ClothEnv("muscle", "hard-1"), "table": TableEnv("muscle", "hard-1", start_in="hand")}
    arm, rng = scenes["muscle"].arm, np.random.default_rng(0)
    commands = rng.uniform(arm.command_lower, arm.command_upper, (25, len(arm.command_names)))

    def swing(env: ClothEnv) -> None:
        env.start(seed=0)
        for u in commands:
            env.advance(u)

    times = alternate({name: partial(swing, env) for name, env in scenes.items()}, 20)
    table, muscle = (1e3 * np.median(times[name]) / len(commands) for name in ("table", "muscle"))
    print(f"control period, table / muscle arm: {table / muscle:.2f}  ({table:.2f} / {muscle:.2f} ms)")


def bench_solve() -> None:
    """One solve of the controller against the straightforward loop over `nn.LSTM`, on one core."""
    torch.set_num_threads(1)
    for name, arm in COMPARED.items():
        bench_solve_of(name, arm)


def bench_solve_of(name: str, arm: Arm) -> None:
    """The same, for one arm's numbers of commands and states."""
    learned, settings = artifacts.load(f"{name}-0"), ControlSettings()
    model, tension = learned.model, learned.layout.tensions
    generator = torch.Generator().manual_seed(0)
    p = torch.as_tensor(next(iter(learned.biases.values())))
    frozen = FastDPMPB(model, p)
    lower, upper = (torch.as_tensor(end, dtype=torch.float32) for end in (arm.command_lower, arm.command_upper))
    mask = torch.as_tensor(period_mask(3, settings))
    problems = []
    for _ in range(20):
        s = model.s_mean + model.s_std * torch.randn(model.state_size, generator=generator)
        u = lower + (upper - lower) * torch.rand(settings.horizon, model.command_size, generator=generator)
        memory = Memory(*(0.3 * torch.randn(2, 1, 30, generator=generator) for _ in range(2)))
        problems.append((s, u, memory, torch.randn(3, generator=generator)))

    def solve(function, k: int) -> torch.Tensor:
        s, u, memory, z_ref = problems[k % len(problems)]
        return optimise_commands(
            lambda candidates: function(s, candidates, memory),
            lambda states: control_loss(states, z_ref, mask, tension, settings.tension_weight),
            u,
            lower,
            upper,
            model.u_std,
            settings,
        )[0]

    def plain(s, u, memory):
        return predict(model, s, u, p, memory)

    gaps = [(solve(frozen, k) - solve(plain, k)).abs() / (upper - lower) for k in range(len(problems))]
    difference = max(gap.max().item() for gap in gaps)  # of the command's range, since commands have different units
    count = iter(range(10**6))
    times = alternate({"plain": lambda: solve(plain, next(count)), "frozen": lambda: solve(frozen, next(count))}, 200)
    ratio = np.median(times["plain"]) / np.median(times["frozen"])
    median, late = 1e3 * np.percentile(times["frozen"], [50, 99])
    sizes = f"{model.command_size} commands, {model.state_size} states"
    print(f"one solve ({sizes}), loop over nn.LSTM / ours: {ratio:.2f}  (≥ 2)")
    print(f"    largest difference {difference:.1e} of the command's range (≤ 1e-5)")
    print(
        f"    ours: median {median:.1f} ms (≤ 10), 99th percentile {late:.1f} ms (≤ 20),"
        f" of the {CONTROL_PERIOD * 1e3:.0f} ms period"
    )


def bench_loop() -> None:
    """Physics, camera and solve together, on one core with one model, against the time that a robot would take."""
    torch.set_num_threads(1)
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:1])  # drawing would otherwise take a second core
    for name, target in {"torque": "target-1", "muscle": "muscle"}.items():
        learned, mask = artifacts.load(f"{name}-0"), artifacts.load_target(target)
        cloth, p = next(iter(learned.biases.items()))
        runs = [learned.sequences(trial) for trial in TRAINING_CONFIGS[f"{name}-paper"].load_trials()]
        policies = {
            "control": Timed(learned.controller(mask, p)),
            "practice": Timed(learned.iterative_controller(mask, p, runs)),
        }
        for who, policy in policies.items():
            with contextlib.closing(ClothEnv(learned.arm, cloth)) as env:
                env.reset()

                def step(env=env, policy=policy) -> None:
                    env.advance(policy(env.observe()))

                seconds = alternate({who: step}, 200)[who].mean()
            solves = 1e3 * np.array(policy.seconds)[:: 1 if who == "control" else ControlSettings.period]
            print(
                f"closed loop on one core, {name} arm, {who}, real time / ours: {CONTROL_PERIOD / seconds:.1f}"
                f"  ({1e3 * seconds:.1f} ms a step; one solve: median {np.median(solves):.1f} ms)"
            )
    os.sched_setaffinity(0, cores)


def alone(function: Callable[..., object], arguments: tuple) -> object:
    """Call a function on one core, as `make train` does side by side."""
    with threadpool_limits(1):
        torch.set_num_threads(1)
        return function(*arguments)


def multiply(size: int, times: int) -> None:
    """Multiply large matrices."""
    a, b = torch.randn(2, size, size)
    for _ in range(times):
        a @ b


def operations(step: Callable[[], torch.Tensor]) -> int:
    """Floating-point operations of a training step, as PyTorch counts them."""
    with FlopCounterMode(display=False) as counter:
        step().backward()
    return int(counter.get_total_flops())


def bench_training() -> None:
    """GFLOP/s of trainings side by side, one on each core, as `make train` runs them, beside large matrix products."""
    cores = len(os.sched_getaffinity(0))
    images, eyes = np.random.default_rng(0).random((64 * 10, 96, 128)) > 0.9, AutoencoderTraining(epochs=10)
    runs, model = (
        [Sequences(np.zeros((2000, 7)), np.zeros((2000, 2)), "made up")] * 9,
        replace(TRAINING_CONFIGS["torque"].model, epochs=10),
    )
    windows = len(stretches(runs, model.sequence_length, model.stride)[0])
    jobs = {
        "product": joblib.delayed(alone)(multiply, (2000, 20)),
        "autoencoder": joblib.delayed(alone)(partial(train_autoencoder, progress=False), (images, eyes)),
        "DPMPB": joblib.delayed(alone)(partial(train_dpmpb, progress=False), (runs, model)),
    }
    with joblib.Parallel(n_jobs=cores, max_nbytes=None) as side_by_side:
        times = alternate({name: partial(side_by_side, [job] * cores) for name, job in jobs.items()}, 5)
    network, size = DPMPB(7, 2), model.batch_size
    s, u, p = torch.zeros(size, 30, 7), torch.zeros(size, 30, 2), torch.zeros(size, 2)
    # The counter does not see inside nn.LSTM: 2 layers, 4 gates, 30 units from 60 inputs; backward is twice forward.
    in_lstm = 3 * 2 * (2 * 4 * 30 * 60) * size * 30
    flops = {
        "product": cores * 20 * 2 * 2000**3,
        "autoencoder": cores * operations(lambda: Autoencoder()(torch.rand(64, 1, 96, 128)).mean()) * 10 * eyes.epochs,
        "DPMPB": cores * (operations(lambda: network(s, u, p)[0].mean()) + in_lstm) * windows / size * model.epochs,
    }
    rates = {name: flops[name] / float(np.median(times[name])) / 1e9 for name in flops}
    print(f"matrix products 2000³, one on each of {cores} cores: {rates['product']:.0f} GFLOP/s")
    for name, bound in (("autoencoder", 0.5), ("DPMPB", 0.45)):
        share = f"{rates[name] / rates['product']:.2f}  ({rates[name]:.0f} GFLOP/s; ≥ {bound})"
        print(f"    {cores} trainings of the {name} side by side, by the products: {share}")


PANEL_MINUTES, PRESSES = 10, 20  # how long its memory is watched; how often each control is pressed


def bench_panel() -> None:
    """The live lab in a real browser: does it keep the paper's 5 Hz, how soon does it answer, does it grow?"""
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.closing(Lab(Path(folder))) as lab,
        sync_playwright() as playwright,
    ):
        lab.wait()
        page = playwright.chromium.launch(**launch_options()).new_page(viewport={"width": 1500, "height": 1100})
        notebook = Notebook(lab, page, "14_live_lab.ipynb")
        print(f"live lab, from run all to a moving robot: {notebook.start_panel():.1f} s  (≤ 15)")
        page.get_by_role("button", name="estimate p online").click()
        notebook.until("panel.session.estimating and panel.session.driver == 'control'")
        bench_panel_pace(notebook)
        bench_panel_answers(notebook)


def bench_panel_pace(notebook: Notebook) -> None:
    """Steps, late steps and pictures in a minute, and the kernel's memory over `PANEL_MINUTES`."""

    def counts() -> np.ndarray:
        steps, late = eval(notebook.evaluate("panel.steps, panel.late"))
        return np.array([time.monotonic(), steps, late, frame(notebook.page)])

    kernel = psutil.Process(int(notebook.evaluate("__import__('os').getpid()")))
    before = counts()
    notebook.page.wait_for_timeout(60_000)
    seconds, steps, late, shown = counts() - before
    print(
        f"    60 s with control and estimation: {steps / seconds:.2f} steps a second (≥ 4.9), {late / steps:.1%} late"
        f" (≤ 1 %), {shown / seconds:.2f} pictures a second (≥ 4)"
    )
    size = kernel.memory_info().rss  # after a minute, since the more estimation looks back on, the more memory it takes
    for _ in trange(PANEL_MINUTES, unit="minute", leave=False):
        notebook.page.wait_for_timeout(60_000)
    growth = (kernel.memory_info().rss - size) / 2**20
    print(f"    the kernel grew by {growth:.1f} MiB in {PANEL_MINUTES} minutes  (< 20 in 10), from {size / 2**20:.0f}")


def bench_panel_answers(notebook: Notebook) -> None:
    """From pressing a key or clicking to the frame that shows the effect, drawn by the browser."""
    waits = answers(notebook, PRESSES)
    median, late = np.percentile([seconds for seconds, _ in waits.reshape(-1, 2)], [50, 95]) / CONTROL_PERIOD
    print(
        f"    from a control to its effect: median {median:.1f}, 95th percentile {late:.1f} control periods (≤ 2)"
        f"; {PRESSES} times each of {len(waits)} controls"
    )


BENCHES = {
    "step": bench_step,
    "arms": bench_arms,
    "table": bench_table,
    "collection": bench_collection,
    "solve": bench_solve,
    "loop": bench_loop,
    "training": bench_training,
    "panel": bench_panel,
}


def main() -> None:
    """Run all, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*BENCHES, []], help="which; all by default")
    for name in parser.parse_args().names or BENCHES:
        BENCHES[name]()


if __name__ == "__main__":
    main()
