"""Weekly problems: the model solutions get every point that a program gives, plausible
mistakes don't, and students find none of it.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from course.problems import (
    covariance_of_p,
    memoryless,
    sampling_or_gradient,
    stability_bound,
)
from course.problems.grade import FUNCTIONS, ROOT, judge

PAGES = ROOT / "docs" / "course" / "problems"
SOLUTIONS = {
    "stability_bound": stability_bound.longest_step,
    "memoryless": memoryless.train_memoryless,
    "covariance_of_p": covariance_of_p.covariance_of_p,
    "sampling_or_gradient": sampling_or_gradient.cem,
}


def one_spring(count, stiffness, damping, mass):
    return 2 * np.sqrt(mass / stiffness)


def helpful_damper(count, stiffness, damping, mass):
    return stability_bound.longest_step(count, stiffness, -damping, mass)


def nothing_changes(runs, updates, rate, seed):
    return lambda s, u, material: np.tile(s, (len(u), 1))


def random_draws(loss, mean, spread, lower, upper, calls, rng):
    plans = np.clip(rng.normal(mean, spread, (calls, 8, 2)), lower, upper)
    return plans[loss(plans).argmin()]


def too_many(loss, mean, spread, lower, upper, calls, rng):
    return sampling_or_gradient.cem(loss, mean, spread, lower, upper, 4 * calls, rng)


MISTAKES = [
    ("stability_bound", one_spring, 2),
    ("stability_bound", helpful_damper, 4),
    ("memoryless", nothing_changes, 0),
    ("covariance_of_p", covariance_of_p.textbook, 3),
    ("sampling_or_gradient", random_draws, 1),
    ("sampling_or_gradient", too_many, 3),
]


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLUTIONS)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_model_solution_gets_every_point(name, seed):
    parts = judge(name, SOLUTIONS[name], seed)
    assert [part for part in parts if part.points < part.most] == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "wrong", "points"), MISTAKES)
def test_a_plausible_mistake_gets_fewer(name, wrong, points):
    parts = judge(name, wrong)
    assert sum(part.points for part in parts) == points, parts


def test_an_answer_that_raises_gets_nothing():
    parts = judge("stability_bound", lambda *values: 1 / 0)
    assert not any(part.points for part in parts)
    assert all("ZeroDivisionError" in part.words for part in parts)


@pytest.mark.parametrize("page", sorted(PAGES.glob("[a-z]*.md")), ids=lambda p: p.stem)
def test_a_page_gives_ten_points_and_no_solution(page):
    text = page.read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| ", text, re.MULTILINE)
    assert sum(map(int, rows)) == 10
    for name in FUNCTIONS.values():
        assert f"return {name}" not in text
    if page.stem in FUNCTIONS:
        assert f"def {FUNCTIONS[page.stem]}(" in text
        assert "<details><summary>Hint" in text


def test_the_site_and_the_syllabus_lead_to_every_problem():
    toctree = (ROOT / "docs" / "book" / "index.md").read_text("utf-8")
    syllabus = (ROOT / "docs" / "course" / "syllabus.md").read_text("utf-8")
    for page in PAGES.glob("*.md"):
        assert f"docs/course/problems/{page.stem}" in toctree
        if page.stem != "README":
            assert f"(problems/{page.name})" in syllabus


def test_solutions_lie_where_no_edition_takes_them():
    folder = Path(stability_bound.__file__).parent
    assert folder.relative_to(ROOT) == Path("course/problems")
    assert not list(PAGES.glob("*.py"))
