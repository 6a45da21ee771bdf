"""Judge a student's file: `python course/problems/grade.py NAME FILE`.

The function in it meets reference values that are made anew; points and a sentence for
each part are printed. The file runs with the rights of who calls this.
"""

import argparse
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FUNCTIONS = {
    "stability_bound": "longest_step",
    "memory_probe": "share_known",
    "covariance_of_p": "covariance_of_p",
    "one_plan": "plan_for_all",
}


class Part(NamedTuple):
    """One thing that is judged."""

    points: int
    most: int
    words: str


def judge(name: str, answer: Callable, seed: int = 0) -> list[Part]:
    """What an answer to a problem gets for each part.

    An answer that raises an error gets nothing from there on.
    """
    module = importlib.import_module(f"course.problems.{name}")
    parts: Iterator[tuple[int, str, Callable[[], bool]]] = module.parts(answer, seed)
    found = []
    for most, words, holds in parts:
        try:
            held = bool(holds())
            said = words if held else f"not yet: {words}"
        except Exception as error:
            held = False
            said = f"not yet: {words} ({type(error).__name__}: {error!s:.80})"
        found.append(Part(most * held, most, said))
    return found


def main() -> None:
    """Judge one file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=FUNCTIONS)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seed", type=int, default=0, help="of the reference values")
    arguments = parser.parse_args()

    # Their file as a module of its own
    spec = importlib.util.spec_from_file_location("handed_in", arguments.file)
    assert spec is not None, "no Python file"
    assert spec.loader is not None, "no Python file"
    handed_in = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(handed_in)
    answer = getattr(handed_in, FUNCTIONS[arguments.name])
    parts = judge(arguments.name, answer, arguments.seed)
    for part in parts:
        print(f"{part.points}/{part.most}  {part.words}")
    most = sum(part.most for part in parts)
    print(f"{sum(part.points for part in parts)} of {most} that a program can judge")


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
