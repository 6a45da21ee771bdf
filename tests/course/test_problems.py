"""Weekly problems: the model solutions get every point that a program gives, plausible
mistakes don't, and students find none of it.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from course.problems import covariance_of_p, memory_probe, one_plan, stability_bound
from course.problems.grade import FUNCTIONS, ROOT, judge

PAGES = ROOT / "docs" / "course" / "problems"
SOLUTIONS = {
    "stability_bound": stability_bound.longest_step,
    "memory_probe": memory_probe.share_known,
    "covariance_of_p": covariance_of_p.covariance_of_p,
    "one_plan": one_plan.plan_for_all,
}


def one_spring(count, stiffness, damping, mass):
    return 2 * np.sqrt(mass / stiffness)


def helpful_damper(count, stiffness, damping, mass):
    return stability_bound.longest_step(count, stiffness, -damping, mass)


def known_of_some_steps(features, values):
    """Every fifth step is judged by a map that is fitted to its neighbours."""
    x = np.concatenate([np.c_[run, np.ones(len(run))] for run in features])
    y = np.concatenate(values)
    judged = np.arange(len(y)) % 5 == 0
    weights = np.linalg.lstsq(x[~judged], y[~judged])[0]
    errors = y[judged] - x[judged] @ weights
    return 1 - (errors**2).sum() / ((y[judged] - y.mean()) ** 2).sum()


def known_without_a_penalty(features, values):
    x = [np.c_[run, np.ones(len(run))] for run in features]
    errors = []
    for out in range(len(values)):
        others = [run for run in range(len(values)) if run != out]
        pairs = [np.concatenate([each[run] for run in others]) for each in (x, values)]
        errors.append(values[out] - x[out] @ np.linalg.lstsq(*pairs)[0])
    return 1 - np.mean(np.square(errors)) / np.var(values)


def random_draws(losses, mean, spread, lower, upper, calls, rng):
    size = calls // len(losses)
    plans = np.clip(rng.normal(mean, spread, (size, 8, 2)), lower, upper)
    return plans[np.max([loss(plans) for loss in losses], axis=0).argmin()]


def too_many(losses, mean, spread, lower, upper, calls, rng):
    more = calls * len(losses)
    return one_plan.plan_for_all(losses, mean, spread, lower, upper, more, rng)


def for_the_mean(losses, *others):
    def mean_loss(plans):
        return np.mean([loss(plans) for loss in losses], axis=0)

    start, spread, lower, upper, calls, rng = others
    calls = calls // len(losses)
    return one_plan.plan_for_all([mean_loss], start, spread, lower, upper, calls, rng)


MISTAKES = [
    ("stability_bound", one_spring, 2),
    ("stability_bound", helpful_damper, 4),
    ("memory_probe", known_of_some_steps, 2),
    ("memory_probe", known_without_a_penalty, 4),
    ("covariance_of_p", covariance_of_p.textbook, 3),
    ("one_plan", random_draws, 1),
    ("one_plan", too_many, 3),
    ("one_plan", for_the_mean, 3),
]


# Other reference values are asked for each night
SEEDS = (
    pytest.param(0, marks=pytest.mark.slow),
    pytest.param(1, marks=pytest.mark.nightly),
)


@pytest.mark.parametrize("name", SOLUTIONS)
@pytest.mark.parametrize("seed", SEEDS)
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
