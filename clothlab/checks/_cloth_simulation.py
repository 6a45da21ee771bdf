"""Checks of notebook 01: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a speed for each time", 5)
def falling_speed(rng: np.random.Generator) -> Question:
    """How fast a point falls, at five times after it was dropped [m/s].

    Given are its mass [kg], its drag [N s/m], and the times [s].
    """
    m = rng.uniform(0.002, 0.01)
    c = rng.uniform(0.02, 0.08)
    t = np.array([0.0, 0.2, 0.5, 1.0, 2.0]) * m / c * rng.uniform(0.8, 1.2)
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

    def otherwise(found: np.ndarray) -> str:
        slope = (found[1] - found[0]) / (t[1] - t[0])
        return (
            f"the terminal speed should be {terminal:.3f} m/s; yours goes from "
            f"{found[0]:.3f} to {found[-1]:.3f} m/s, and gains {slope:.1f} m/s² "
            "at first"
        )

    return Question((m, c, t), truth, slips, otherwise)
