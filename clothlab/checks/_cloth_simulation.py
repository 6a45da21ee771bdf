"""Checks of notebook 01."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from clothlab.checks._check import array, check, expect, number
from clothlab.simulation.cloth import Cloth, get_cloth, hanging_points
from clothlab.simulation.cloth_elements import springs

_CLOTH = get_cloth("damp0.05-mass0.10")  # in the middle of the trained ones


@check(array("three numbers, structural, shear and bending", 3))
def count_springs(answer: Callable, rng: np.random.Generator) -> None:
    """How many springs of each kind a cloth has.

    Given are the rows and columns of four cloths; expected is what clothlab itself puts
    into them.
    """
    for _ in range(4):
        rows = int(rng.integers(4, 10))
        columns = int(rng.integers(3, 8))
        found = answer(rows, columns)

        # The truth, and each kind's usual slip
        truth = _springs_of_each_kind(rows, columns)
        held = "the first row is held: no spring lies within it"
        slips = {
            "structural": (held, truth["structural"] + columns - 1),
            "shear": (
                "each square of four points has two diagonals",
                truth["shear"] / 2,
            ),
            "bending": (held, truth["bending"] + columns - 2),
        }

        # The right numbers in the wrong places, then kind by kind
        right = list(truth.values())
        ordered = np.array_equal(sorted(found), sorted(right))
        assert not ordered or np.array_equal(found, right), (
            "these are the right numbers in another order: structural, shear, bending"
        )
        for (kind, wanted), count in zip(truth.items(), found, strict=True):
            otherwise = (
                f"{rows} × {columns} points have {wanted} {kind} springs, not {count:g}"
            )
            advice, slip = slips[kind]
            expect(count, wanted, otherwise, {f"{otherwise}; {advice}": slip})


def _springs_of_each_kind(rows: int, columns: int) -> dict[str, int]:
    """Springs of a cloth whose first row is held, so that none lies within that row."""
    cloth = Cloth("any", rows=rows, columns=columns)
    total = len(list(springs(cloth)))
    structural = (rows - 1) * (2 * columns - 1)
    shear = 2 * (rows - 1) * (columns - 1)
    return {
        "structural": structural,
        "shear": shear,
        "bending": total - structural - shear,
    }


@check(number("a time step in s"))
def explicit_step(answer: Callable, rng: np.random.Generator) -> None:
    """The longest step [s] at which explicit Euler lets a damped swing not grow.

    Given are a spring k [N/m], the mass m [kg] of the point at its end, and a damper d
    [N s/m] so weak that the point swings.
    """
    for _ in range(3):
        k = rng.uniform(50.0, 200.0)
        m = rng.uniform(0.003, 0.02)
        d = rng.uniform(0.1, 0.25) * np.sqrt(k * m)
        dt = answer(k, m, d)

        # The truth by eigenvalues, below and above
        truth = d / k
        slips = {
            "at that step the velocity alone would decay; the spring lets it grow "
            "before": 2 * m / d,
            "that is the bound without a damper, and of semi-implicit Euler": 2
            * np.sqrt(m / k),
            "at half of it the swing still shrinks: when is the determinant 1?": truth
            / 2,
            "at twice of it the swing grows: when is the determinant 1?": 2 * truth,
        }
        size = _explicit_size(k, m, d, dt)
        otherwise = (
            f"the longest step is another: with yours the swing is multiplied by "
            f"{size:.4f} in each step, and with the longest by 1"
        )
        expect(dt, truth, otherwise, slips)


def _explicit_size(k: float, m: float, d: float, dt: float) -> float:
    """By how much a step of explicit Euler multiplies a damped swing at most."""
    step = np.array([[1.0, dt], [-k * dt / m, 1.0 - d * dt / m]])
    return float(np.abs(np.linalg.eigvals(step)).max())


@check(number("a time step in s"))
def stable_step(answer: Callable, rng: np.random.Generator) -> None:
    """The longest stable step [s] of semi-implicit Euler for two points and a spring.

    Given are the spring k [N/m] and the mass m [kg] of each point, both free.
    """
    for _ in range(3):
        k = rng.uniform(50.0, 200.0)
        m = rng.uniform(0.003, 0.02)
        dt = answer(k, m)

        # Of the two points, and what is easily taken for it
        omega = np.sqrt(2 * k / m)
        slips = {
            "that is the step of one point on a wall: here both ends of the spring "
            "move": 2 * np.sqrt(m / k),
            "a heavier pair would swing slower; does the spring feel the sum of both "
            "masses, or does each point go half of the way?": 2 * np.sqrt(2 * m / k),
            "that is 1 / ω: the trace is at least -2, which allows more": 1 / omega,
            "that is a whole period: it flies apart before": 2 * np.pi / omega,
            "the trace is 2 - ω² dt²: did you forget a root?": 4 / omega**2,
        }
        otherwise = (
            f"with k = {k:.1f} N/m and m = {m:.4f} kg the longest step is not "
            f"{dt:.5f} s"
        )
        expect(dt, 2 / omega, otherwise, slips)


@check(number("an energy in J"))
def cloth_energy(answer: Callable, rng: np.random.Generator) -> None:
    """The energy [J] of a cloth: of motion, of height and of its springs.

    Given are a cloth of 6 × 3 points with a mass and springs of its own, and positions
    [m] and velocities [m/s] of its points, the first row at rest in the hand.
    """
    for _ in range(2):
        cloth = replace(
            _CLOTH,
            mass=rng.uniform(0.05, 0.3),
            stiffness=rng.uniform(50.0, 150.0),
            bending=rng.uniform(20.0, 40.0),
        )
        x = hanging_points(cloth)
        v = np.zeros_like(x)
        x[1:] += 0.02 * rng.normal(size=x[1:].shape)
        v[1:] = rng.normal(size=v[1:].shape)
        found = answer(cloth, x, v)

        # The parts, and what is easily made of them
        motion = cloth.point_mass * (v**2).sum() / 2
        height = cloth.point_mass * 9.81 * x[..., 2].sum()
        stretch = _spring_energy(cloth, x)
        soft = _spring_energy(replace(cloth, bending=cloth.stiffness), x)
        truth = motion + height + stretch
        slips = {
            "energy of motion is m v² / 2": truth + motion,
            "energy of a spring is k (stretch)² / 2": truth + stretch,
            "what is higher has more energy: mind the sign of the height": truth
            - 2 * height,
            "the height does not count yet": truth - height,
            "bending springs have a stiffness of their own, cloth.bending": truth
            - stretch
            + soft,
            "each point has the mass cloth.point_mass, not that of all": 18
            * (motion + height)
            + stretch,
        }
        otherwise = (
            f"motion {motion:.4f} J, height {height:.4f} J and springs {stretch:.4f} J "
            f"make {truth:.4f} J, not {found:.4f} J"
        )
        expect(found, truth, otherwise, slips)


def _spring_energy(cloth: Cloth, x: np.ndarray) -> float:
    """Energy [J] of all springs of a cloth whose points are at `x` `[6, 3, 3]` [m]."""
    start = hanging_points(cloth)
    energy = 0.0
    for *ends, stiffness in springs(cloth):
        a, b = (tuple(map(int, name.split("_")[1:])) for name in ends)
        rest = np.linalg.norm(start[b] - start[a])
        stretch = np.linalg.norm(x[b] - x[a]) - rest
        energy += stiffness * float(stretch) ** 2 / 2
    return energy


@check(array("a speed for each time", 5))
def falling_speed(answer: Callable, rng: np.random.Generator) -> None:
    """How fast a point falls, at five times after it was dropped [m/s].

    Given are its mass [kg], its drag [N s/m], and the times [s].
    """
    for _ in range(3):
        m = rng.uniform(0.002, 0.01)
        c = rng.uniform(0.02, 0.08)
        t = np.array([0.0, 0.2, 0.5, 1.0, 2.0]) * m / c * rng.uniform(0.8, 1.2)
        found = answer(m, c, t)

        # The truth, and what is easily taken for it
        terminal = m * 9.81 / c
        truth = terminal * (1 - np.exp(-t * c / m))
        slips = {
            "that is a fall without air": 9.81 * t,
            "that is the terminal speed at all times: at time 0 the point is at "
            "rest": np.full(5, terminal),
            "that decays from the terminal speed: it must grow towards it": terminal
            - truth,
            "the speed is right but for its sign: it is positive downwards": -truth,
            "the exponent has m and c the wrong way round: with more drag, the "
            "terminal speed is reached sooner": terminal * (1 - np.exp(-t * m / c)),
        }
        slope = (found[1] - found[0]) / (t[1] - t[0])
        otherwise = (
            f"the terminal speed should be {terminal:.3f} m/s; yours goes from "
            f"{found[0]:.3f} to {found[-1]:.3f} m/s, and gains {slope:.1f} m/s² "
            "at first"
        )
        expect(found, truth, otherwise, slips)
