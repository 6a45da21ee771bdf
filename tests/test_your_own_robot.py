"""Every Python block of *Your own robot*, in order, in small sizes."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

import clothlab

PAGE = Path(clothlab.__file__).parents[1] / "docs" / "your_own_robot.md"
SMALLER = {
    r"epochs=\d+": "epochs=1",
    r"stride=\d+": "stride=10",
    r"horizon=\d+": "horizon=2",
    r"Held\(\), 200": "Held(), 40",
}


def blocks():
    return re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)


def write_logs(folder):
    """Logs as the page has them: a folder for each material."""
    rng = np.random.default_rng(0)
    for name in ("heavy", "light"):
        path = folder / "logs" / name / "monday.csv"
        path.parent.mkdir(parents=True)
        times = np.cumsum(rng.uniform(0.018, 0.022, 200))
        rows = np.column_stack([times, rng.normal(size=(200, 3))])
        head = "time [s],angle [rad],speed [rad/s],torque [N m]"
        np.savetxt(path, rows, delimiter=",", header=head, comments="")


@pytest.mark.slow
def test_every_block_runs_after_the_ones_before_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    torch.set_num_threads(1)
    write_logs(tmp_path)
    names = {}
    for block in blocks():
        if "export_solve" in block:
            for package in ("onnx", "onnxscript"):
                pytest.importorskip(package)
        code = block
        for large, small in SMALLER.items():
            code = re.sub(large, small, code)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            exec(compile(code, f"block: {block[:60]}", "exec"), names)
    assert names["u"].shape == (1,)
    assert {path.name for path in tmp_path.glob("*.onnx")} == {
        "h.onnx",
        "window.onnx",
        "solve.onnx",
    }


def test_each_block_imports_what_it_is_the_first_to_use():
    """A reader who begins with a later block sees where a name is from."""
    text = "\n".join(blocks())
    for name in re.findall(r"\b(?:Checkpoint|Controller)\b", text):
        assert re.search(rf"import [^\n]*\b{name}\b|^    {name},$", text, re.MULTILINE)
    for block in blocks():
        compile(block, "block", "exec")
