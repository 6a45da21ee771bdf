"""What trainings share: random numbers of their own, memory that is used again, and a GPU where there is one."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from clothlab.learning._training import best_device, training
from clothlab.learning.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.learning.dpmpb import ModelTraining, train_dpmpb

FAULTS = """
import resource
import numpy as np
from clothlab.learning.autoencoder import AutoencoderTraining, train_autoencoder
{forget}
images = np.zeros((64, 96, 128), bool)
found = []
for epochs in (3, 13):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    train_autoencoder(images, AutoencoderTraining(epochs=epochs), progress=False)
    found.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print((found[1] - found[0]) / 10)
"""
FORGET = "import clothlab.learning._training; clothlab.learning._training._keep_freed_memory = lambda: None"


def test_the_same_seed_gives_the_same_numbers_and_the_callers_go_on():
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    drawn = []
    for _ in range(2):
        with training(5):
            drawn.append(torch.rand(2))
    assert torch.equal(*drawn)
    assert torch.equal(torch.rand(3), expected)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only glibc has such thresholds")
def test_a_training_does_not_ask_the_system_for_the_same_memory_at_each_step():
    faults = {}
    for name, forget in (("kept", ""), ("given back", FORGET)):
        code = FAULTS.format(forget=forget)
        faults[name] = float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout)
    assert faults["kept"] < 0.5 * faults["given back"]  # pages that the system cleared in a step


def test_a_gpu_is_where_one_trains_if_torch_sees_one(monkeypatch):
    for seen, device in ((True, "cuda"), (False, "cpu")):
        monkeypatch.setattr(torch.cuda, "is_available", lambda seen=seen: seen)
        assert best_device() == device


@pytest.mark.slow
@pytest.mark.skipif(not torch.cuda.is_available(), reason="TORCH SEES NO GPU: nothing was trained on one")
def test_trainings_on_a_gpu_end_where_those_on_a_cpu_do(trial, made_up_runs):
    images = np.concatenate([trial.images] * 4)
    eyes, model = AutoencoderTraining(epochs=5, batch_size=12), ModelTraining(epochs=5, sequence_length=5)
    losses = {}
    for device in (None, "cpu"):  # by default on the GPU
        torch.cuda.reset_peak_memory_stats()
        seeing, first = train_autoencoder(images, eyes, device=device, progress=False)
        predicting, _, trace = train_dpmpb(made_up_runs, model, device=device, progress=False)
        assert device or torch.cuda.max_memory_allocated()
        assert {p.device.type for each in (seeing, predicting) for p in each.parameters()} == {"cpu"}
        assert not seeing.training
        losses[device] = np.array([first[-1], trace.losses[-1]])
    assert losses[None] == pytest.approx(losses["cpu"], rel=0.2)  # other random numbers, the same learning
