"""Checks of notebook 02: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("a stiffness in N m/rad at each angle", 6)
def pair_stiffness(rng: np.random.Generator) -> Question:
    """The stiffness `[6]` of a turned joint between a flexor and an extensor [N m/rad].

    Given are both coefficients of a spring, the lever of a muscle r [m], the stretch e0
    [m] of both springs of the straight joint, and its angles [rad]: straight, turned
    either way, and so far that one muscle is slack.
    """
    k1 = rng.uniform(300.0, 3000.0)  # [N/m]
    k3 = rng.uniform(4e6, 1e7)  # [N/m³]
    r = rng.uniform(0.025, 0.06)
    e0 = rng.uniform(0.01, 0.02)
    # Beyond e0 / r one is slack
    shares = np.array([0.0, 0.3, 0.6, -0.6, 1.4, -1.4])
    theta = shares * e0 / r * rng.uniform(0.9, 1.1, 6)

    e = np.array([e0 + r * theta, e0 - r * theta])
    taut = e > 0
    slopes = k1 + 3 * k3 * e**2
    secants = k1 + k3 * e**2
    each = r**2 * slopes * taut
    truth = each.sum(axis=0)
    slips = {
        "stiffness is -dτ/dθ: a positive number": -truth,
        "half of it: there are two muscles": truth / 2,
        "that is the flexor alone: the extensor's spring gives way, too": each[0],
        "r enters twice: in the stretch and as the lever": truth / r,
        "a slack spring has no stiffness": r**2 * slopes.sum(axis=0),
        "that is the stiffness of the straight joint: where does theta enter?": (
            np.full(6, 2 * r**2 * (k1 + 3 * k3 * e0**2))
        ),
        "stiffness is df/de, not f/e": (r**2 * secants * taut).sum(axis=0),
    }
    return Question(
        (k1, k3, r, e0, theta),
        truth,
        slips,
        lambda found: (
            f"turned by {theta.round(2)} rad from a stretch of {1000 * e0:.1f} mm with "
            f"r = {1000 * r:.0f} mm, the torque's slope is {truth.round(2)} N m/rad, "
            f"yours is {found.round(2)}"
        ),
    )
