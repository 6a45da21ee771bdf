"""Small things that several tests share. Nothing here reads `data/`."""

import numpy as np
import pytest
import torch

from clothlab.dpmpb import DPMPB, Memory
from clothlab.env import ClothEnv
from clothlab.trials import RandomPolicy, rollout


@pytest.fixture(autouse=True)
def one_thread():
    """Tiny matrices run faster on one core, and two runs add up in the same order."""
    torch.set_num_threads(1)


@pytest.fixture
def env():
    env = ClothEnv("torque", "damp0.05-mass0.10")
    yield env
    env.close()


@pytest.fixture(scope="session")
def trial():
    env = ClothEnv("torque", "damp0.05-mass0.10")
    trial = rollout(env, RandomPolicy(env.arm, seed=0), 12)
    env.close()
    return trial


@pytest.fixture
def model():
    """Random weights in double precision, so that finite differences are exact enough to compare with."""
    torch.manual_seed(0)
    model = DPMPB(state_size=7, command_size=2).double()
    model.s_mean.copy_(torch.linspace(-1, 1, 7))
    model.s_std.copy_(torch.linspace(0.5, 2, 7))
    model.u_std.fill_(0.6)
    return model.requires_grad_(False)


@pytest.fixture
def memory():
    generator = torch.Generator().manual_seed(1)
    h, c = (torch.randn(2, 1, 30, generator=generator, dtype=torch.float64) * 0.3 for _ in range(2))
    return Memory(h, c)


@pytest.fixture
def square():
    """A mask with a square of cloth in it."""
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    return mask
