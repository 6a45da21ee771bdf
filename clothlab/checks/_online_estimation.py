"""Checks of notebook 06."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch

from clothlab.checks._check import apart, array, check, drawn, expect, number
from clothlab.method.data import Run

Loss = Callable[[np.ndarray], float]


class _NudgeCase(NamedTuple):
    loss_at: Loss
    p: np.ndarray  # [2]
    nudge: float


@check(array("a slope along each of the two axes", 2))
def gradient_by_nudges(answer: Callable, rng: np.random.Generator) -> None:
    """The gradient `[2]` of a loss by central differences.

    Given are a loss of p, a place p `[2]` and a nudge ε so large that forward
    differences are seen to differ.
    """
    for _ in range(2):
        case = drawn(
            lambda: _NudgeCase(*_loss_and_place(rng), rng.uniform(0.15, 0.4)),
            lambda case: apart(*_slopes(case)),
        )
        truth, slips = _slopes(case)
        found = answer(case.loss_at, case.p.copy(), case.nudge)
        otherwise = (
            f"a polynomial has the slopes {truth.round(4)}, not {found.round(4)}"
        )
        expect(found, truth, otherwise, slips)


def _slopes(case: _NudgeCase) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The central differences [2], and what usual slips give, by what is said."""
    loss_at, p, nudge = case
    axes = np.eye(2)
    here = loss_at(p)
    ahead = np.array([loss_at(p + nudge * axis) for axis in axes])
    behind = np.array([loss_at(p - nudge * axis) for axis in axes])

    truth = (ahead - behind) / (2 * nudge)
    not_divided = ahead - behind
    return truth, {
        "the two places are 2 ε apart: divide by that": truth * 2,
        "divide the difference of the loss by the distance of the two "
        "places": not_divided,
        "nudge p both ways, not forwards alone": (ahead - here) / nudge,
        "the sign is wrong: ahead minus behind": -truth,
    }


@check(number("a step, one number"))
def best_step(answer: Callable, rng: np.random.Generator) -> None:
    """The step that makes the sum of squares of e - J step smallest.

    Given are random residuals and slopes `[T, D_s]`, then a single one of each.
    """
    for shape in ((6, 3), (1,)):
        # Residuals and slopes, and the step of least squares
        J = rng.uniform(0.5, 2.0, shape) * rng.choice([-1, 1], shape)
        e = rng.normal(0.5, 1.0, shape)
        truth = np.sum(J * e) / np.sum(J**2)
        left = np.sum((e - J * truth) ** 2)

        # With one residual, slips give the right step, too
        found = answer(e.copy(), J.copy())
        slips = _wrong_steps(e, J) if e.size > 1 else {}
        otherwise = (
            f"after this step the misses have the sum of squares "
            f"{np.sum((e - J * found) ** 2):.4g}; {left:.4g} is possible"
        )
        expect(found, truth, otherwise, slips)


def _wrong_steps(e: np.ndarray, J: np.ndarray) -> dict[str, float]:
    """What usual slips give in place of the step, by what is said of each."""
    truth = np.sum(J * e) / np.sum(J**2)
    return {
        "the step goes the wrong way: where J and e have one sign, x grows": -truth,
        "divide by the sum of the squared slopes": np.sum(J * e),
        "this is the mean of all wishes e / J: a large slope knows better": np.mean(
            e / J
        ),
        "this sums up e and J first: misses of both signs cancel": np.sum(e)
        / np.sum(J),
        "this is one over it": 1 / truth,
    }


@check(array("a step of p", 2))
def bare_step(answer: Callable, rng: np.random.Generator) -> None:
    """The step `[2]` of p that makes the sum of squares of e - J step smallest.

    Given are twelve residuals `[12]` and their slopes `[12, 2]` by the numbers of p.
    """

    def draw() -> tuple[np.ndarray, np.ndarray]:
        J = rng.normal(size=(12, 2)) @ np.array([[1.0, 0.6], [0.0, 0.5]])
        return rng.normal(0.5, 1.0, 12), J

    e, J = drawn(draw, lambda case: apart(*_two_number_steps(*case), rtol=0.02))
    truth, slips = _two_number_steps(e, J)
    found = answer(e.copy(), J.copy())
    otherwise = (
        f"after this step the misses have the sum of squares "
        f"{np.sum((e - J @ found) ** 2):.4g}; {np.sum((e - J @ truth) ** 2):.4g} is "
        "possible"
    )
    expect(found, truth, otherwise, slips)


def _two_number_steps(
    e: np.ndarray, J: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The step, and what usual slips give, by what is said of each."""
    curved = J.T @ J
    downhill = J.T @ e
    truth = np.linalg.solve(curved, downhill)
    return truth, {
        "the step goes the wrong way": -truth,
        "this is the downhill direction alone: solve the two equations": downhill,
        "each number has its own step here, as if the other stood still: what one "
        "does to a prediction, the other may undo": downhill / np.diag(curved),
        "the matrix stands on the other side of its equation": curved @ downhill,
    }


class _LoopCase(NamedTuple):
    s: np.ndarray  # states [T, 2], single precision
    u: np.ndarray  # commands [T, 2], single precision
    rate: float
    momentum: float
    window: int
    warmup: int


def _toy_loss(
    s: torch.Tensor, u: torch.Tensor, p: torch.Tensor, warmup: int = 0
) -> torch.Tensor:
    """Loss of a model in which a state moves by p times the command."""
    error = s[:-1] + p * u[:-1] - s[1:]
    return error[warmup:].square().mean()


@check(array("p after each step", 30, 2))
def online(answer: Callable, rng: np.random.Generator) -> None:
    """The p `[30, 2]` of momentum SGD on the loss over a sliding window, from zero.

    Given are a run of 30 steps, the loss of states, commands, p and warm-up, the rate,
    the momentum, the window and the warm-up.
    """
    for _ in range(2):
        # A run, and the settings of a loop over it
        u = rng.uniform(-2, 2, (30, 2)).astype(np.float32)
        s = rng.normal(size=(30, 2)).astype(np.float32)
        case = _LoopCase(
            s,
            u,
            rng.uniform(0.02, 0.06),
            rng.uniform(0.5, 0.8),
            12,
            int(rng.integers(3, 6)),
        )

        # The reader's loop, and those with a slip
        found = answer(Run(s, u, "any"), _toy_loss, *case[2:])
        slips = {
            "p stays where it was: let it move": np.zeros((30, 2)),
            "the buffer keeps a share of the old gradients: the momentum": _loop(
                case._replace(momentum=0.0)
            ),
            "p moves by the rate times the buffer, down and not up": _loop(
                case._replace(rate=-case.rate)
            ),
            "the loss is that of the window alone, from its first step on": _loop(
                case._replace(window=30)
            ),
            "the loss counts all predictions: hand the warm-up on to it": _loop(
                case, ignored=0
            ),
        }
        otherwise = "p differs from that of momentum SGD on the loss over the window"
        expect(found, _loop(case), otherwise, slips, rtol=1e-3, atol=1e-5)


def _loop(case: _LoopCase, ignored: int | None = None) -> np.ndarray:
    """The p after each step `[T, 2]`, by the slope of a parabola.

    The loss ignores as many predictions as the warm-up says, or another number.
    """
    s = case.s.astype(float)
    u = case.u.astype(float)
    p = np.zeros(2)
    b = np.zeros(2)
    path = []
    for t in range(len(s)):
        # The loss covers what was known at t, and moves only after the real window
        first = max(0, t - case.window)
        since = first + (case.warmup if ignored is None else ignored)
        if t > first + case.warmup:
            error = s[since:t] + p * u[since:t] - s[since + 1 : t + 1]
            b = case.momentum * b + (2 * error * u[since:t]).sum(axis=0) / error.size
            p = p - case.rate * b
        path.append(p)
    return np.array(path)


@check(number("a rate, one number"))
def largest_rate(answer: Callable, rng: np.random.Generator) -> None:
    """The largest rate with which momentum SGD on a parabola does not diverge.

    Given are a curvature and a momentum; without a momentum, it is 2 over the
    curvature.
    """
    for momentum in (rng.uniform(0.3, 0.6), rng.uniform(0.75, 0.95), 0.0):
        curvature = rng.uniform(0.05, 5.0)
        truth, slips = _rates(curvature, momentum)
        found = answer(curvature, momentum)
        grown = _grown(curvature, momentum, found)
        otherwise = (
            f"curvature {curvature:.3g}, momentum {momentum:.3g}: {found:.4g} is not "
            f"the limit; x grows by {grown:.3g} a step there, at the limit by 1"
        )
        if momentum == 0:
            slips = {}
        expect(found, truth, otherwise, slips)


def _grown(curvature: float, momentum: float, rate: float) -> float:
    """By what x grows in each step, in the long run: the largest eigenvalue."""
    step = np.array([[1 - rate * curvature, -rate * momentum], [curvature, momentum]])
    return float(np.abs(np.linalg.eigvals(step)).max())


def _rates(curvature: float, momentum: float) -> tuple[float, dict[str, float]]:
    """The limit, and what usual slips give, by what is said of them."""
    truth = 2 * (1 + momentum) / curvature
    return truth, {
        "that is the limit without momentum; the buffer changes it": 2 / curvature,
        "momentum allows a larger rate, not a smaller one: check the sign of its "
        "eigenvalue": 2 * (1 - momentum) / curvature,
        "that is the rate at which one step goes to the bottom, not the limit": 1
        / curvature,
        "half of the limit: the step may overshoot as far as it came": truth / 2,
        "the curvature is a stiffness, not its square": truth / curvature,
        "the full pace rate / (1 - momentum) is not what must be below 2 / curvature": 2
        / (curvature * (1 - momentum)),
        "a steeper parabola needs a smaller rate": 2 * (1 + momentum) * curvature,
    }


class _CurvatureCase(NamedTuple):
    loss_at: Loss
    p: np.ndarray  # [2]
    axes: np.ndarray  # [K, 2], of length 1
    epsilon: float


@check(array("a second derivative along each of the axes", 3))
def curvature(answer: Callable, rng: np.random.Generator) -> None:
    """The second derivatives `[3]` of a loss along three axes.

    Given are a loss of p, a place off its bottom `[2]`, axes of length 1 `[3, 2]`, one
    of them slanted, and the length of a step ε.
    """
    for _ in range(2):
        case = drawn(
            lambda: _curvature_case(rng), lambda case: apart(*_curvatures(case))
        )
        truth, slips = _curvatures(case)
        found = answer(case.loss_at, case.p.copy(), case.axes.copy(), case.epsilon)
        otherwise = (
            "that is not how the slope changes: compare the loss a step ahead and a "
            "step behind with the loss at p itself; with a polynomial, "
            f"{truth.round(4)} comes out, not {found.round(4)}"
        )
        expect(found, truth, otherwise, slips)


def _curvature_case(rng: np.random.Generator) -> _CurvatureCase:
    angle = rng.uniform(0.5, 1.1)  # [rad]
    axes = np.array([[1.0, 0.0], [0.0, 1.0], [np.cos(angle), np.sin(angle)]])
    loss_at, p = _loss_and_place(rng)
    return _CurvatureCase(loss_at, p, axes, rng.uniform(0.1, 0.5))


def _curvatures(case: _CurvatureCase) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The second derivatives [K], and what usual slips give, by what is said."""
    # The loss at p, and a step ahead and behind along each axis
    loss_at, p, axes, epsilon = case
    here = loss_at(p)
    ahead = np.array([loss_at(p + epsilon * axis) for axis in axes])
    behind = np.array([loss_at(p - epsilon * axis) for axis in axes])

    # The truth, and other ways to put the three together
    truth = (ahead - 2 * here + behind) / epsilon**2
    slope = (ahead - behind) / (2 * epsilon)
    one_sided = (ahead - here) / epsilon**2
    return truth, {
        "a curvature is divided by the square of the step: what is yours divided "
        "by?": truth * epsilon,
        "it is not divided by anything: a curvature is divided by the square of the "
        "step": truth * epsilon**2,
        "the two places are 2 ε apart, but each step is ε: divide by ε², not by "
        "(2 ε)²": truth / 4,
        "that is half of it: a parabola's factor is half of its second "
        "derivative": truth / 2,
        "the loss at p itself counts twice": truth + here / epsilon**2,
        "the loss at p itself is subtracted, not added": truth + 4 * here / epsilon**2,
        "that is the slope along the axis; asked is how the slope changes": slope,
        "that is a change of the loss to one side only: take a step ahead and a step "
        "behind": one_sided,
        "the sign is wrong: where the loss rises to both sides, the curvature is "
        "positive": -truth,
    }


class _FoolingCase(NamedTuple):
    hessian: np.ndarray  # [2, 2]
    lowest_loss: float
    share: float


@check(array("a step, two numbers", 2))
def fooling_step(answer: Callable, rng: np.random.Generator) -> None:
    """The longest step `[2]` after which a parabola is a share above its lowest loss.

    Given are second derivatives `[2, 2]`, the lowest loss and the share. Either of the
    two opposite steps is right.
    """
    for _ in range(3):
        case = drawn(
            lambda: _fooling_case(rng), lambda case: apart(*_fooling_steps(case))
        )
        truth, slips = _fooling_steps(case)
        found = answer(case.hessian.copy(), case.lowest_loss, case.share)
        slips |= {message: _towards(found, slip) for message, slip in slips.items()}
        rise = 0.5 * found @ case.hessian @ found / case.lowest_loss
        otherwise = (
            f"after this step the loss is {rise:.4g} of the lowest above it, and "
            f"{case.share:.4g} is asked for"
        )
        if np.isclose(rise, case.share, rtol=1e-4):
            otherwise = (
                "the loss after this step is right, but another direction goes farther"
            )
        expect(found, _towards(found, truth), otherwise, slips)


def _towards(found: np.ndarray, step: np.ndarray) -> np.ndarray:
    """That of a step and its opposite which is nearer to what was found."""
    return step if found @ step >= 0 else -step


def _fooling_case(rng: np.random.Generator) -> _FoolingCase:
    angle = rng.uniform(0.3, 1.2) + rng.choice([0, np.pi / 2])  # [rad]
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    hessian = axes @ np.diag(rng.uniform((0.05, 1.0), (0.3, 3.0))) @ axes.T
    return _FoolingCase(hessian, rng.uniform(0.1, 0.5), rng.uniform(0.02, 0.2))


def _fooling_steps(case: _FoolingCase) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The step, and what usual slips give, by what is said of them."""
    curvatures, axes = np.linalg.eigh(case.hessian)
    flat = axes[:, 0]
    rise = case.share * case.lowest_loss
    length = np.sqrt(2 * rise / curvatures[0])
    steep = np.sqrt(2 * rise / curvatures[1]) * axes[:, 1]
    return length * flat, {
        "that is the shortest such step: it goes along the steep direction": steep,
        "the parabola is half of the curvature times the step squared": length
        / np.sqrt(2)
        * flat,
        "the loss grows with the square of the step: take the root": length**2 * flat,
        "that is the direction; how far?": flat,
        "the share is one of the lowest loss: multiply by it": length
        / np.sqrt(case.lowest_loss)
        * flat,
        "the direction is that of the smallest curvature, the length is of the "
        "largest": np.linalg.norm(steep) * flat,
    }


def _loss_and_place(rng: np.random.Generator) -> tuple[Loss, np.ndarray]:
    """A loss without symmetry, and a place off its bottom `[2]`.

    A central difference finds the curvature of the loss exactly.
    """
    least = (2.0, 0.5, 0.3, 1.0, 0.8)
    most = (4.0, 1.5, 0.7, 3.0, 1.2)
    a, b, c, d, e = rng.uniform(least, most)

    def loss_at(q: np.ndarray) -> float:
        x, y = np.asarray(q, dtype=float)
        return a * x**2 + b * x * y + c * y**2 + d * x + e * x**3 + e * y**3

    return loss_at, np.array([rng.uniform(0.3, 0.7), rng.uniform(-1.2, -0.8)])
