"""What keeps the project in shape: layers, names, units, notebooks."""

import ast
import dataclasses
import importlib
import json
import re
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
LAYERS = ["_choices", "_files", "cloth", "arm", "vision", "env", "trials", "autoencoder", "dpmpb"]
LAYERS += ["estimation", "control", "analysis", "plots", "artifacts", "session", "widgets", "checks", "__main__"]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def sources(name):
    """The files of a layer: one module, or the modules of a package."""
    path = ROOT / "clothlab" / name
    return sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


@pytest.mark.parametrize("name", LAYERS)
def test_imports_go_down_only(name):
    used = set()
    for node in (node for path in sources(name) for node in ast.walk(ast.parse(path.read_text()))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("clothlab"):
            parts = node.module.split(".")
            used |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
    within = {name} if len(sources(name)) > 1 else set()
    assert used <= set(LAYERS[: LAYERS.index(name)]) | within


def test_every_module_has_its_layer():
    files = {path.relative_to(ROOT / "clothlab").parts[0] for path in (ROOT / "clothlab").rglob("*.py")}
    assert {name.removesuffix(".py") for name in files} - {"__init__"} == set(LAYERS)


@pytest.mark.parametrize("name", clothlab.__all__)
def test_exported_names_exist_and_are_documented(name):
    module = importlib.import_module(f"clothlab.{name}")
    assert module.__doc__
    for public in module.__all__:
        item = getattr(module, public)
        if callable(item) and item.__module__.startswith(module.__name__):
            assert item.__doc__, f"{name}.{public}"


def settings_classes():
    for name in clothlab.__all__:
        module = importlib.import_module(f"clothlab.{name}")
        for item in vars(module).values():
            if (
                dataclasses.is_dataclass(item)
                and item.__module__ == module.__name__
                and item.__dataclass_params__.frozen
            ):
                yield item


@pytest.mark.parametrize("cls", list(settings_classes()), ids=lambda cls: cls.__name__)
def test_every_parameter_has_its_unit(cls):
    for field in dataclasses.fields(cls):
        holds_data = "ndarray" in str(field.type) or cls.__name__ in ("Trial", "Sequences", "MaterialReadout", "Moment")
        if not holds_data:
            assert field.metadata.get("unit"), f"{cls.__name__}.{field.name} has no unit"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_stripped_and_short(path):
    notebook = json.loads(path.read_text())
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            assert len(cell["source"]) <= 30, "a cell that a student cannot read at a glance"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_follow_the_rhythm(path):
    notebook = json.loads(path.read_text())
    text = "".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown").lower()
    for part in ("goals", "prerequisites", "running time", "exercise", "summary", "references"):
        assert part in text, f"{path.stem} lacks its {part}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_ci_changes_only_parameters_that_exist(path):
    """The runner assigns `mock` after the cell that carries it, and looks for it on cells only."""
    notebook = json.loads(path.read_text())
    assert "nbmake" not in notebook["metadata"], "mock belongs to the cell that is tagged parameters"
    for cell in notebook["cells"]:
        mock = cell["metadata"].get("nbmake", {}).get("mock", {})
        names = re.findall(r"^(\w+) = ", "".join(cell["source"]), flags=re.MULTILINE)
        assert set(mock) <= set(names)
        assert not mock or "parameters" in cell["metadata"].get("tags", [])


def test_the_readme_maps_every_notebook():
    readme = (ROOT / "README.md").read_text()
    for path in NOTEBOOKS:
        assert path.name in readme
