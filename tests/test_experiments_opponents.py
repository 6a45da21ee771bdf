"""The opponents are fair: they do what they are said to do, and stay in range."""

import numpy as np
import pytest
import torch

from clothlab.experiments.opponents import (
    ChangesModel,
    ChangesPolicy,
    ChangesTraining,
    CrossEntropyPolicy,
    MeanLossPolicy,
    Repeat,
    train_changes,
)
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import ControlPolicy
from clothlab.learning.dpmpb import DPMPB, Sequences
from clothlab.simulation.arm import TorqueArm
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout

ARM = TorqueArm()


def models(count):
    torch.manual_seed(0)
    return [DPMPB(7, 2).eval().requires_grad_(False) for _ in range(count)]


def moved(policy, steps=9, seed=0):
    env = ClothEnv("torque", "damp0.05-mass0.10")
    try:
        return rollout(env, policy, steps, seed=seed).commands
    finally:
        env.close()


def test_a_plan_is_repeated():
    commands = moved(Repeat([[0.1, -0.2], [0.3, -0.4]]), steps=5)
    assert commands[:, 0].tolist() == pytest.approx([0.1, 0.3, 0.1, 0.3, 0.1])


def test_cross_entropy_is_never_worse_than_its_start_and_the_same_for_the_same_seed(square):
    (model,), autoencoder = models(1), Autoencoder().eval()
    policy = CrossEntropyPolicy(model, autoencoder, ARM, square, [0.0, 0.0])
    first, second = (moved(policy, seed=4) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert all((np.diff(trace) <= 1e-6).all() for trace in policy.trace)


def test_the_order_of_an_ensembles_members_changes_nothing(square):
    (first, *others), autoencoder = models(3), Autoencoder().eval()
    members = [(model, np.full(2, 0.1 * k)) for k, model in enumerate(others)]
    runs = [
        moved(MeanLossPolicy(first, autoencoder, ARM, square, [0.0, 0.0], members=order), steps=2)
        for order in (members, members[::-1])
    ]
    np.testing.assert_allclose(*runs, atol=1e-3)


def test_an_ensemble_of_equals_does_what_one_of_them_does(square):
    (model,), autoencoder = models(1), Autoencoder().eval()
    alone = moved(ControlPolicy(model, autoencoder, ARM, square, [0.0, 0.0]), steps=2)
    three = MeanLossPolicy(model, autoencoder, ARM, square, [0.0, 0.0], members=[(model, [0.0, 0.0])] * 2)
    np.testing.assert_allclose(moved(three, steps=2), alone, atol=1e-3)


def linear_runs():
    """Runs in which the outcome is a sum of past commands."""
    rng = np.random.default_rng(0)
    for k in range(6):
        u = rng.uniform(-1, 1, (120, 2))
        s = np.zeros((120, 7))
        for t in range(119):
            s[t + 1, :2] = 0.6 * s[t, :2] + u[t]
        yield Sequences(s, u, f"cloth {k % 2}")


def test_a_model_of_changes_learns_what_changes_and_nothing_changes_where_nothing_does():
    runs, (model,) = list(linear_runs()), models(1)
    changes = train_changes(runs, model, 3, ChangesTraining(updates=400, batch_size=64), seed=0)
    run = runs[0]
    s, u, z = (torch.as_tensor(x) for x in (run.s[[40, 60]], np.stack([run.u[40:48], run.u[60:68]]), run.s))
    z = torch.stack([z[41:49, :3], z[61:69, :3]])
    predicted = changes(s[:1], u[:1], z[:1], s[1:], u[1:])
    assert (predicted - z[1:]).abs().mean() < 0.5 * (z[:1] - z[1:]).abs().mean()


def test_commands_of_the_model_of_changes_stay_in_range(square):
    (model,) = models(1)
    changes = ChangesModel(7, 2, 3).eval().requires_grad_(False)
    policy = ChangesPolicy(changes, model, Autoencoder().eval(), ARM, square, np.full((8, 2), 0.9))
    commands = moved(policy, steps=17)
    assert ((commands >= ARM.command_lower) & (commands <= ARM.command_upper)).all()
    assert not np.allclose(commands[:8], commands[8:16])


@pytest.mark.parametrize("change", [{"updates": 0}, {"learning_rate": float("nan")}])
def test_bad_settings_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        ChangesTraining(**change)
