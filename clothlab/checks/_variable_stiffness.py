"""Checks of notebook 02: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a stiffness in N m/rad for each stretch", 4)
def pair_stiffness(rng: np.random.Generator) -> Question:
    """The stiffnesses `[4]` of a joint between a flexor and an extensor [N m/rad].

    Given are both coefficients of a spring, the lever of a muscle r [m], and stretches
    of both springs `[4]` [m].
    """
    k1 = rng.uniform(300.0, 3000.0)  # [N/m]
    k3 = rng.uniform(4e6, 1e7)  # [N/m³]
    r = rng.uniform(0.025, 0.06)
    e0 = rng.uniform(0.01, 0.02, 4)
    slope = k1 + 3 * k3 * e0**2
    truth = 2 * r**2 * slope
    slips = {
        "stiffness is -dτ/dθ: a positive number": -truth,
        "half of it: there are two muscles": truth / 2,
        "r enters twice: in the stretch and as the lever": truth / r,
        "stiffness is df/de, not f/e": 2 * r**2 * (k1 + k3 * e0**2),
        "the slope of e³ is 3 e²": 2 * r**2 * (k1 + k3 * e0**3),
    }
    return Question(
        (k1, k3, r, e0),
        truth,
        slips,
        lambda found: (
            f"stretched by {(1000 * e0).round(1)} mm with r = {1000 * r:.0f} mm, the "
            f"torque's slope is {truth.round(2)} N m/rad, yours is {found.round(2)}"
        ),
    )
