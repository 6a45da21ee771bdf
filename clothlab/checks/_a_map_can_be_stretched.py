"""Checks of appendix A3: what is drawn, what is right, and what usual slips give."""

import numpy as np

from clothlab.checks.ask import Question, exercise


@exercise("the new weights", 5, 2)
def same_predictions(rng: np.random.Generator) -> Question:
    """Weights `[5, 2]` with which A p has the effect that p had with the old ones.

    Given are the old weights and a random A.
    """
    weights = rng.normal(size=(5, 2))
    A = 1.5 * np.eye(2) + rng.uniform(-0.6, 0.6, (2, 2))
    inverse = np.linalg.inv(A)
    slips = {
        "the weights must undo A, not do it again": weights @ A,
        "the weights are to be changed, too": weights,
        "the inverse of A is transposed here": weights @ inverse.T,
        "the transpose of A is no inverse": weights @ A.T,
    }
    return Question(
        (weights, A),
        weights @ inverse,
        slips,
        "your weights times A p are not the old weights times p",
    )


@exercise("a number of steps for each cell", 4, rtol=1e-4)
def cell_half_life(rng: np.random.Generator) -> Question:
    """Steps until half of each cell is left `[4]`, from gates `[20, 4]` of 20 steps.

    The gates are between 0.1 and 0.99; the numbers need not be whole.
    """
    usual = rng.uniform(0.4, 0.8, 4)
    gates = np.clip(usual + rng.uniform(-0.35, 0.35, (20, 4)), 0.1, 0.99)
    phi = np.exp(np.log(gates).mean(axis=0))
    truth = np.log(0.5) / np.log(phi)
    slips = {
        "gates multiply from step to step: the mean that stands for all is not their "
        "sum by their number": np.log(0.5) / np.log(gates.mean(axis=0)),
        "it keeps the share φ, and loses 1 - φ": np.log(0.5) / np.log(1 - phi),
        "φ is multiplied at each step, not subtracted": 0.5 / (1 - phi),
        "that is one over it": 1 / truth,
        "the sign is wrong: logarithms of numbers below 1 are negative": -truth,
    }
    return Question(
        (gates,),
        truth,
        slips,
        "if φ is the one gate of a cell that stands for all steps, φⁿ is left after n "
        "of them; here yours is not a half",
    )
