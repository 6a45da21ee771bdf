"""Checks of appendix A1: what is drawn, what is right, and what usual slips give."""

from collections.abc import Callable

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a time step in s")
def explicit_step(rng: np.random.Generator) -> Question:
    """The longest step [s] at which explicit Euler lets a damped swing not grow.

    Given are a spring k [N/m], the mass m [kg] of the point at its end, and a damper d
    [N s/m] so weak that the point swings.
    """
    k = rng.uniform(50.0, 200.0)
    m = rng.uniform(0.003, 0.02)
    d = rng.uniform(0.1, 0.25) * np.sqrt(k * m)
    truth = d / k
    slips = {
        "at that step the velocity alone would decay; the spring lets it grow before": 2
        * m
        / d,
        "that is the bound without a damper, and of semi-implicit Euler": 2
        * np.sqrt(m / k),
        "at half of it the swing still shrinks: when is the determinant 1?": truth / 2,
        "at twice of it the swing grows: when is the determinant 1?": 2 * truth,
    }

    def otherwise(dt: float) -> str:
        step = np.array([[1.0, dt], [-k * dt / m, 1.0 - d * dt / m]])
        size = np.abs(np.linalg.eigvals(step)).max()
        return (
            "the longest step is another: with yours the swing is multiplied by "
            f"{size:.4f} in each step, and with the longest by 1"
        )

    return Question((k, m, d), truth, slips, otherwise)


@exercise("a time step in s")
def stable_step(rng: np.random.Generator) -> Question:
    """The longest stable step [s] of semi-implicit Euler for two points and a spring.

    Given are the spring k [N/m] and the mass m [kg] of each point, both free.
    """
    k = rng.uniform(50.0, 200.0)
    m = rng.uniform(0.003, 0.02)
    omega = np.sqrt(2 * k / m)
    slips = {
        "that is the step of one point on a wall: here both ends of the spring move": 2
        * np.sqrt(m / k),
        "a heavier pair would swing slower; does the spring feel the sum of both "
        "masses, or does each point go half of the way?": 2 * np.sqrt(2 * m / k),
        "that is 1 / ω: the trace is at least -2, which allows more": 1 / omega,
        "that is a whole period: it flies apart before": 2 * np.pi / omega,
        "the trace is 2 - ω² dt²: did you forget a root?": 4 / omega**2,
    }
    return Question(
        (k, m),
        2 / omega,
        slips,
        lambda dt: (
            f"with k = {k:.1f} N/m and m = {m:.4f} kg the longest step is not "
            f"{dt:.5f} s"
        ),
    )


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


def _loss_and_place(
    rng: np.random.Generator,
) -> tuple[Callable[[np.ndarray], float], np.ndarray]:
    """A loss without symmetry, and a place off its bottom `[2]`."""
    a, b, c, d, e = rng.uniform((2.0, 0.5, 0.3, 1.0, 0.8), (4.0, 1.5, 0.7, 3.0, 1.2))

    def loss_at(q: np.ndarray) -> float:
        x, y = np.asarray(q, dtype=float)
        return a * x**2 + b * x * y + c * y**2 + d * x + e * x**3 + e * y**3

    return loss_at, np.array([rng.uniform(0.3, 0.7), rng.uniform(-1.2, -0.8)])
