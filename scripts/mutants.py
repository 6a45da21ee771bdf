"""The mutants of a Python file: small changes of what it computes, one at a time.

A number grows, a sign or a comparison turns, a condition is negated, a call, an
argument or a limit is left out. Texts, annotations, decorators, errors and progress
bars stay.
"""

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

SWAPPED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
COMPARED = {  # a limit is moved by nothing, or the other side is taken
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_PAIRS = ("min max", "amin amax", "argmin argmax", "any all", "sin cos")
_PAIRS += ("minimum maximum", "zeros ones", "mean sum")
RENAMED = dict(pair.split() for pair in _PAIRS)
RENAMED |= {b: a for a, b in RENAMED.items()}
LEFT_OUT = {"clamp", "clamp_min", "clip", "abs", "square", "sqrt", "copy"}

_FIELDS = {"annotation", "returns", "decorator_list"}  # which say nothing that runs
_NODES = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
_TALK = {"tqdm", "set_postfix", "warn", "TypeVar", "ParamSpec"}  # calls that talk
_WORDS = {"bar", "desc", "unit", "disable", "progress", "stacklevel", "strict"}


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: str  # from the repository's root
    line: int  # where it is, counted from 1
    lines: range  # of the statement up to there: a test that passes through runs one
    inside: bool  # a function; else it runs when the module is imported
    before: str  # the changed lines, on one line
    after: str
    source: str  # of the whole file after the change


def mutants_of(path: str, source: str) -> Iterator[Mutant]:
    """Yield every mutant of a file's source, in order."""
    for node, statement, inside in _walk(ast.parse(source)):
        for old, new in _changes(node):
            yield _mutant(path, source, statement, inside, old, new)


def _walk(
    node: ast.AST, statement: ast.AST | None = None, inside: bool = False
) -> Iterator[tuple[ast.AST, ast.AST, bool]]:
    """Every node that may change, with its statement, and whether a function has it."""
    if isinstance(node, ast.stmt):
        statement = node
    if statement is not None:
        yield node, statement, inside
    for name, value in ast.iter_fields(node):
        if name in _FIELDS:
            continue
        in_body = inside or (isinstance(node, ast.FunctionDef) and name == "body")
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_talk(child):
                yield from _walk(child, statement, in_body)


def _is_talk(node: ast.AST) -> bool:
    """Whether a node says something to people, or to a type checker."""
    if isinstance(node, ast.keyword):
        return node.arg in _WORDS
    if isinstance(node, ast.Expr):
        return _is_talk(node.value)
    return isinstance(node, _NODES) or _name_of(node) in _TALK


def _name_of(node: ast.AST) -> str:
    """What a call calls: the name of a function or method."""
    function = getattr(node, "func", None)
    return getattr(function, "attr", None) or getattr(function, "id", "")


def _changes(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Pairs of a node and what takes its place."""
    operator = type(getattr(node, "op", None))
    if operator in SWAPPED:
        yield node, _with(node, op=SWAPPED[operator]())
    if isinstance(node, ast.Compare):
        for other in COMPARED[type(node.ops[0])]:
            yield node, _with(node, ops=[other(), *node.ops[1:]])
    if operator in (ast.Not, ast.USub):
        yield node, node.operand
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield node, ast.Constant(_other_number(node.value))
    for test in getattr(node, "ifs", [getattr(node, "test", None)]):
        if test is not None:
            yield test, ast.UnaryOp(ast.Not(), test)
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield node, ast.Pass()
    if isinstance(node, ast.Call):
        yield from _changed_calls(node)


def _other_number(value: float) -> float:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return 2 * value if value else 1.0


def _changed_calls(node: ast.Call) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Without an argument; another function in its place; or what it was called on."""
    for argument in node.keywords:
        word = getattr(argument.value, "value", None)
        if argument.arg not in _WORDS and not isinstance(word, str):
            others = [each for each in node.keywords if each is not argument]
            yield node, _with(node, keywords=others)
    name = _name_of(node)
    function = node.func
    if isinstance(function, ast.Attribute):
        if name in RENAMED:
            yield node, _with(node, func=_with(function, attr=RENAMED[name]))
        if (name in LEFT_OUT and not isinstance(function.value, ast.Name)) or (
            name in LEFT_OUT and function.value.id not in ("np", "torch", "math")
        ):
            yield node, function.value
    elif name in ("min", "max", "any", "all"):
        yield node, _with(node, func=ast.Name(RENAMED[name]))


def _with(node: ast.AST, **changes: object) -> ast.AST:
    changed = copy.copy(node)
    vars(changed).update(changes)
    return changed


def _mutant(
    path: str, source: str, statement: ast.AST, inside: bool, old: ast.AST, new: ast.AST
) -> Mutant:
    """Write `new` in the place of `old`, and leave all other text as it is."""
    lines = source.encode().splitlines(keepends=True)
    first = old.lineno - 1
    last = old.end_lineno
    before = b"".join(lines[first:last])
    head = before[: old.col_offset]
    tail = lines[last - 1][old.end_col_offset :]
    text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(new)))
    after = head + (text if isinstance(old, ast.stmt) else f"({text})").encode() + tail
    return Mutant(
        path,
        old.lineno,
        range(statement.lineno, last + 1),
        inside,
        " ".join(before.decode().split()),
        " ".join(after.decode().split()),
        b"".join([*lines[:first], after, *lines[last:]]).decode(),
    )
