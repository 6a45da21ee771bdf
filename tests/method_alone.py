"""A program with the method alone: a toy is trained, saved, loaded, estimated, steered.

Tests run it where there is no simulation; then it prints what it has imported beside.
"""

import importlib
import pkgutil
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

import clothlab.method
from clothlab import (
    Checkpoint,
    Controller,
    ControlSettings,
    ModelTraining,
    Run,
    estimate_bias,
    runs_from_dataframe,
    train_dpmpb,
)

FOREIGN = {"mujoco", "gymnasium", "matplotlib", "cv2", "pandas", "scipy", "sklearn"}
FOREIGN |= {"pooch", "PIL", "IPython", "anywidget"}
STIFFNESSES = {"soft": 0.1, "hard": 0.5}


def swing(
    stiffness: float, seed: int, pushes: int = 300
) -> tuple[np.ndarray, np.ndarray]:
    """States and commands of a mass on a spring, pushed at random."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (pushes, 1)).repeat(2, axis=0)
    s = np.zeros((len(u), 2))
    for t, push in enumerate(u[:-1, 0]):
        x, v = s[t]
        v = 0.8 * v + 0.3 * push - stiffness * x
        s[t + 1] = x + v, v
    return s, u


def main() -> None:
    """Go through the method once."""
    torch.set_num_threads(1)
    for module in pkgutil.iter_modules(clothlab.method.__path__):
        importlib.import_module(f"clothlab.method.{module.name}")

    # Training, of one number p
    runs = [Run(*swing(k, seed=0), name) for name, k in STIFFNESSES.items()]
    settings = ModelTraining(epochs=20, sequence_length=15, bias_size=1, batch_size=40)
    model, biases, trace = train_dpmpb(runs, settings, progress=False)
    assert trace.losses[-1] < trace.losses[0] / 2

    # From memory to disk and back
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "swing.safetensors"
        trained = Checkpoint(
            name="swing", model=model, biases=biases, settings=settings, step=0.1
        )
        trained.save(path)
        read = Checkpoint.load(path)

    # Another run with the hard spring is nearer to its p.
    s, u = swing(0.5, seed=1, pushes=60)
    log = {"time": 0.1 * np.arange(len(s)), "x": s[:, 0], "v": s[:, 1], "u": u[:, 0]}
    (another,) = runs_from_dataframe(
        log, "?", time="time", states=["x", "v"], commands=["u"], step=0.1
    )
    p, _ = estimate_bias(read.model, another, method="newton")
    assert abs(p - biases["hard"]) < abs(p - biases["soft"])

    # And a command towards the right pushes to the right.
    controller = Controller(
        read.model,
        lambda states, commands, t: (states[..., 0] - 1).square().sum(-1),
        p,
        lower=[-1],
        upper=[1],
        settings=ControlSettings(),
    )
    assert controller.act([0, 0]) > 0

    print(*sorted(FOREIGN & set(sys.modules)))


if __name__ == "__main__":
    main()
