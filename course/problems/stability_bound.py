"""The longest step: a model solution, and its reference values.

Of the half page: the motion in which neighbours move against each other explodes first,
since each spring is then stretched by both of its ends, and a mass feels four times the
stiffness of one spring. So the bound falls from 2 / ω of one mass towards half of it,
and never to zero, however long the chain. A damper shortens the step: its force is that
of the speed before, too late by a step, and pushes too far.
"""

from collections.abc import Callable, Iterator

import numpy as np


def longest_step(
    count: int, stiffness: float, damping: float, mass: float
) -> np.ndarray:
    """The longest stable time step [s] of the chain."""
    # How springs couple masses: 2 on the diagonal, 1 for the free end
    coupling = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    coupling[-1, -1] = 1
    stiffest = np.linalg.eigvalsh(coupling).max()

    # Its block has the eigenvalues' sum 2 - a - b and product 1 - b, with
    # a = k dt² / m and b = c dt / m: both stay within the circle while a + 2 b < 4
    a = stiffest * stiffness / mass
    b = stiffest * damping / mass
    return (-b + np.sqrt(b**2 + 4 * a)) / a


def parts(
    answer: Callable, seed: int = 0
) -> Iterator[tuple[int, str, Callable[[], bool]]]:
    """Points, words and condition of each part."""
    rng = np.random.default_rng(seed)

    def right(count: int, damping: float) -> bool:
        stiffness = rng.uniform(60, 140)
        mass = rng.uniform(0.005, 0.02)
        found = float(answer(count, stiffness, damping, mass))
        truth = _by_bisection(count, stiffness, damping, mass)
        return bool(np.isclose(found, truth, rtol=2e-3))

    def without(counts: list[int]) -> Callable[[], bool]:
        return lambda: all(right(count, 0.0) for count in counts)

    yield 2, "one mass without damper", without([1, 1])
    yield 2, "chains without damper", without([2, 7, 30])
    yield 2, "chains with dampers", lambda: all(right(n, 0.3) for n in (1, 5, 20))


def _by_bisection(count: int, stiffness: float, damping: float, mass: float) -> float:
    """The longest step whose matrix has no eigenvalue beyond the circle."""
    coupling = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    coupling[-1, -1] = 1

    def stable(dt: float) -> bool:
        x = np.eye(2 * count)[:count]
        v = np.eye(2 * count)[count:]
        v = v - dt / mass * coupling @ (stiffness * x + damping * v)
        step = np.vstack([x + dt * v, v])
        return bool(np.abs(np.linalg.eigvals(step)).max() < 1 + 1e-7)

    low = 0.0
    high = 3 * np.sqrt(mass / stiffness)
    for _ in range(40):
        middle = (low + high) / 2
        if stable(middle):
            low = middle
        else:
            high = middle
    return low
