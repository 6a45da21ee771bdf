"""Reading budgets: how easily the code is read, held by what can be counted.

Lengths are counted without docstrings, which say why and may be as long as they need.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
FILES = [
    path
    for room in ("clothlab", "studies", "course", "scripts", "examples")
    for path in sorted((ROOT / room).rglob("*.py"))
]
METHOD = [path for path in FILES if path.is_relative_to(ROOT / "clothlab" / "method")]
WIDEST = 88  # columns
LONGEST_FUNCTION = 40  # lines
LONGEST_CLASS = 180  # lines
SHORT = 20  # lines; a longer function has a phrase before each paragraph
MANY = 5  # parameters; from here on a docstring has `Args:`
MEAN_OF_METHOD = 48  # characters of a line that is not blank
MEAN = 52


@cache
def lines(path):
    return path.read_text("utf-8").splitlines()


@cache
def nodes(path):
    return list(ast.walk(ast.parse(path.read_text("utf-8"))))


def all_of(kind):
    for path in FILES:
        for node in nodes(path):
            if isinstance(node, kind):
                yield path, node


def where(path, node):
    name = getattr(node, "name", "")
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)} {name}".strip()


def docstring_length(node):
    if ast.get_docstring(node) is None:
        return 0
    return node.body[0].end_lineno - node.body[0].lineno + 1


def length(node):
    """Lines of a function or class, without the docstrings in it."""
    inner = [n for n in ast.walk(node) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    return node.end_lineno - node.lineno + 1 - sum(map(docstring_length, inner))


def parameters(function):
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return [each.arg for each in named if each.arg not in ("self", "cls")]


def mean_width(paths):
    written = [line for path in paths for line in lines(path) if line.strip()]
    return sum(map(len, written)) / len(written)


@pytest.mark.parametrize(
    ("paths", "most"), [(METHOD, MEAN_OF_METHOD), (FILES, MEAN)], ids=["method", "all"]
)
def test_budget_of_a_line(paths, most):
    found = mean_width(paths)
    name = "the method" if paths is METHOD else "all code"
    print(f"\n{'characters of a line of ' + name:54}{found:7.1f} of {most:7}")
    assert found <= most


def test_no_line_is_wider_than_a_page():
    wide = [
        f"{path.relative_to(ROOT)}:{k}"
        for path in FILES
        for k, line in enumerate(lines(path), 1)
        if len(line) > WIDEST
    ]
    assert wide == []


def unrelated(node):
    """Whether a statement assigns several things at once, and is no swap."""
    if not isinstance(node.value, ast.Tuple | ast.List):
        return False
    for target in node.targets:
        if isinstance(target, ast.Tuple | ast.List):
            left = sorted(map(ast.unparse, target.elts))
            right = sorted(map(ast.unparse, node.value.elts))
            if len(left) == len(right) and left != right:
                return True
    return False


def test_a_statement_assigns_one_thing():
    found = [where(*each) for each in all_of(ast.Assign) if unrelated(each[1])]
    assert found == []


def test_functions_and_classes_are_taken_in_at_once():
    long = [
        where(*each)
        for each in all_of(ast.FunctionDef)
        if length(each[1]) > LONGEST_FUNCTION
    ]
    long += [
        where(*each) for each in all_of(ast.ClassDef) if length(each[1]) > LONGEST_CLASS
    ]
    assert long == []


def paragraphs(path, function):
    """The parts of a function between blank lines, without its docstring."""
    first = function.body[0].lineno - 1 + docstring_length(function)
    text = "\n".join(lines(path)[first : function.end_lineno])
    return [part.splitlines() for part in re.split(r"\n\s*\n", text) if part.strip()]


def says_nothing(paragraph):
    """Whether a paragraph of some length has no phrase, and is no function either."""
    commented = any(line.strip().startswith("#") for line in paragraph)
    defines = re.match(r"\s*(def|@|class)\b", paragraph[0])
    return len(paragraph) > 3 and not commented and not defines


def test_a_long_function_has_paragraphs_with_phrases():
    found = []
    for path, function in all_of(ast.FunctionDef):
        if length(function) > SHORT:
            parts = paragraphs(path, function)
            # The first may go without: the docstring is its phrase.
            if len(parts) < 2 or sum(map(says_nothing, parts)) > 1:
                found.append(where(path, function))
    assert found == []


def test_many_parameters_are_explained_one_by_one():
    found = []
    for path, function in all_of(ast.FunctionDef):
        many = len(parameters(function)) >= MANY
        private = function.name.startswith("_")
        explained = "Args:" in (ast.get_docstring(function) or "")
        if many and not private and not explained:
            found.append(where(path, function))
    for path, made in all_of(ast.ClassDef):
        for function in made.body:
            constructs = getattr(function, "name", "") == "__init__"
            if constructs and len(parameters(function)) >= MANY:
                texts = (ast.get_docstring(made), ast.get_docstring(function))
                if "Args:" not in f"{texts}" and not made.name.startswith("_"):
                    found.append(where(path, made))
    assert found == []


def test_a_docstring_begins_with_one_line():
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    found = []
    for each in all_of(kinds):
        text = (ast.get_docstring(each[1]) or "").splitlines()
        if len(text) > 1 and text[1].strip():
            found.append(where(*each))
    assert found == []
