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
from clothlab.trials import rollout, to_run
from studies.sysid import (
    MIDDLE,
    fit_simulation,
    logs,
    simulator,
    train_regressor,
    windowed_simulator,
)

TINY = Cloth("tiny", rows=3, columns=2)
COMMANDS = np.array(
    [[0.4, -0.9], [0.4, -0.9], [-0.2, -1.6], [-0.2, -1.6], [0.3, -0.6], [0.3, -0.6]]
)
needs_sysid = pytest.mark.skipif(
    not hasattr(mujoco.sysid, "optimize"), reason="packages of mujoco.sysid are missing"
)


BOTTOM = MIDDLE + np.array([0.3, -0.2])


def bumpy(constants, run):
    """A valley that leads to (0.3, -0.2) from the middle, with many small ones across."""
    x = constants - BOTTOM
    return np.tile(np.concatenate([x, 0.3 * np.sin(25 * x)]), (len(run), 1))


@needs_sysid
def test_the_coarse_search_begins_in_the_right_valley():
    run = Run(bumpy(BOTTOM, range(4)), np.zeros((4, 2)), "unknown")

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
    run = to_run(autoencoder, rollout(env, ReplayPolicy(u), 3))
    env.close()
    with simulator(env.arm, autoencoder) as simulate:
        s = simulate(logs(cloth), run)
        assert s == pytest.approx(run.s, abs=1e-6)
        assert not np.allclose(simulate(logs(cloth) + 0.3, run)[2], s[2])
        assert np.array_equal(simulate(logs(cloth), run), s), (
            "what was simulated before leaves no trace"
        )
    with simulator(env.arm, autoencoder, Cloth("rough", stiffness=30.0)) as simulate:
        assert not np.allclose(simulate(logs(cloth), run), s)


@pytest.mark.slow
def test_windows_forget_what_was_before_them_and_know_the_joints():
    torch.manual_seed(0)
    autoencoder, cloth = Autoencoder().eval(), Cloth("x", damping=0.04, mass=0.12)
    env = ClothEnv("torque", cloth)
    u = np.clip(COMMANDS, env.arm.command_lower, env.arm.command_upper)
    run = to_run(autoencoder, rollout(env, ReplayPolicy(u), len(u)))
    env.close()
    sizes = {"window": 2, "lead": 1}
    with windowed_simulator(env.arm, autoencoder, **sizes) as simulate:
        s = simulate(logs(cloth), run)
        assert s.shape == run.s.shape
        assert s[:2] == pytest.approx(run.s[:2], abs=1e-5), "its state is known"
        assert not np.allclose(s[2:], run.s[2:], atol=1e-3), "no speeds are known"

        # A window begins where the joints were one step before it, whatever was earlier
        other = Run(run.s.copy(), run.u.copy(), "unknown")
        other.s[:3] += 0.1
        other.u[:3] += 0.1
        again = simulate(logs(cloth), other)
        assert not np.allclose(again[:4], s[:4])
        assert np.array_equal(again[4:], s[4:])


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
