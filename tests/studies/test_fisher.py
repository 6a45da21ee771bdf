"""Laws of information, on sensors whose bound is known in closed form."""

import numpy as np
import pytest

from studies.fisher import Noise, cramer_rao, fisher_information, unbiased_information

RATIO, PRODUCT = (1, -1), (1, 1)


def stationary(steps=400, channels=3, seed=0):
    return np.random.default_rng(seed).normal(size=(steps, channels, 2))


def white(channels=3):
    return Noise(np.diag(np.linspace(0.1, 0.3, channels) ** 2))


def autoregression(rng, rho, deviations, shape):
    e = rng.normal(size=(*shape, len(deviations)))
    for t in range(1, shape[-1]):
        e[:, t] = rho * e[:, t - 1] + np.sqrt(1 - rho**2) * e[:, t]
    return e * deviations


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_bound_falls_with_the_root_of_time_when_the_motion_goes_on_as_it_is(rho):
    bound = cramer_rao(
        fisher_information(stationary(6400), Noise(white().covariance, rho))
    )
    slope = np.polyfit(np.log(np.arange(100, 6400)), np.log(bound[100:]), 1)[0]
    assert slope == pytest.approx([-0.5, -0.5], abs=0.02)


def test_the_bound_is_reached_by_weighted_least_squares_in_correlated_noise():
    rng, rho, deviations, x = (
        np.random.default_rng(1),
        0.7,
        np.array([0.2, 0.5]),
        np.array([0.3, -0.2]),
    )
    s, noise = stationary(60, 2), Noise(np.diag(deviations**2), rho)
    e = autoregression(rng, rho, deviations, (2000, 60))
    sensed = np.stack(
        [noise.whiten((s @ x + each)[..., None]).ravel() for each in e], axis=1
    )
    errors = (
        np.linalg.lstsq(noise.whiten(s).reshape(-1, 2), sensed, rcond=None)[0].T - x
    )
    assert errors.mean(axis=0) == pytest.approx([0, 0], abs=0.005)
    assert errors.std(axis=0) == pytest.approx(
        cramer_rao(fisher_information(s, noise))[-1], rel=0.06
    )


def test_what_only_the_ratio_moves_says_nothing_of_the_product():
    f = fisher_information(stationary()[..., :1] * RATIO, white())[-1]
    damp, mass, ratio, product = cramer_rao(f, [(1, 0), (0, 1), RATIO, PRODUCT])
    assert np.isinf([damp, mass, product]).all()
    assert 0 < ratio < np.inf
    # As noise in measured sensitivities can leave it
    assert np.isinf(cramer_rao(np.diag([1.0, -1e-3]))[1])


def test_noise_in_measured_sensitivities_is_not_taken_for_information():
    rng, truth = np.random.default_rng(2), stationary(300)
    noisy = truth + rng.normal(0, 2.0, (6, *truth.shape))
    right, found = (
        fisher_information(truth, white())[-1],
        unbiased_information(noisy, white())[-1],
    )
    naive = fisher_information(noisy.mean(axis=0), white())[-1]
    assert np.diag(found) == pytest.approx(np.diag(right), rel=0.15)
    assert (np.diag(naive) > 1.5 * np.diag(right)).all()


def test_noise_is_measured_with_its_correlation_and_stated_noise_is_added():
    e = autoregression(np.random.default_rng(3), 0.6, np.array([0.1, 2.0]), (20, 500))
    noise, more = Noise.measured(e), Noise.measured(e, [0.1, 2.0])
    assert noise.deviations == pytest.approx([0.1, 2.0], rel=0.05)
    assert noise.correlation == pytest.approx(0.6, abs=0.05)
    assert more.deviations == pytest.approx(np.sqrt(2) * noise.deviations, rel=0.05)
    assert more.correlation == pytest.approx(0.3, abs=0.05)
