"""The method computes on one thread, wherever it is started, and gives back the others."""

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from clothlab.method import estimation
from clothlab.method.autoencoder import (
    Autoencoder,
    AutoencoderTraining,
    encode,
    train_autoencoder,
)
from clothlab.method.control import Controller
from clothlab.method.data import Run
from clothlab.method.estimation import BiasEstimator, EstimationSettings
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb

MODEL = DPMPB(7, 2).eval()
RNG = np.random.default_rng(0)
RUN = Run(RNG.normal(size=(20, 7)), RNG.normal(size=(20, 2)), "a")


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    """As torch starts on a machine of two cores, where nothing asks for one thread."""
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(1)


class Counting:
    """Notes how many threads there are whenever it is called."""

    def __init__(self, function):
        self.function = function
        self.threads = set()

    def __call__(self, *arguments, **options):
        self.threads.add(torch.get_num_threads())
        return self.function(*arguments, **options)


def test_a_control_step_has_one_thread():
    loss = Counting(lambda states, commands, t: states[..., 0].square().sum(1))
    Controller(MODEL, loss, (0, 0), (-1, -1), (1, 1)).act(np.zeros(7))
    assert loss.threads == {1}
    assert torch.get_num_threads() == 2


def test_an_estimate_has_one_thread(monkeypatch):
    counted = Counting(estimation.prediction_loss)
    monkeypatch.setattr(estimation, "prediction_loss", counted)
    estimator = BiasEstimator(MODEL, settings=EstimationSettings(warmup=0))
    for s, u in zip(RUN.s, RUN.u, strict=True):
        estimator.update(s, u)
    assert counted.threads == {1}
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize("network", [DPMPB, Autoencoder])
def test_a_training_has_one_thread(network, monkeypatch):
    counted = Counting(network.forward)
    monkeypatch.setattr(network, "forward", lambda *given: counted(*given))
    if network is DPMPB:
        brief = ModelTraining(epochs=1, batch_size=5, sequence_length=5)
        train_dpmpb([RUN], brief, progress=False)
    else:
        brief = AutoencoderTraining(epochs=1, batch_size=2)
        train_autoencoder(RNG.integers(2, size=(2, 96, 128)), brief, progress=False)
    assert counted.threads == {1}
    assert torch.get_num_threads() == 2


def test_an_error_gives_the_threads_back():
    with pytest.raises(ValueError, match="cloth images are"):
        encode(Autoencoder().eval(), np.zeros((3, 3)))
    controller = Controller(MODEL, lambda *_: 1 / 0, (0, 0), (-1, -1), (1, 1))
    with pytest.raises(ZeroDivisionError):
        controller.act(np.zeros(7))
    assert torch.get_num_threads() == 2
