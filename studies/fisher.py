"""Fisher information of unknowns in what is sensed, and the Cramér-Rao bound.

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
    """Gaussian noise of a sensor.

    It is correlated over channels, and over time a first-order autoregression:
    e_t = ρ e_{t-1} + √(1-ρ²) w_t with white w of covariance Σ. So n steps of it tell
    less of a constant than n independent ones, by (1-ρ)/(1+ρ).
    """

    covariance: np.ndarray  # Σ of one step [D, D], in the channels' units
    correlation: float = 0.0  # ρ, from 0 to below 1

    def __post_init__(self) -> None:
        """Refuse what is no matrix, such as a list of deviations."""
        checked = check_array("covariance", self.covariance, ("D", "D"))
        object.__setattr__(self, "covariance", checked)

    @classmethod
    def measured(
        cls, residuals: np.ndarray, stated: ArrayLike = 0.0, *, ridge: float = 1e-6
    ) -> "Noise":
        """Noise from the residuals of repeats of a run, which have mean zero.

        Args:
            residuals: of N repeats `[N, T, D]`.
            stated: standard deviation of white noise that is added, one for all
                channels or `[D]`.
            ridge: share of each variance that is added to it, so that channels that
                nearly repeat each other do not seem to be known exactly; this only
                adds noise.
        """
        # How the channels scatter, and with the stated noise
        added = np.broadcast_to(stated, residuals.shape[-1:]) ** 2
        count = residuals.shape[0] * residuals.shape[1]
        seen = np.einsum("ntd,nte->de", residuals, residuals) / count
        covariance = seen + np.diag(added)
        variance = np.diag(covariance)

        # How much of it stays a step later, mean of the channels
        products = residuals[:, 1:] * residuals[:, :-1]
        later = products.mean(axis=(0, 1)) / variance
        correlation = float(np.clip(later.mean(), 0, _LARGEST_CORRELATION))

        return cls(covariance + ridge * np.diag(variance), correlation)

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviation of each channel `[D]`."""
        return np.sqrt(np.diag(self.covariance))

    def whiten(self, values: ArrayLike) -> np.ndarray:
        """What a sensor with white noise of variance 1 would have sensed.

        Of `[T, D, P]`, the same shape.
        """
        values = check_array("values", values, ("T", len(self.covariance), "P"))
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), values)
        rho = self.correlation
        white[1:] = (white[1:] - rho * white[:-1]) / np.sqrt(1 - rho**2)
        return white


def fisher_information(sensitivity: ArrayLike, noise: Noise) -> np.ndarray:
    """What all steps up to each say together: F_t = Σ_{i≤t} S̃_iᵀ S̃_i `[T, P, P]`.

    S̃ are the sensitivities ∂(sensed)/∂(unknown) `[T, D, P]` after whitening. For noise
    that is white in time this is Σ_{i≤t} S_iᵀ Σ⁻¹ S_i. Sensors whose noises are
    independent add up.
    """
    white = noise.whiten(sensitivity)
    return np.cumsum(np.einsum("tdp,tdq->tpq", white, white), axis=0)


def unbiased_information(sensitivities: np.ndarray, noise: Noise) -> np.ndarray:
    """Fisher information `[T, P, P]` from noisy measurements of the sensitivities.

    There are R of them `[R, T, D, P]`, at least 2. The square of a noisy number is too
    large on average, the product of two measurements with independent errors is not:
    F = 1/(R(R-1)) Σ_{r≠q} S̃_rᵀ S̃_q. With hardly any information it can be negative:
    the bound is infinite then.
    """
    count = len(sensitivities)
    own = np.mean([fisher_information(each, noise) for each in sensitivities], axis=0)
    of_mean = fisher_information(sensitivities.mean(axis=0), noise)
    return (count * of_mean - own) / (count - 1)


def cramer_rao(
    information: ArrayLike,
    combinations: ArrayLike | None = None,
    *,
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Least standard deviation that an unbiased estimate can have.

    It is √(aᵀ F⁻¹ a) for each combination a of the unknowns.

    Args:
        information: F `[..., P, P]`, symmetric.
        combinations: `[K, P]`; each unknown by itself when left out.
        tolerance: directions with less than this share of the best one's information
            count as unobservable, and combinations with less than this share of their
            squared length along them as free of them.

    Returns: `[..., K]`; infinite for a combination that has to do with an unobservable
        direction.
    """
    f = _check_symmetric(information)
    size = f.shape[-1]
    wanted = np.eye(size) if combinations is None else combinations
    a = check_array("combinations", wanted, ("K", size))

    # How much of each combination lies along each direction, [..., K, P]
    values, vectors = np.linalg.eigh(f)  # rising
    along = np.einsum("...pq,kp->...kq", vectors, a) ** 2

    # Directions of which something is seen, [..., 1, P]
    values = values[..., None, :]
    seen = (values > tolerance * values[..., -1:]) & (values > 0)

    # What lies along the others is not known at all
    unseen = np.where(seen, 0.0, along).sum(axis=-1)
    hidden = unseen > tolerance * (a**2).sum(axis=-1)
    variance = (np.where(seen, along, 0.0) / np.where(seen, values, 1.0)).sum(axis=-1)
    return np.where(hidden, np.inf, np.sqrt(variance))


def _check_symmetric(information: ArrayLike) -> np.ndarray:
    f = check_array("information", information, (..., "P", "P"))
    symmetric = False
    if f.shape[-1] == f.shape[-2]:
        mirrored = np.swapaxes(f, -1, -2)
        symmetric = np.allclose(f, mirrored, atol=1e-8 * np.abs(f).max())
    if not symmetric:
        raise ValueError(
            f"information is symmetric, [..., P, P], got the shape {list(f.shape)}"
        )
    return f
