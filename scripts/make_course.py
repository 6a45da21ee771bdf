"""The syllabus, for `make book`: weeks from `docs/course/weeks.toml`, all else from the notebooks' own cells."""

import ast
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import nbformat

PLANS = {"six": "Six weeks", "three": "Three weeks"}
LEFT_OUT = "In no week of this plan"


@dataclass(frozen=True)
class Lesson:
    """What a notebook says of itself.

    Attributes:
        name: of its file, without the ending.
        title: from its first cell, with its number.
        goals: what a student can do afterwards.
        minutes: of work.
        exercises: their titles, in order.
        functions: that they ask for, by name.
        points: that they count.
    """

    name: str
    title: str
    goals: tuple[str, ...]
    minutes: int
    exercises: tuple[str, ...]
    functions: tuple[str, ...]
    points: tuple[int, ...]


def read_lesson(path: Path, weights: Mapping[str, int] | None = None) -> Lesson:
    """The lesson in the notebook at `path`.

    Args:
        path: of the notebook.
        weights: points of exercises, by their functions' names; one for each that is not there.

    Raises:
        ValueError: its first cell lacks goals or a working time.
    """
    cells = nbformat.read(path, as_version=4).cells
    first = cells[0].source
    goals = re.search(r"\*\*Goals\*\*\n+((?:- .*\n?)+)", first)
    minutes = re.search(r"\*\*Working time\*\*: about (\d+) minutes", first)
    if not goals or not minutes:
        raise ValueError(
            f"{path.name}: the first cell has **Goals** with a list, and **Working time**: about … minutes"
        )
    lines = tuple(line.removeprefix("- ").rstrip(".") for line in goals[1].strip().splitlines())
    names = functions(cells)
    points = tuple((weights or {}).get(name, 1) for name in names)
    title = first.splitlines()[0].removeprefix("# ")
    return Lesson(path.stem, title, lines, int(minutes[1]), exercises(cells), names, points)


def functions(cells: list[nbformat.NotebookNode]) -> tuple[str, ...]:
    """Names of the functions that the stubs ask for, in order."""
    stubs = [ast.parse(cell.source).body for cell in cells if "stub" in cell.metadata.get("tags", [])]
    return tuple(node.name for body in stubs for node in body if isinstance(node, ast.FunctionDef))


def exercises(cells: list[nbformat.NotebookNode]) -> tuple[str, ...]:
    """Titles of the exercises: the last heading, or number in bold, before each stub."""
    titles, last = [], ""
    for cell in cells:
        if cell.cell_type == "markdown":
            found = re.findall(r"^(?:\*\*\d+\.|#+ Exercise \d+:) (.+?)(?:\*\*|$)", cell.source, re.MULTILINE)
            last = found[-1].rstrip(".") if found else last
        elif "stub" in cell.metadata.get("tags", []):
            titles.append(last)
    return tuple(titles)


def syllabus(plans: Mapping[str, list[dict]], lessons: Mapping[str, Lesson]) -> str:
    """The page, in Markdown.

    Args:
        plans: weeks of each plan, as `weeks.toml` has them.
        lessons: by the numbers of their notebooks.

    Raises:
        ValueError: a week has a notebook that does not exist.
    """
    unknown = {number for weeks in plans.values() for week in weeks for number in week["notebooks"]} - set(lessons)
    if unknown:
        raise ValueError(f"weeks.toml: no notebook {', '.join(sorted(unknown))}; there are {', '.join(lessons)}")
    parts = [
        "# Syllabus\n\nWorking times are those that the notebooks give: reading, running, predicting and exercises. An "
        "exercise counts its points, in brackets, for a check that says *correct*, and none otherwise."
    ]
    for plan, weeks in plans.items():
        held = [lessons[number] for week in weeks for number in week["notebooks"]]
        parts.append(f"## {PLANS.get(plan, plan)}\n\n{_amount(held)} in all.")
        for k, week in enumerate(weeks, 1):
            its = [lessons[number] for number in week["notebooks"]]
            parts.append(f"### Week {k} of {len(weeks)}: {week['title']}\n\n{_amount(its)}.")
            parts += [_entry(lesson) for lesson in its]
            parts.append(f"To discuss: {week['question']}")
        rest = [lesson for lesson in lessons.values() if lesson not in held]
        if rest:
            parts.append(f"{LEFT_OUT}: {', '.join(map(_link, rest))}.")
    return "\n\n".join(parts) + "\n"


def _amount(lessons: list[Lesson]) -> str:
    hours, points = sum(lesson.minutes for lesson in lessons) / 60, sum(sum(lesson.points) for lesson in lessons)
    return f"About {hours:.1f} hours of work, {points} point{'s' * (points != 1)}"


def _link(lesson: Lesson) -> str:
    return f"[{lesson.title}](../notebooks/{lesson.name}.ipynb)"


def _entry(lesson: Lesson) -> str:
    goals = "\n".join(f"- {goal}." for goal in lesson.goals)
    tasks = (
        " · ".join(f"*{title}* ({n})" for title, n in zip(lesson.exercises, lesson.points, strict=True)) or "nothing"
    )
    return f"**{_link(lesson)}**, {lesson.minutes} minutes. Afterwards a student can:\n\n{goals}\n\nTo hand in: {tasks}"


def write_syllabus(weeks: Path, notebooks: list[Path]) -> str:
    """The page from `weeks.toml` and the notebooks.

    Raises:
        ValueError: it has points for an exercise that does not exist.
    """
    plan = tomllib.loads(weeks.read_text("utf-8"))
    lessons = {path.stem[:2]: read_lesson(path, plan["points"]) for path in notebooks}
    unknown = set(plan["points"]) - {name for lesson in lessons.values() for name in lesson.functions}
    if unknown:
        raise ValueError(f"weeks.toml: no exercise {', '.join(sorted(unknown))}")
    return syllabus({name: plan[name] for name in PLANS}, lessons)
