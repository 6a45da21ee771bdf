"""Checks of notebook 10."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import array, arrays, check, expect, policy


@check(arrays("the mean and the share of the variance", array("the mean", None), array("the share", None)))
def one_outcome(answer: Callable) -> None:
    """At the plan that was tried, at a length from it, and far away; with noise and without."""
    x, tried, missed = np.array([2.0, 3.0, 1.0, 20.0]), 2.0, 0.7
    k = np.exp(-0.5 * (x - tried) ** 2)
    for noise in (0.0, 0.25):
        mean, left = answer(x, tried, missed, noise)
        wanted = k * missed / (1 + noise)
        slips = {
            "the mean is what was missed, weighted by k: where is what was missed?": k / (1 + noise),
            "an outcome with noise teaches less: the noise is added to k of the tried plan with itself": k * missed,
            "the kernel has a half in its exponent": k**2 * missed / (1 + noise),
        }
        expect(mean, wanted, f"the mean is {wanted.round(3)} here, got {mean.round(3)}", slips)
        share = 1 - k**2 / (1 + noise)
        slips = {
            "that is the share that is known: asked is what is left": 1 - share,
            "k enters twice": 1 - k / (1 + noise),
            "that is a standard deviation; asked is the variance": share**0.5,
        }
        expect(left, share, f"of the variance, {share.round(3)} are left here, got {left.round(3)}", slips)
    mean, left = answer(np.array([-1.0]), -1.0, -3.0, 0.0)
    expect([*mean, *left], [-3, 0], "where a plan was tried without noise, its outcome is known")


class _Practising:
    """A policy that notes whether it practises in each step."""

    def __init__(self) -> None:
        self.exploring = True
        self.noted: list[tuple[int, bool]] = []

    def __call__(self, observation: int) -> np.ndarray:
        self.noted.append((observation, bool(self.exploring)))
        return np.array([0.5, -observation / 100])


@check(policy(2))
def practise_then_perform(answer: Callable) -> None:
    """Periods in different numbers and of different lengths, and when they stop being practice."""
    for periods, period in ((3, 8), (2, 5)):
        inner, steps = _Practising(), (periods + 2) * period
        wrapped = answer(inner, periods, period)
        assert not inner.noted, "ask the policy in each step, and not before the first"
        sent = np.array([wrapped(t) for t in range(steps)])
        message = "ask the policy once in each step, and pass the observation on"
        assert [t for t, _ in inner.noted] == list(range(steps)), message
        expect(sent, np.stack([np.full(steps, 0.5), -np.arange(steps) / 100], axis=1), "send what the policy says")
        practised = [each for _, each in inner.noted]
        last = practised.index(False) if False in practised else steps
        message = f"{periods} periods of {period} steps are to be practice; yours stops after {last} steps"
        assert last == periods * period, message
        assert not any(practised[last:]), "once it performs, it goes on performing"
