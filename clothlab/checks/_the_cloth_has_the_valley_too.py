"""Check of appendix A4: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("one change of z", 3)
def together(rng: np.random.Generator) -> Question:
    """What two changes of a plan do beyond the sum of each alone, `[3]`.

    Given are a function z of a plan `[8, 2]`, the plan, and the two changes.
    """
    weights = rng.normal(size=(3, 16))
    bends = rng.uniform(0.5, 1.5, size=3)

    def z(plan: np.ndarray) -> np.ndarray:
        sums = weights @ np.asarray(plan).ravel()
        return sums + bends * sums**2

    u = rng.normal(size=(8, 2))
    a = np.zeros((8, 2))
    b = np.zeros((8, 2))
    a[2] = rng.uniform(0.5, 1.5, 2)
    b[7] = rng.uniform(0.5, 1.5, 2)
    of_a = z(u + a) - z(u)
    of_b = z(u + b) - z(u)
    both = z(u + a + b) - z(u)
    truth = both - of_a - of_b
    slips = {
        "this is all that both do; take away what each does alone": both,
        "this is what the second does after the first; take away what it does "
        "alone": both - of_a,
        "this is what the first does after the second; take away what it does "
        "alone": both - of_b,
        "z(u) is taken away once too often or too seldom: each change is one from "
        "z(u)": z(u + a + b) - z(u + a) - z(u + b),
        "the sign is turned round": -truth,
    }
    return Question(
        (z, u, a, b), truth, slips, "change a alone, b alone, and both; then compare"
    )
