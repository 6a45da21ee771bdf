"""Checks of notebook 06: what is drawn, what is right, and what usual slips give."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks.ask import Question, exercise
from clothlab.method.data import Run


@exercise("a slope along each of the two axes", 2)
def gradient_by_nudges(rng: np.random.Generator) -> Question:
    """The gradient `[2]` of a loss by central differences.

    Given are a loss of p, a place p `[2]` and a nudge ε so large that forward
    differences are seen to differ.
    """
    loss_at, p = _loss_and_place(rng)
    nudge = rng.uniform(0.15, 0.4)
    here = loss_at(p)
    ahead = np.array([loss_at(p + nudge * axis) for axis in np.eye(2)])
    behind = np.array([loss_at(p - nudge * axis) for axis in np.eye(2)])
    truth = (ahead - behind) / (2 * nudge)
    slips = {
        "the two places are 2 ε apart: divide by that": truth * 2,
        "divide the difference of the loss by the distance of the two places": ahead
        - behind,
        "nudge p both ways, not forwards alone": (ahead - here) / nudge,
        "the sign is wrong: ahead minus behind": -truth,
    }
    return Question(
        (loss_at, p, nudge),
        truth,
        slips,
        lambda found: (
            f"a polynomial has the slopes {truth.round(4)}, not {found.round(4)}"
        ),
    )


@exercise("a step, one number")
def best_step(rng: np.random.Generator) -> Question:
    """The step that makes the sum of squares of e - J step smallest.

    Given are residuals e and slopes J, both `[T, D_s]`.
    """
    J = rng.uniform(0.5, 2.0, (6, 3)) * rng.choice([-1, 1], (6, 3))
    e = rng.normal(0.5, 1.0, (6, 3))
    truth = np.sum(J * e) / np.sum(J**2)
    slips = {
        "the step goes the wrong way: where J and e have one sign, x grows": -truth,
        "divide by the sum of the squared slopes": np.sum(J * e),
        "this is the mean of all wishes e / J: a large slope knows better": (
            e / J
        ).mean(),
        "this sums up e and J first: misses of both signs cancel": e.sum() / J.sum(),
        "this is one over it": 1 / truth,
    }
    return Question(
        (e, J),
        truth,
        slips,
        lambda found: (
            "after this step the misses have the sum of squares "
            f"{np.sum((e - J * found) ** 2):.4g}; {np.sum((e - J * truth) ** 2):.4g} "
            "is possible"
        ),
    )


@exercise("a step of p", 2)
def bare_step(rng: np.random.Generator) -> Question:
    """The step `[2]` of p that makes the sum of squares of e - J step smallest.

    Given are twelve residuals `[12]` and their slopes `[12, 2]` by the numbers of p.
    """
    J = rng.normal(size=(12, 2)) @ np.array([[1.0, 0.6], [0.0, 0.5]])
    e = rng.normal(0.5, 1.0, 12)
    curved = J.T @ J
    downhill = J.T @ e
    truth = np.linalg.solve(curved, downhill)
    slips = {
        "the step goes the wrong way": -truth,
        "this is the downhill direction alone: solve the two equations": downhill,
        "each number has its own step here, as if the other stood still: what one does "
        "to a prediction, the other may undo": downhill / np.diag(curved),
        "the matrix stands on the other side of its equation": curved @ downhill,
    }
    return Question(
        (e, J),
        truth,
        slips,
        lambda found: (
            "after this step the misses have the sum of squares "
            f"{np.sum((e - J @ found) ** 2):.4g}; {np.sum((e - J @ truth) ** 2):.4g} "
            "is possible"
        ),
    )


@exercise("p after each step", 30, 2, rtol=1e-3, atol=1e-5)
def online(rng: np.random.Generator) -> Question:
    """The p `[30, 2]` of momentum SGD on the loss over a sliding window, from zero.

    Given are a run of 30 steps, the loss of states, commands, p and warm-up, the rate,
    the momentum, the window and the warm-up.
    """
    # A run, and the settings of a loop over it
    u = rng.uniform(-2, 2, (30, 2)).astype(np.float32)
    s = rng.normal(size=(30, 2)).astype(np.float32)
    rate = rng.uniform(0.02, 0.06)
    momentum = rng.uniform(0.5, 0.8)
    warmup = int(rng.integers(3, 6))

    def loop(
        rate: float = rate,
        momentum: float = momentum,
        window: int = 12,
        ignored: int = warmup,
    ) -> np.ndarray:
        """The p after each step `[T, 2]`, by the slope of a parabola."""
        p = np.zeros(2)
        b = np.zeros(2)
        path = []
        for t in range(len(s)):
            first = max(0, t - window)
            if t > first + warmup:
                seen = slice(first + ignored, t)
                after = slice(first + ignored + 1, t + 1)
                error = s[seen] + p * u[seen] - s[after]
                b = momentum * b + (2 * error * u[seen]).sum(axis=0) / error.size
                p = p - rate * b
            path.append(p)
        return np.array(path)

    slips = {
        "p stays where it was: let it move": np.zeros((30, 2)),
        "the buffer keeps a share of the old gradients: the momentum": loop(momentum=0),
        "p moves by the rate times the buffer, down and not up": loop(rate=-rate),
        "the loss is that of the window alone, from its first step on": loop(window=30),
        "the loss counts all predictions: hand the warm-up on to it": loop(ignored=0),
    }
    given = (Run(s, u, "any"), _toy_loss, rate, momentum, 12, warmup)
    otherwise = "p differs from that of momentum SGD on the loss over the window"
    return Question(given, loop(), slips, otherwise)


def _toy_loss(
    s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, warmup: int = 0
) -> torch.Tensor:
    """Loss of a model in which a state moves by p times the command."""
    error = s[:-1] + p * u[:-1] - s[1:]
    return error[warmup:].square().mean()


@exercise("a rate, one number")
def largest_rate(rng: np.random.Generator) -> Question:
    """The largest rate with which momentum SGD on a parabola does not diverge.

    Given are a curvature and a momentum.
    """
    curvature = rng.uniform(0.05, 5.0)
    momentum = rng.uniform(0.3, 0.95)
    truth = 2 * (1 + momentum) / curvature
    slips = {
        "that is the limit without momentum; the buffer changes it": 2 / curvature,
        "momentum allows a larger rate, not a smaller one: check the sign of its "
        "eigenvalue": 2 * (1 - momentum) / curvature,
        "that is the rate at which one step goes to the bottom, not the limit": 1
        / curvature,
        "half of the limit: the step may overshoot as far as it came": truth / 2,
        "the curvature is a stiffness, not its square": truth / curvature,
        "the full pace rate / (1 - momentum) is not what must be below 2 / curvature": 2
        / (curvature * (1 - momentum)),
        "a steeper parabola needs a smaller rate": truth * curvature**2,
    }

    def otherwise(found: float) -> str:
        grown = _grown(curvature, momentum, found)
        return (
            f"curvature {curvature:.3g}, momentum {momentum:.3g}: {found:.4g} is not "
            f"the limit; x grows by {grown:.3g} a step there, at the limit by 1"
        )

    return Question((curvature, momentum), truth, slips, otherwise)


def _grown(curvature: float, momentum: float, rate: float) -> float:
    """By what x grows in each step, in the long run: the largest eigenvalue."""
    step = np.array([[1 - rate * curvature, -rate * momentum], [curvature, momentum]])
    return float(np.abs(np.linalg.eigvals(step)).max())


@exercise("a second derivative along each of the axes", 3)
def curvature(rng: np.random.Generator) -> Question:
    """The second derivatives `[3]` of a loss along three axes.

    Given are a loss of p, a place off its bottom `[2]`, axes of length 1 `[3, 2]`, one
    of them slanted, and the length of a step ε.
    """
    angle = rng.uniform(0.5, 1.1)  # [rad]
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [np.cos(angle), np.sin(angle)]])
    loss_at, p = _loss_and_place(rng)
    step = rng.uniform(0.1, 0.5)
    here = loss_at(p)
    ahead = np.array([loss_at(p + step * axis) for axis in axes])
    behind = np.array([loss_at(p - step * axis) for axis in axes])
    truth = (ahead - 2 * here + behind) / step**2
    slips = {
        "a curvature is divided by the square of the step: what is yours divided "
        "by?": truth * step,
        "it is not divided by anything: a curvature is divided by the square of the "
        "step": truth * step**2,
        "the two places are 2 ε apart, but each step is ε: divide by ε², not by "
        "(2 ε)²": truth / 4,
        "that is half of it: a parabola's factor is half of its second "
        "derivative": truth / 2,
        "the loss at p itself counts twice": truth + here / step**2,
        "the loss at p itself is subtracted, not added": truth + 4 * here / step**2,
        "that is the slope along the axis; asked is how the slope changes": (
            ahead - behind
        )
        / (2 * step),
        "that is a change of the loss to one side only: take a step ahead and a step "
        "behind": (ahead - here) / step**2,
        "the sign is wrong: where the loss rises to both sides, the curvature is "
        "positive": -truth,
    }
    return Question(
        (loss_at, p, axes, step),
        truth,
        slips,
        lambda found: (
            "that is not how the slope changes: compare the loss a step ahead and a "
            "step behind with the loss at p itself; with a polynomial, "
            f"{truth.round(4)} comes out, not {found.round(4)}"
        ),
    )


@exercise("a step, two numbers", 2, either_sign=True)
def fooling_step(rng: np.random.Generator) -> Question:
    """The longest step `[2]` after which a parabola is a share above its lowest loss.

    Given are second derivatives `[2, 2]`, the lowest loss and the share. Either of the
    two opposite steps is right.
    """
    angle = rng.uniform(0.3, 1.2) + rng.choice([0, np.pi / 2])  # [rad]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    hessian = turn @ np.diag(rng.uniform((0.05, 1.0), (0.3, 3.0))) @ turn.T
    lowest = rng.uniform(0.1, 0.5)
    share = rng.uniform(0.02, 0.2)
    curvatures, axes = np.linalg.eigh(hessian)
    flat = axes[:, 0]
    length = np.sqrt(2 * share * lowest / curvatures[0])
    short = np.sqrt(2 * share * lowest / curvatures[1])
    slips = {
        "that is the shortest such step: it goes along the steep direction": short
        * axes[:, 1],
        "the parabola is half of the curvature times the step squared": length
        / np.sqrt(2)
        * flat,
        "the loss grows with the square of the step: take the root": length**2 * flat,
        "that is the direction; how far?": flat,
        "the share is one of the lowest loss: multiply by it": length
        / np.sqrt(lowest)
        * flat,
        "the direction is that of the smallest curvature, the length is of the "
        "largest": short * flat,
    }

    def otherwise(found: np.ndarray) -> str:
        rise = 0.5 * found @ hessian @ found / lowest
        if np.isclose(rise, share, rtol=1e-4):
            return (
                "the loss after this step is right, but another direction goes farther"
            )
        return (
            f"after this step the loss is {rise:.4g} of the lowest above it, and "
            f"{share:.4g} is asked for"
        )

    return Question((hessian, lowest, share), length * flat, slips, otherwise)


def _loss_and_place(
    rng: np.random.Generator,
) -> tuple[Callable[[np.ndarray], float], np.ndarray]:
    """A loss without symmetry, and a place off its bottom `[2]`."""
    a, b, c, d, e = rng.uniform((2.0, 0.5, 0.3, 1.0, 0.8), (4.0, 1.5, 0.7, 3.0, 1.2))

    def loss_at(q: np.ndarray) -> float:
        x, y = np.asarray(q, dtype=float)
        return a * x**2 + b * x * y + c * y**2 + d * x + e * x**3 + e * y**3

    return loss_at, np.array([rng.uniform(0.3, 0.7), rng.uniform(-1.2, -0.8)])
