"""What a program has set in torch around us changes nothing that we compute."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.method.control import Controller
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.method.model import DPMPB
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.simulation.arm import get_arm
from clothlab.weights import ClothCheckpoint


@contextmanager
def double_precision() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


AROUND = {
    "no gradients": torch.no_grad,
    "inference mode": torch.inference_mode,
    "double precision": double_precision,
}
RNG = np.random.default_rng(0)
RUN = Run(RNG.normal(size=(40, 7)), RNG.uniform(-0.5, 0, size=(40, 2)), "a")
IMAGES = RNG.random((16, 96, 128)) > 0.5


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> ClothCheckpoint:
    torch.manual_seed(0)
    model, _, _ = train_dpmpb([RUN], ModelTraining(1, 10, 10), progress=False)
    eye, _ = train_autoencoder(IMAGES, AutoencoderTraining(1, 8), progress=False)
    arm, biases = get_arm("torque"), {"a": np.float32([0.1, 0.2])}
    made = ClothCheckpoint(arm=arm, autoencoder=eye, model=model, biases=biases)
    path = tmp_path_factory.mktemp("weights") / "made.safetensors"
    made.save(path)
    return path


def controlled(model: DPMPB) -> np.ndarray:
    def loss(states, commands, t):
        return (states[..., 0] - 0.5).square().mean(1)

    controller = Controller(model, loss, [0.1, 0.2], [-0.8, -1.6], [1, 0])
    return np.array([controller.act(s) for s in RUN.s[:3]])


def towards_a_target(path) -> np.ndarray:
    read = ClothCheckpoint.load(path)
    policy = read.controller(IMAGES[0], "a")
    policy.reset()
    policy.set_target(IMAGES[1])
    return policy({"image": IMAGES[2], "robot": np.zeros(4)})


def iterated(path) -> np.ndarray:
    read = ClothCheckpoint.load(path)
    policy = read.iterative_controller(IMAGES[0], "a", [RUN])
    return policy({"image": IMAGES[2], "robot": np.zeros(4)})


COMPUTED: dict[str, Callable] = {
    "control": lambda path: controlled(ClothCheckpoint.load(path).model),
    "a target": towards_a_target,
    "iterative": iterated,
    "sgd": lambda path: estimate_bias(ClothCheckpoint.load(path).model, RUN)[0],
    "newton": lambda path: estimate_bias(
        ClothCheckpoint.load(path).model, RUN, method="newton"
    )[0],
    "training": lambda path: train_dpmpb(
        [RUN], ModelTraining(2, 10, 10), progress=False
    )[2],
    "autoencoder": lambda path: train_autoencoder(
        IMAGES, AutoencoderTraining(2, 8), progress=False
    )[1],
}


@pytest.mark.parametrize("around", AROUND)
@pytest.mark.parametrize("name", COMPUTED)
def test_what_is_set_around_a_call_changes_nothing(checkpoint, name, around):
    expected = COMPUTED[name](checkpoint)
    with AROUND[around]():
        found = COMPUTED[name](checkpoint)
    assert np.array_equal(found, expected)
    assert torch.is_grad_enabled()
    assert torch.get_default_dtype() == torch.float32


def test_a_controller_that_was_made_elsewhere_acts_under_inference_mode(checkpoint):
    model = ClothCheckpoint.load(checkpoint).model
    expected = controlled(model)
    with torch.inference_mode():
        assert np.array_equal(controlled(model), expected)


def test_weights_in_double_precision_are_refused_with_the_cure():
    with pytest.raises(ValueError, match=r"float64.*hand over `model.float\(\)`"):
        controlled(DPMPB(7, 2).double())
