"""From a folder of logs to a graph that needs no PyTorch, with the method alone.

Tests run it where there is no simulation; then it prints what it has imported beside.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from method_alone import FOREIGN, STIFFNESSES, swing

from clothlab import Checkpoint, ModelTraining, read_runs, train_dpmpb
from clothlab.method.onnx_export import export_prediction


def write_logs(folder: Path) -> None:
    """A log of each spring, in a folder of its name."""
    for name, stiffness in STIFFNESSES.items():
        s, u = swing(stiffness, seed=0, pushes=100)
        time = 0.1 * np.arange(len(s))
        (folder / name).mkdir()
        with (folder / name / "monday.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time [s]", "x [m]", "v [m/s]", "push [N]"])
            writer.writerows(np.column_stack([time, s, u]).tolist())


def main() -> None:
    """Go once from logs to a graph."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as name:
        # Logs become runs
        folder = Path(name)
        write_logs(folder)
        states = ["x [m]", "v [m/s]"]
        runs = read_runs(
            folder, time="time [s]", states=states, commands=["push [N]"], step=0.1
        )
        assert {run.material for run in runs} == set(STIFFNESSES)

        # Runs become one file, which says what it is
        settings = ModelTraining(epochs=2, sequence_length=15, bias_size=1)
        model, biases, _ = train_dpmpb(runs, settings, progress=False)
        trained = Checkpoint(
            name="swing",
            model=model,
            biases=biases,
            step=model.step,
            state_names=runs[0].state_names,
        )
        trained.save(folder / "swing.safetensors")
        read = Checkpoint.load(folder / "swing.safetensors")
        assert read.step == 0.1
        assert "x [m]" in read.card()

        # And a graph, which predicts the same
        export_prediction(folder / "h.onnx", read.model)
        graph = onnxruntime.InferenceSession(folder / "h.onnx")
        s = runs[0].s[None, :1]
        u = runs[0].u[None, :1]
        p = biases["soft"].astype(np.float32)
        memory = {"h": np.zeros((2, 1, 30), np.float32)}
        memory["c"] = memory["h"]
        by_graph, *_ = graph.run(None, {"s": s, "u": u, "p": p, **memory})
    inputs = (torch.as_tensor(each) for each in (s, u, p))
    by_torch, _ = read.model(*inputs)
    assert np.abs(by_graph - by_torch.detach().numpy()).max() < 1e-5

    print(*sorted(FOREIGN & set(sys.modules)))


if __name__ == "__main__":
    main()
