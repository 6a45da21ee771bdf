"""Fitting the simulation finds known constants, and the network learns those that it is
given.
"""

import mujoco.sysid
import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import Autoencoder
from clothlab.method.data import Run
from clothlab.policies import ReplayPolicy
from clothlab.simulation.cloth import CLOTHS, Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout
from studies.sysid import MIDDLE, fit_simulation, logs, simulator, train_regressor

TINY = Cloth("tiny", rows=3, columns=2)
COMMANDS = np.array(
    [[0.4, -0.9], [0.4, -0.9], [-0.2, -1.6], [-0.2, -1.6], [0.3, -0.6], [0.3, -0.6]]
)
needs_sysid = pytest.mark.skipif(
    not hasattr(mujoco.sysid, "optimize"), reason="packages of mujoco.sysid are missing"
)


BOTTOM = MIDDLE + np.array([0.3, -0.2])


def bumpy(constants, u):
    """A valley that leads to (0.3, -0.2) from the middle, with many small ones across."""
    x = constants - BOTTOM
    return np.tile(np.concatenate([x, 0.3 * np.sin(25 * x)]), (len(u), 1))


@needs_sysid
def test_the_coarse_search_begins_in_the_right_valley():
    run = Run(bumpy(BOTTOM, np.zeros((4, 2))), np.zeros((4, 2)), "unknown")

    def miss(cells):
        found = fit_simulation(bumpy, run, np.ones(4), cells=cells, eps=1e-3, xtol=1e-6)
        return np.abs(found - BOTTOM).max()

    assert miss(cells=21) < 1e-3 < 0.1 < miss(cells=1)


@pytest.mark.slow
def test_the_simulator_senses_what_a_robot_does():
    torch.manual_seed(0)
    autoencoder, cloth = Autoencoder().eval(), Cloth("x", damping=0.04, mass=0.12)
    env = ClothEnv("torque", cloth)
    u = np.clip(COMMANDS[:3], env.arm.command_lower, env.arm.command_upper)
    trial = rollout(env, ReplayPolicy(u), 3)
    env.close()
    with simulator(env.arm, autoencoder) as simulate:
        s = simulate(logs(cloth), u)
        assert s[:, 3:] == pytest.approx(trial.robot, abs=1e-6)
        assert not np.allclose(simulate(logs(cloth) + 0.3, u)[2], s[2])
        assert np.array_equal(simulate(logs(cloth), u), s), (
            "what was simulated before leaves no trace"
        )
    with simulator(env.arm, autoencoder, Cloth("rough", stiffness=30.0)) as simulate:
        assert not np.allclose(simulate(logs(cloth), u), s)


def swing(cloth, seed, steps=40):
    """A run that shows its cloth plainly."""
    u = np.random.default_rng(seed).normal(size=(steps, 2))
    return Run(
        np.column_stack([u * cloth.damping * 20, u * cloth.mass * 10]), u, cloth.name
    )


RUNS = [swing(cloth, k) for k, cloth in enumerate(CLOTHS.values())]
CONSTANTS = {name: logs(cloth) for name, cloth in CLOTHS.items()}
QUICK = {"updates": 150, "window": 30, "hidden_size": 16, "learning_rate": 1e-2}


@pytest.fixture(scope="module")
def network():
    return train_regressor(RUNS, CONSTANTS, **QUICK, seed=3)


@pytest.mark.slow
def test_the_network_learns_a_tiny_set_by_heart_and_the_same_with_the_same_seed(
    network,
):
    model, losses = network
    assert losses[-1] < 0.05 < 0.5 < losses[0]
    assert (
        max(np.abs(model.identify(run) - CONSTANTS[run.material]).max() for run in RUNS)
        < 0.15
    )
    again, same = train_regressor(RUNS, CONSTANTS, **QUICK | {"updates": 3}, seed=3)
    other, _ = train_regressor(RUNS, CONSTANTS, **QUICK | {"updates": 3}, seed=4)
    assert not np.array_equal(other.identify(RUNS[0]), again.identify(RUNS[0]))
    assert same[0] == losses[0]
