"""Laws of calibration: regions hold what they should as often as they say, and the
unknown is told from the known.
"""

import numpy as np
import pytest
import torch

from clothlab.analysis import inside, outline
from clothlab.method.data import Run
from clothlab.method.estimation import Linearisation, NewtonSettings
from studies.uncertainty import _likeliest_floor, best_bias, calibrate

ENDLESS = NewtonSettings(degrees_of_freedom=1e9)
BIASES = {
    "a": np.array([1.0, 0.0]),
    "b": np.array([-1.0, 0.5]),
    "c": np.array([0.0, -1.0]),
}
# How the state feels a command and p
MIX = torch.tensor([[1.0, 0.5], [-0.5, 1.0], [0.3, 0.3]])


class Toy:
    """s[t+1] = MIX (u[t] * (p + 1)): linear in p, and so its regions can be known."""

    state_size, command_size, bias_size, s_std = 3, 2, 2, torch.ones(3)
    step, state_names, command_names = None, (), ()

    def __call__(self, s, u, p):
        return (u * (p[:, None] + 1)) @ MIX.T, None


def toy_run(p, rng, steps=80, noise=0.3, material="a"):
    u = rng.normal(size=(steps, 2))
    s = np.zeros((steps, 3))
    s[1:] = (u * (np.asarray(p) + 1))[:-1] @ MIX.numpy().T + noise * rng.normal(
        size=(steps - 1, 3)
    )
    return Run(s, u, material)


@pytest.mark.slow
def test_the_90_percent_region_of_a_linear_gaussian_toy_holds_the_truth_in_90_percent():
    rng = np.random.default_rng(0)
    fits = [
        best_bias(Toy(), toy_run([0.3, -0.2], rng), np.zeros(2), ENDLESS)
        for _ in range(400)
    ]
    held = np.mean(
        [inside([0.3, -0.2], p, fit.covariance(1e9, lag=0)) for p, fit in fits]
    )
    assert held == pytest.approx(0.9, abs=3 * np.sqrt(0.9 * 0.1 / len(fits)))
    found = np.mean([fit.covariance(1e9, lag=0) for _, fit in fits], axis=0)
    squares = [
        np.linalg.inv(np.einsum("tdi,tdj->ij", fit.jacobian, fit.jacobian))
        for _, fit in fits
    ]
    # Of least squares
    assert found == pytest.approx(0.3**2 * np.mean(squares, axis=0), rel=0.1, abs=2e-5)


def test_a_region_grows_with_its_share_and_its_edge_is_its_edge():
    centre, covariance = np.array([1.0, 2.0]), np.array([[2.0, 0.6], [0.6, 0.5]])
    for share in (0.5, 0.9):
        edge = outline(centre, covariance, share)
        assert edge.shape == (48, 2)
        assert edge[0] == pytest.approx(edge[-1])
        assert all(
            inside(centre + 0.99 * (p - centre), centre, covariance, share)
            for p in edge
        )
        assert not any(
            inside(centre + 1.01 * (p - centre), centre, covariance, share)
            for p in edge
        )
    drawn = np.random.default_rng(0).multivariate_normal(centre, covariance, 1000)
    assert np.mean(
        [inside(p, centre, covariance, 0.5) for p in drawn]
    ) == pytest.approx(0.5, abs=0.05)


def test_the_floor_is_what_scatter_leaves_unexplained():
    rng = np.random.default_rng(1)
    true = np.array([[0.5, 0.2], [0.2, 0.3]])
    scatter = np.array([np.eye(2) * k for k in rng.uniform(0.1, 1, 500)])
    gaps = np.array([rng.multivariate_normal([0, 0], true + each) for each in scatter])
    assert _likeliest_floor(gaps, scatter) == pytest.approx(true, abs=0.12)
    # Never more than there is
    assert np.trace(_likeliest_floor(gaps / 100, scatter)) < 0.01


@pytest.fixture(scope="module")
def calibration():
    """Of a toy whose right p shifts from run to run by 0.1, which no curvature can
    know.
    """
    rng = np.random.default_rng(2)
    runs = [
        toy_run(p + 0.1 * rng.normal(size=2), rng, 110, 0.1, name)
        for name, p in BIASES.items()
        for _ in range(9)
    ]
    return calibrate(Toy(), BIASES, runs, lengths=(50, 100, 500), settings=ENDLESS)


@pytest.mark.slow
def test_a_calibration_finds_what_curvature_cannot_know(calibration):
    assert np.sqrt(np.diag(calibration.floor)) == pytest.approx([0.1, 0.1], rel=0.4)
    assert calibration.lengths.tolist() == [50, 100]
    rng, held, bare = np.random.default_rng(3), [], []
    for _ in range(150):
        p, fit = best_bias(
            Toy(),
            toy_run(BIASES["a"] + 0.1 * rng.normal(size=2), rng, 100, 0.1),
            [0, 0],
            ENDLESS,
        )
        held.append(inside(BIASES["a"], p, calibration.covariance(fit)))
        bare.append(inside(BIASES["a"], p, fit.covariance()))
    assert 0.8 < np.mean(held) <= 1
    assert np.mean(bare) < 0.5


def test_only_an_unusual_error_is_out_of_distribution(calibration):
    rng, alarms = np.random.default_rng(4), {}
    for noise in (0.1, 0.3):
        fits = [
            best_bias(Toy(), toy_run(BIASES["b"], rng, 100, noise), [0, 0], ENDLESS)
            for _ in range(40)
        ]
        alarms[noise] = np.mean(
            [calibration.out_of_distribution(fit, p) for p, fit in fits]
        )
        ratio = np.mean([calibration.log_error_ratio(fit, p) for p, fit in fits])
        assert ratio == pytest.approx(2 * np.log(noise / 0.1), abs=0.1)
    assert alarms[0.1] < 0.25
    assert alarms[0.3] == 1
    early, late = (
        Linearisation(np.full((n, 3), 9.0), np.zeros((n, 3, 2))) for n in (20, 99)
    )
    assert not calibration.out_of_distribution(early, BIASES["a"])
    assert calibration.out_of_distribution(late, BIASES["a"])


def test_outside_is_where_no_trained_material_is_around(calibration):
    small = 1e-4 * np.eye(2)
    assert not calibration.outside_hull(np.mean(list(BIASES.values()), axis=0), small)
    assert calibration.outside_hull(2 * BIASES["a"], small)
    # Too unsure to tell
    assert not calibration.outside_hull(2 * BIASES["a"], 4 * np.eye(2))


def test_a_report_says_all_of_it_at_once(calibration):
    p, fit = best_bias(
        Toy(), toy_run(BIASES["c"], np.random.default_rng(6), 100, 0.1), [0, 0], ENDLESS
    )
    report = calibration.report(fit, p)
    assert np.array_equal(report.covariance, calibration.covariance(fit))
    assert report.log_error_ratio == calibration.log_error_ratio(fit, p)
    assert report[2:] == (
        calibration.out_of_distribution(fit, p),
        calibration.outside_hull(p, report.covariance),
    )
    assert calibration.report(None, p) is None
    assert (
        calibration.report(Linearisation(fit.errors, np.zeros_like(fit.jacobian)), p)
        is None
    )


@pytest.mark.parametrize(
    ("names", "lengths", "message"),
    [
        ("a", (50,), "at least two runs of each material"),
        ("", (50,), "at least two runs"),
        ("aa", (500,), "runs of 60 steps are too short"),
        ("aaxx", (50,), "unknown material 'x'; choose from a, b, c"),
    ],
)
def test_a_calibration_needs_runs_with_known_materials(names, lengths, message):
    runs = [
        toy_run([0, 0], np.random.default_rng(5), 60, material=name) for name in names
    ]
    with pytest.raises((ValueError, KeyError), match=message):
        calibrate(Toy(), BIASES, runs, lengths=lengths)


def test_what_is_usual_is_learned_of_each_material_and_each_sensor():
    """Errors of a material are judged by its own: log of the variance of its noise."""
    rng = np.random.default_rng(7)
    noises = {"a": [0.05, 0.1, 0.2], "b": [0.4, 0.2, 0.1], "c": [0.1, 0.1, 0.1]}
    runs = [
        toy_run(BIASES[name], rng, 120, np.array(noise), name)
        for name, noise in noises.items()
        for _ in range(4)
    ]
    found = calibrate(Toy(), BIASES, runs, lengths=(60, 110), settings=ENDLESS)
    assert found.usual == pytest.approx(2 * np.log([*noises.values()]), abs=0.25)
    p, fit = best_bias(Toy(), runs[4], [0, 0], ENDLESS)  # of b
    assert found.log_error_ratio(fit, p) == pytest.approx(0, abs=0.2)
    surprise = 2 * np.log(np.divide(noises["b"], noises["a"])).mean()
    ratio = found.log_error_ratio(fit, BIASES["a"])
    assert ratio == pytest.approx(surprise, abs=0.25)


def test_what_is_usual_is_taken_from_the_longest_look():
    """The runs are noisier in their second half."""
    rng = np.random.default_rng(8)
    noise = np.repeat([0.1, 0.4], [60, 59])[:, None]
    runs = [toy_run(p, rng, 120, noise, name) for name, p in BIASES.items()] * 2
    found = calibrate(Toy(), BIASES, runs, lengths=(60, 120), settings=ENDLESS)
    expected = np.log(np.square(noise).mean())
    assert found.usual == pytest.approx(np.full((3, 3), expected), abs=0.5)
