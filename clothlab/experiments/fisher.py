"""How much of the unknown shows in what is sensed: Fisher information, and the Cramér-Rao bound that follows from it.

Sensed is y_t = f_t(x) + e_t, with unknowns x `[P]` and Gaussian noise e. What the noise-free f does when an unknown
moves is its sensitivity S_t = ∂f_t/∂x `[D, P]`. No unbiased estimate of x has a smaller covariance than the inverse of
the information F (Cramér and Rao); what F does not hold cannot be known, however clever the estimate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from clothlab._validation import check_array, check_number

LARGEST_CORRELATION = 0.99  # of noise with itself a step later: a noise that never changes could be calibrated away


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a sensor: Gaussian, alike at all times, correlated over channels and from each step to the next.

    Over time it is a first-order autoregression, e_t = ρ e_{t-1} + √(1-ρ²) w_t with white w of covariance Σ: `n` steps
    of it tell less of a constant than `n` independent ones, by (1-ρ)/(1+ρ).

    Attributes:
        covariance: Σ of one step `[D, D]`, in the channels' units.
        correlation: ρ, from 0 to below 1.

    Raises:
        ValueError: a covariance that is not symmetric and positive definite, or a correlation out of range.
    """

    covariance: np.ndarray
    correlation: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no noise; a sensor without any would know everything at once."""
        covariance = check_array("covariance", self.covariance, ("D", "D"))
        if not covariance.size or covariance.shape[0] != covariance.shape[1]:
            raise ValueError(f"covariance is square, [D, D], got the shape {list(covariance.shape)}")
        unitless = _as_correlation(covariance)
        if not np.allclose(unitless, unitless.T) or np.linalg.eigvalsh(unitless).min() < 1e-9:
            raise ValueError("covariance must be symmetric and positive definite: no mix of channels is free of noise")
        rho = check_number("correlation", self.correlation, at_least=0, at_most=LARGEST_CORRELATION)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "correlation", rho)

    @classmethod
    def measured(cls, residuals: ArrayLike, stated: ArrayLike | None = None, *, ridge: float = 1e-6) -> "Noise":
        """Covariance and ρ of what was left over in repeats of a run.

        Args:
            residuals: of N repeats, with mean zero `[N, T, D]`.
            stated: standard deviations of white noise that is added, `[D]`; none when left out.
            ridge: share of each variance that is added to it, so that channels that nearly repeat each other do not
                seem to be known exactly; this only adds noise.

        Raises:
            ValueError: residuals of fewer than two steps, or a channel without any noise.
        """
        e, ridge = check_array("residuals", residuals, ("N", "T", "D")), check_number("ridge", ridge, at_least=0)
        if not len(e) or e.shape[1] < 2:
            raise ValueError(f"residuals are of one repeat and two steps at the least, got the shape {list(e.shape)}")
        added = check_array("stated", np.zeros(e.shape[-1]) if stated is None else stated, e.shape[-1:]) ** 2
        covariance = np.einsum("ntd,nte->de", e, e) / (e.shape[0] * e.shape[1]) + np.diag(added)
        variance = np.diag(covariance)
        if not (variance > 0).all():
            raise ValueError(f"channels {np.flatnonzero(variance <= 0).tolist()} have no noise: state some")
        later = (e[:, 1:] * e[:, :-1]).mean(axis=(0, 1)) / variance
        return cls(covariance + ridge * np.diag(variance), float(np.clip(later.mean(), 0, LARGEST_CORRELATION)))

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviation of each channel `[D]`."""
        return np.sqrt(np.diag(self.covariance))

    def whiten(self, values: ArrayLike) -> np.ndarray:
        """What a sensor of white noise of variance 1 would have sensed, of `[T, D, P]`."""
        values = check_array("values", values, ("T", len(self.covariance), "P"))
        white = np.linalg.solve(np.linalg.cholesky(self.covariance), values)
        white[1:] = (white[1:] - self.correlation * white[:-1]) / np.sqrt(1 - self.correlation**2)
        return white


def _as_correlation(covariance: np.ndarray) -> np.ndarray:
    """The same without units, since channels of different units have variances of different sizes."""
    scale = np.sqrt(np.diag(covariance).clip(min=0))
    scale[scale == 0] = 1  # then its row is zero, and the matrix not positive definite
    return covariance / np.outer(scale, scale)


def fisher_information(sensitivity: ArrayLike, noise: Noise) -> np.ndarray:
    """F_t = Σ_{i≤t} S̃_iᵀ S̃_i, with S̃ the sensitivities after whitening: what all steps up to each say together.

    For noise that is white in time this is Σ_{i≤t} S_iᵀ Σ⁻¹ S_i. Sensors whose noises are independent add up.

    Args:
        sensitivity: ∂(sensed)/∂(unknown) at each step `[T, D, P]`.
        noise: of the sensor.

    Returns:
        `[T, P, P]`, one over the unknowns' units squared.

    Raises:
        ValueError: sensitivities of another shape, or not finite.
    """
    white = noise.whiten(sensitivity)
    return np.cumsum(np.einsum("tdp,tdq->tpq", white, white), axis=0)


def unbiased_information(sensitivities: ArrayLike, noise: Noise) -> np.ndarray:
    """The same from several noisy measurements of the sensitivities, without what their noise adds.

    The square of a noisy number is too large on average; the product of two measurements with independent errors is
    not. So each measurement is multiplied by all the others: F = 1/(R(R-1)) Σ_{r≠q} S̃_rᵀ S̃_q. Where there is hardly
    any information, this can come out negative: `cramer_rao` then says that nothing is known.

    Args:
        sensitivities: measured R times `[R, T, D, P]`.
        noise: of the sensor.

    Returns:
        `[T, P, P]`.

    Raises:
        ValueError: fewer than two measurements, or as `fisher_information`.
    """
    measured = check_array("sensitivities", sensitivities, ("R", "T", "D", "P"))
    count = len(measured)
    if count < 2:
        raise ValueError(f"sensitivities are measured twice at the least, got {count}")
    own = np.mean([fisher_information(each, noise) for each in measured], axis=0)
    return (count * fisher_information(measured.mean(axis=0), noise) - own) / (count - 1)


def check_information(information: ArrayLike) -> np.ndarray:
    """Return Fisher information `[..., P, P]` as float64.

    Raises:
        ValueError: another shape, not finite, or not symmetric.
    """
    f = check_array("information", information, (*"ABCDEF"[: max(np.ndim(information) - 2, 0)], "P", "P"))
    if (
        not f.size
        or f.shape[-1] != f.shape[-2]
        or not np.allclose(f, np.swapaxes(f, -1, -2), atol=1e-8 * np.abs(f).max())
    ):
        raise ValueError(f"information is symmetric, [..., P, P], got the shape {list(f.shape)}")
    return f


def principal_directions(information: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Which combinations of the unknowns show, best first: eigenvalues and eigenvectors of F `[..., P, P]`.

    Returns:
        The information along each direction `[..., P]`, and the directions `[..., P, P]`, one a row, of length 1; the
        largest component of each is positive.

    Raises:
        ValueError: no information matrix.
    """
    values, vectors = np.linalg.eigh(check_information(information))
    values, rows = values[..., ::-1], np.swapaxes(vectors, -1, -2)[..., ::-1, :]
    largest = np.take_along_axis(rows, np.abs(rows).argmax(axis=-1)[..., None], axis=-1)
    return values, rows * np.where(largest < 0, -1.0, 1.0)


def cramer_rao(information: ArrayLike, combinations: ArrayLike | None = None, *, tolerance: float = 1e-9) -> np.ndarray:
    """Least standard deviation that an unbiased estimate can have: √(aᵀ F⁻¹ a) for each combination a of the unknowns.

    All unknowns are unknown at once: what F holds of one alone is of no use as far as another could have done it.

    Args:
        information: F `[..., P, P]`.
        combinations: `[K, P]`; each unknown by itself when left out.
        tolerance: directions with less than this share of the best one's information count as unobservable, and
            combinations with less than this share of their squared length along them as free of them.

    Returns:
        `[..., K]`; infinite for a combination that has to do with an unobservable direction.

    Raises:
        ValueError: no information matrix, or combinations of another size.
    """
    values, rows = principal_directions(information)
    size = values.shape[-1]
    a = check_array("combinations", np.eye(size) if combinations is None else combinations, ("K", size))
    check_number("tolerance", tolerance, at_least=0)
    along = np.einsum("...qp,kp->...kq", rows, a) ** 2
    seen = (values > tolerance * values[..., :1])[..., None, :] & (values > 0)[..., None, :]
    hidden = np.where(seen, 0.0, along).sum(axis=-1) > tolerance * (a**2).sum(axis=-1)
    variance = (np.where(seen, along, 0.0) / np.where(seen, values[..., None, :], 1.0)).sum(axis=-1)
    return np.where(hidden, np.inf, np.sqrt(variance))


def log_det(information: ArrayLike) -> np.ndarray:
    """log det F of `[..., P, P]`, `[...]`: the larger, the smaller the region that is left to the unknowns (D-optimal).

    Minus infinity where a direction is unobservable.

    Raises:
        ValueError: no information matrix.
    """
    values, _ = principal_directions(information)
    known = np.asarray((values > 0).all(axis=-1))
    return np.where(known, np.log(np.where(known[..., None], values, 1.0)).sum(axis=-1), -np.inf)
