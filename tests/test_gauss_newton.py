"""The curvature's estimates against textbooks, written out with plain loops."""

import numpy as np
import pytest

from clothlab.method.estimation import Linearisation

ENDLESS = 1e12  # degrees of freedom: every weight is one


@pytest.fixture
def window():
    """Errors that follow each other, and derivatives, of two sensors and two p."""
    rng = np.random.default_rng(0)
    errors = rng.normal(size=(30, 2))
    for t in range(1, 30):
        errors[t] += 0.7 * errors[t - 1]
    return Linearisation(errors, rng.normal(size=(30, 2, 2)))


@pytest.mark.parametrize("lag", [0, 1, 5, 100])
def test_covariance_is_newey_and_west_s(window, lag):
    """Pairs of steps count the less the farther they are apart, beyond the lag not."""
    jacobian, errors = window.jacobian, window.errors
    gradients = [j.T @ e for j, e in zip(jacobian, errors, strict=True)]
    within = min(lag, len(errors) // 4)
    scatter = np.zeros((2, 2))
    for t in range(30):
        for q in range(30):
            if abs(t - q) <= within:
                weight = 1 - abs(t - q) / (within + 1)
                scatter += weight * np.outer(gradients[t], gradients[q])
    inverse = np.linalg.inv(sum(j.T @ j for j in jacobian))
    expected = inverse @ scatter @ inverse
    assert window.covariance(ENDLESS, lag) == pytest.approx(expected, rel=1e-6)


def test_a_step_is_that_of_least_squares(window):
    rows, seen = window.jacobian.reshape(-1, 2), window.errors.ravel()
    expected = np.linalg.lstsq(rows, seen, rcond=None)[0]
    assert window.step(ENDLESS) == pytest.approx(expected, rel=1e-6)
    short = window.step(ENDLESS, largest=0.01)
    assert np.linalg.norm(short) == pytest.approx(0.01)
    assert short / 0.01 == pytest.approx(expected / np.linalg.norm(expected))


def test_weights_are_those_of_student_s_t(window):
    """The step solves the weighted normal equations, with w = (ν+1) / (ν + e²/mean)."""
    nu = 4.0
    squares = window.errors**2 / (window.errors**2).mean()
    roots = np.sqrt((nu + 1) / (nu + squares)).ravel()
    rows = window.jacobian.reshape(-1, 2) * roots[:, None]
    expected = np.linalg.lstsq(rows, window.errors.ravel() * roots, rcond=None)[0]
    assert window.step(nu) == pytest.approx(expected, rel=1e-6)


def test_the_curvature_of_student_s_t_is_the_slope_of_its_gradient(window):
    """By finite differences of w(e) e, where the scale of errors stays."""
    nu, nudge = 4.0, 1e-5
    scale = (window.errors**2).mean()

    def pull(errors):
        return (nu + 1) / (nu + errors**2 / scale) * errors

    up, down = pull(window.errors + nudge), pull(window.errors - nudge)
    slopes = (up - down) / (2 * nudge)
    curvature = np.einsum("tdi,td,tdj->ij", window.jacobian, slopes, window.jacobian)
    pulls = pull(window.errors)
    gradients = np.einsum("tdi,td->ti", window.jacobian, pulls)
    inverse = np.linalg.inv(curvature)
    expected = inverse @ (gradients.T @ gradients) @ inverse
    assert window.covariance(nu, lag=0) == pytest.approx(expected, rel=1e-4)
