"""Mutants: what is changed and what is left alone, which tests run, and the score."""

import ast

import mutate
import pytest
from mutants import mutants_of

SOURCE = '''"""Two plus two."""

LIMIT: float = 0.5  # at most


@cache(size=3)
def least(a: int, b: int = 1) -> int:
    """Say 1 + 1."""
    if not a < b and a:
        raise ValueError(f"{a + 1} is too large")
    for _ in tqdm(range(2), disable=True):
        check(a)
    return min(a, -b, key=LIMIT).clamp(0)
'''


@pytest.fixture
def found():
    return list(mutants_of("least.py", SOURCE))


def test_every_mutant_is_another_program(found):
    trees = {ast.dump(ast.parse(mutant.source)) for mutant in found}
    assert len(trees) == len(found)
    assert ast.dump(ast.parse(SOURCE)) not in trees


def test_numbers_signs_comparisons_conditions_and_calls_are_changed(found):
    after = [mutant.after for mutant in found]
    for wanted in (
        "LIMIT: float = (1.0) # at most",
        "def least(a: int, b: int = (2)) -> int:",
        "if not (a <= b) and a:",
        "if not (a >= b) and a:",
        "if (not a < b or a):",
        "if (a < b) and a:",
        "if (not (not a < b and a)):",
        "pass",
        "return (max(a, -b, key=LIMIT)).clamp(0)",
        "return (min(a, -b)).clamp(0)",
        "return min(a, (b), key=LIMIT).clamp(0)",
        "return (min(a, -b, key=LIMIT))",
        "return min(a, -b, key=LIMIT).clamp((1))",
    ):
        assert wanted in after
    assert len(after) == 13


def test_texts_annotations_decorators_errors_and_bars_stay(found):
    untouched = ("cache", "raise", "tqdm", '"""')
    assert not [m for m in found if any(word in m.before for word in untouched)]


def test_a_mutant_knows_the_lines_that_a_test_must_pass_through(found):
    by_line = {mutant.line: mutant for mutant in found}
    assert not by_line[3].inside
    assert not by_line[7].inside  # a default is a number of the module
    assert by_line[9].inside
    assert by_line[13].lines == range(13, 14)


def test_of_the_tests_that_reach_it_those_of_its_own_file_come_first(found):
    recorded = {
        "durations": {
            "tests/test_other.py::slow": 0.1,
            "tests/test_other.py::quick": 0.2,
            "tests/test_least.py::own": 3.0,
            "tests/test_least.py::elsewhere": 0.1,
        },
        "slow": [],
        "reached": {"least.py": {"13": [1, 2], "12": [3]}},
    }
    last = next(mutant for mutant in found if mutant.line == 13)
    reached = mutate.tests_of(last, recorded)
    names = ["tests/test_least.py::own", "tests/test_other.py::quick"]
    assert list(reached) == names
    first = next(mutant for mutant in found if mutant.line == 3)
    assert (
        len(mutate.tests_of(first, recorded)) == 3
    )  # whatever passes through the file


@pytest.mark.parametrize(("killed", "enough"), [(17, True), (16, False)])
def test_the_score_counts_survivors_that_are_accepted(
    found, killed, enough, monkeypatch, tmp_path, capsys
):
    mutant = found[0]
    accepted = tmp_path / "mutants.toml"
    accepted.write_text(
        f"[[mutant]]\npath = 'least.py'\nbefore = '{mutant.before}'\n"
        f"after = '{mutant.after}'\nreason = 'it is only a limit'\n"
    )
    monkeypatch.setattr(mutate, "ACCEPTED", accepted)
    outcomes = [(mutant, "killed")] * (killed - 1) + [(mutant, "timeout")]
    outcomes += [(mutant, "survived")] * (20 - killed)
    assert mutate.report(outcomes) == enough
    printed = capsys.readouterr().out
    assert "least.py:3: survived; it is only a limit" in printed
    assert f"- {mutant.before}\n+ {mutant.after}" in printed
    assert f"score: {5 * killed}.0 % are killed" in printed
