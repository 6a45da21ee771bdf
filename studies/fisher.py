"""Fisher information of unknowns in what is sensed, and the Cramér-Rao bound that
follows from it.

Sensed is y_t = f_t(x) + e_t, with unknowns x `[P]` and Gaussian noise e. The
sensitivity is S_t = ∂f_t/∂x `[D, P]`. No unbiased estimate of x has a smaller
covariance than the inverse of the information F (Cramér and Rao).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array

# Of noise with itself a step later: noise that never changes could be calibrated away
_LARGEST_CORRELATION = 0.99


@dataclass(frozen=True, eq=False)
class Noise:
    """Gaussian noise of a sensor: correlated over channels, and over time a first-order
    autoregression.

    e_t = ρ e_{t-1} + √(1-ρ²) w_t with white w of covariance Σ: n steps of it tell less
    of a constant than n independent ones, by (1-ρ)/(1+ρ).
    """

    covariance: np.ndarray  # Σ of one step [D, D], in the channels' units
    correlation: float = 0.0  # ρ, from 0 to below 1

    def __post_init__(self) -> None:
        """Refuse what is no matrix, such as a list of deviations."""
        object.__setattr__(
            self, "covariance", check_array("covariance", self.covariance, ("D", "D"))
        )

    @classmethod
    def measured(
        cls, residuals: np.ndarray, stated: ArrayLike = 0.0, *, ridge: float = 1e-6
    ) -> "Noise":
        """Covariance and ρ of the residuals of N repeats of a run `[N, T, D]`, which
        have mean zero.

        `stated` are standard deviations of white noise that is added, one for all
        channels or `[D]`. `ridge` is the share of each variance that is added to it, so
        that channels that nearly repeat each other do not seem to be known exactly;
        this only adds noise.
        """
        added = np.broadcast_to(stated, residuals.shape[-1:]) ** 2
        count = residuals.shape[0] * residuals.shape[1]
        covariance = np.einsum("ntd,nte->de", residuals, residuals) / count + np.diag(
            added
        )
        variance = np.diag(covariance)
        later = (residuals[:, 1:] * residuals[:, :-1]).mean(axis=(0, 1)) / variance
        return cls(
            covariance + ridge * np.diag(variance),
            float(np.clip(later.mean(), 0, _LARGEST_CORRELATION)),
        )

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviation of each channel `[D]`."""
        return np.sqrt(np.diag(self.covariance))

    def whiten(self, values: ArrayLike) -> np.ndarray:
        """What a sensor of white noise of variance 1 would have sensed, of `[T, D, P]`."""
        values = check_array("values", values, ("T", len(self.covariance), "P"))
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), values)
        white[1:] = (white[1:] - self.correlation * white[:-1]) / np.sqrt(
            1 - self.correlation**2
        )
        return white


def fisher_information(sensitivity: ArrayLike, noise: Noise) -> np.ndarray:
    """F_t = Σ_{i≤t} S̃_iᵀ S̃_i `[T, P, P]`, with S̃ the sensitivities
    ∂(sensed)/∂(unknown) `[T, D, P]` after whitening.

    It is what all steps up to each say together. For noise that is white in time this
    is Σ_{i≤t} S_iᵀ Σ⁻¹ S_i. Sensors whose noises are independent add up.
    """
    white = noise.whiten(sensitivity)
    return np.cumsum(np.einsum("tdp,tdq->tpq", white, white), axis=0)


def unbiased_information(sensitivities: np.ndarray, noise: Noise) -> np.ndarray:
    """Fisher information `[T, P, P]` from R noisy measurements of the sensitivities
    `[R, T, D, P]`, R at least 2.

    The square of a noisy number is too large on average, the product of two
    measurements with independent errors is not: F = 1/(R(R-1)) Σ_{r≠q} S̃_rᵀ S̃_q. With
    hardly any information it can be negative: the bound is infinite then.
    """
    count = len(sensitivities)
    own = np.mean([fisher_information(each, noise) for each in sensitivities], axis=0)
    return (count * fisher_information(sensitivities.mean(axis=0), noise) - own) / (
        count - 1
    )


def cramer_rao(
    information: ArrayLike,
    combinations: ArrayLike | None = None,
    *,
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Least standard deviation that an unbiased estimate can have: √(aᵀ F⁻¹ a) for each
    combination a of the unknowns.

    Args:
        information: F `[..., P, P]`, symmetric.
        combinations: `[K, P]`; each unknown by itself when left out.
        tolerance: directions with less than this share of the best one's information
            count as unobservable, and combinations with less than this share of their
            squared length along them as free of them.

    Returns: `[..., K]`; infinite for a combination that has to do with an unobservable
        direction.
    """
    f = check_array("information", information, (..., "P", "P"))
    if f.shape[-1] != f.shape[-2] or not np.allclose(
        f, np.swapaxes(f, -1, -2), atol=1e-8 * np.abs(f).max()
    ):
        raise ValueError(
            f"information is symmetric, [..., P, P], got the shape {list(f.shape)}"
        )
    values, vectors = np.linalg.eigh(f)  # rising
    size = values.shape[-1]
    a = check_array(
        "combinations",
        np.eye(size) if combinations is None else combinations,
        ("K", size),
    )
    along = np.einsum("...pq,kp->...kq", vectors, a) ** 2
    seen = (values > tolerance * values[..., -1:])[..., None, :] & (values > 0)[
        ..., None, :
    ]
    hidden = np.where(seen, 0.0, along).sum(axis=-1) > tolerance * (a**2).sum(axis=-1)
    variance = (
        np.where(seen, along, 0.0) / np.where(seen, values[..., None, :], 1.0)
    ).sum(axis=-1)
    return np.where(hidden, np.inf, np.sqrt(variance))
