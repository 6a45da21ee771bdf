"""Checks of notebook 09."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import check, policy
from clothlab.simulation.arm import get_arm


@check(policy(2))
def shaken(answer: Callable) -> None:
    """Shape, spread, mean and source of the noise on constant commands, and its range."""
    arm, quiet, sigma = get_arm("torque"), np.array([0.1, -0.8]), 0.05
    asked = []

    def send(seed: int, steps: int) -> np.ndarray:
        command = quiet.copy()

        def other(observation: int) -> np.ndarray:
            asked.append(observation)
            return command

        policy = answer(other, arm, sigma, np.random.default_rng(seed))
        sent = np.array([policy(t) for t in range(steps)])
        message = (
            "your policy changes the other one's command in place, as `u += …` does, and noise adds up: use a copy"
        )
        assert np.array_equal(command, quiet), message
        return sent

    _expect_noise(send(1, 2000) - quiet, sigma)
    assert asked == list(range(2000)), "ask the policy once in each step, and pass the observation on"
    one, again, other = (send(seed, 5) for seed in (1, 1, 2))
    assert np.array_equal(one, again), "the same rng must give the same noise: use it, and no other"
    assert not np.array_equal(one, other), "another rng must give other noise: use the one that is handed over"
    for limit in (arm.command_upper, arm.command_lower):
        edge = answer(lambda observation, limit=limit: limit.copy(), arm, 1.0, np.random.default_rng(1))
        sent = np.array([edge(None) for _ in range(50)])
        inside = (sent >= arm.command_lower - 1e-6) & (sent <= arm.command_upper + 1e-6)
        assert inside.all(), "a command left its range: use numpy.clip"


def _expect_noise(noise: np.ndarray, sigma: float) -> None:
    """Normal noise `[N, 2]` of so much, for each command its own."""
    spread = noise.std(axis=0)
    assert spread.min() > 1e-9, "the commands are not disturbed at all, or always in the same way"
    alike = abs(np.corrcoef(noise.T)[0, 1])
    assert alike < 0.3, "both commands get the same noise: draw a number for each"
    message = f"the noise has a standard deviation of {spread.round(4)} rad, not {sigma} rad"
    if np.allclose(spread, sigma**2, rtol=0.1):
        message += ": is σ, or σ², what you multiply with?"
    assert np.allclose(spread, sigma, rtol=0.1), message
    assert np.allclose(noise.mean(axis=0), 0, atol=0.2 * sigma), "the noise must have the mean 0"
    within = (abs(noise) < sigma).mean()
    message = f"two thirds of normal noise lie within one standard deviation, of yours {within:.0%}: is it normal?"
    assert abs(within - 0.683) < 0.05, message
