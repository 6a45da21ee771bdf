"""Rivals beside p: the decomposition finds what it can, and the tables are read."""

import numpy as np
import pytest

from clothlab.method.data import Run
from studies import rivals


def _run(follow, seed):
    """Three states and two commands, where `follow` makes the next state."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (80, 2))
    s = [rng.normal(size=3)]
    for command in u[:-1]:
        s.append(follow(s[-1], command))
    return Run(np.array(s), u, "toy")


def _linear(s, u):
    turned = np.array([0.9 * s[0] - 0.2 * s[1], 0.2 * s[0] + 0.9 * s[1], 0.5 * s[2]])
    return turned + np.array([u[0], u[1], u[0] - u[1]])


def _quadratic(s, u):
    return 0.5 * s + 0.3 * u[0] * u[1] * np.array([1, -1, 2]) + 0.1 * u[0]


@pytest.mark.parametrize(
    ("follow", "degree"), [(_linear, 1), (_quadratic, 2), (_linear, 2)]
)
def test_a_decomposition_foretells_what_it_can_express(follow, degree):
    runs = [_run(follow, seed) for seed in range(30)]
    fitted = rivals.Decomposition(runs, degree)
    new = _run(follow, 99)
    gap = fitted.predict(new, 20, 16) - new.s[21:37]
    assert np.abs(gap).max() < 0.1 * new.s.std()


def test_a_linear_one_does_not_foretell_products():
    runs = [_run(_quadratic, seed) for seed in range(30)]
    gap = {}
    for degree in (1, 2):
        fitted = rivals.Decomposition(runs, degree)
        new = _run(_quadratic, 99)
        gap[degree] = np.abs(fitted.predict(new, 20, 16) - new.s[21:37]).mean()
    assert gap[1] > 5 * gap[2]


def test_a_diverging_one_stays_finite():
    runs = [_run(lambda s, u: 1.5 * np.clip(s, -1, 1) + u[0], 0)]
    fitted = rivals.Decomposition(runs, 2)
    assert np.isfinite(fitted.predict(runs[0], 10, 60)).all()


def test_rivals_stand_beside_p_by_question():
    found = rivals.beside_p()
    assert (found["low"] <= found["difference"]).all()
    assert (found["difference"] <= found["high"]).all()

    # The cloth's context encoder: first throws of three trainings, by hand
    row = found.loc[("cloth: first throw", rivals.ENCODER)]
    assert row["difference"] == pytest.approx(0.002, abs=5e-4)
    assert row["high"] == pytest.approx(0.051, abs=5e-4)
    assert found.loc[("drone: after 2 s of memory", rivals.ENCODER), "difference"] < 0


def test_the_figure_has_a_panel_for_each_question():
    found = rivals.beside_p()
    figure = rivals.draw(found)
    titles = [ax.get_title().split("\n")[0] for ax in figure.axes]
    assert titles == [*found.index.unique("question")]
