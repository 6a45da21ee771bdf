"""`make format`: the page of the method's public names, `docs/api.md`.

It is read where nobody built the site. All of it stands in the code: signatures as they
are written, fields with their comments, docstrings.
"""

import ast
import importlib
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import clothlab

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "api.md"
HEAD = """# The method's names

What `pip install clothlab` brings, by subject, as in `clothlab/__init__.py`. Each is
imported as `from clothlab import NAME`. `make format` writes this page from the code.
Shapes are in brackets: `B` plans or sequences, `T` steps, `D_s` states, `D_u` commands,
`D_p` numbers of p. [Your own robot](your_own_robot.md) shows how they work together.
"""
# What these take and return, imported from its own module.
MORE = {
    "method.estimation": ["EstimationSettings"],
    "method.gauss_newton": ["NewtonSettings", "Linearisation", "linearise"],
    "method.iterative": ["IterativeLearningSettings", "IterativeSearch"],
    "method.autoencoder": ["train_autoencoder", "AutoencoderTraining", "Autoencoder"],
    "method.datasets": ["runs_from_minari", "runs_from_lerobot"],
    "method.training_options": ["TrainingOptions", "Epoch"],
    "method.several": ["train_several"],
    "method.deploy": ["Beat", "Ranges", "RangeWatch"],
    "method.onnx_export": [
        "export_prediction",
        "export_estimation",
        "export_solve",
        "export_onnx",
    ],
    "method._watch": ["TrainingTrace"],
}
# A docstring's sections, and how the page calls them.
SECTIONS = {"Args:": "Takes", "Returns:": "Returns", "Raises:": "Raises"}


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for subject, modules in clothlab._METHOD.items():
        parts.append(f"## {subject}\n")
        for module, names in modules.items():
            parts += [_entry(module, name) for name in names]

    parts.append("# What they take and return\n")
    parts.append(
        "Imported from the module that is named, where you need them at all.\n"
    )
    for module, names in MORE.items():
        parts.append(f"## clothlab.{module}\n")
        parts += [_entry(module, name) for name in names]
    return "\n".join(parts)


def _entry(module: str, name: str) -> str:
    """Of one name: where it is, how it is called, and what its docstring says."""
    item = getattr(importlib.import_module(f"clothlab.{module}"), name)
    node = ast.parse(textwrap.dedent(inspect.getsource(item))).body[0]
    path = f"clothlab/{module.replace('.', '/')}.py"
    lines = [f"### {name}", "", f"`{path}`", ""]
    lines += ["```python", _call(name, node, item), "```", ""]
    lines.append(_text(inspect.getdoc(item) or ""))
    if isinstance(node, ast.ClassDef):
        members = [line for each in _nodes(node, item) for line in _members(each, item)]
        lines += ["", "**Has**", "", *members] if members else []
    return "\n".join(lines).rstrip() + "\n"


def _nodes(node: ast.ClassDef, item: Any) -> Iterator[ast.ClassDef]:
    """A class, and those of ours from which it has more and that no one imports."""
    yield node
    for base in item.__mro__[1:]:
        ours = base.__module__.startswith("clothlab.method")
        if ours and base.__name__ not in clothlab.__all__:
            source = textwrap.dedent(inspect.getsource(base))
            found = ast.parse(source).body[0]
            assert isinstance(found, ast.ClassDef)
            yield found


def _call(name: str, node: ast.AST, item: Any) -> str:
    """How it is called; of a dataclass its fields, as they are written."""
    if isinstance(node, ast.FunctionDef):
        return _signature(name, node)
    assert isinstance(node, ast.ClassDef)
    for each in node.body:
        if isinstance(each, ast.FunctionDef) and each.name == "__init__":
            return _signature(name, each)
    fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
    if not fields:
        return f"class {name}"

    # From the first field to the last, with the comments between.
    source = textwrap.dedent(inspect.getsource(item)).splitlines()
    last = max(each.end_lineno or 0 for each in fields)
    written = source[fields[0].lineno - 1 : last]
    return f"class {name}:\n" + "\n".join(written)


def _signature(name: str, function: ast.FunctionDef) -> str:
    """As it is written, one parameter a line where one line is too short."""
    arguments = ast.unparse(function.args)
    arguments = arguments.removeprefix("self").removeprefix("cls").lstrip(", ")
    result = "" if function.returns is None else f" -> {ast.unparse(function.returns)}"
    if function.name == "__init__":
        result = ""
    line = f"{name}({arguments}){result}"
    if len(line) <= 88:
        return line
    inner = "".join(f"    {each},\n" for each in _split(arguments))
    return f"{name}(\n{inner}){result}"


def _split(arguments: str) -> Iterator[str]:
    """Parameters one by one, at commas that stand in no bracket."""
    depth = 0
    begin = 0
    for k, letter in enumerate(arguments):
        depth += (letter in "[(") - (letter in "])")
        if letter == "," and not depth:
            yield arguments[begin:k].strip()
            begin = k + 1
    yield arguments[begin:].strip()


def _members(node: ast.ClassDef, item: Any) -> Iterator[str]:
    """A line for each public method and property of a class."""
    for each in node.body:
        if not isinstance(each, ast.FunctionDef) or each.name.startswith("_"):
            continue
        first = (inspect.getdoc(getattr(item, each.name)) or "").split("\n\n")[0]
        decorated = [ast.unparse(mark) for mark in each.decorator_list]
        called = each.name
        if "property" not in decorated:
            called = _signature(each.name, each).replace("\n", " ")
            called = " ".join(called.split()).replace("( ", "(").replace(", )", ")")
        yield f"- `{called}`: {' '.join(first.split())}"


def _text(docstring: str) -> str:
    """A docstring as Markdown: its sections become lists."""
    lines = []
    section = ""
    for line in docstring.splitlines():
        if line in SECTIONS:
            section = line
            lines += [f"**{SECTIONS[line]}**", ""]
        elif section and line.startswith("    ") and section != "Returns:":
            name, colon, rest = line.strip().partition(": ")
            starts = line[4] != " " and colon
            lines.append(f"- `{name}`: {rest}" if starts else f"  {line.strip()}")
        else:
            lines.append(line.removeprefix("    ") if section else line)
    return "\n".join(lines)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
