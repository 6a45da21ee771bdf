"""What keeps the project in shape: layers, names, units, sizes, files."""

import ast
import dataclasses
import importlib
import inspect
import re
import tomllib
from pathlib import Path

import pytest

import clothlab

ROOT = Path(clothlab.__file__).parents[1]
PACKAGE = ROOT / "clothlab"
LAYERS = ["_validation", "_files", "alt_text", "simulation", "policies", "trials", "learning", "artifacts"]
LAYERS += [
    "table_scene",
    "analysis",
    "training_configs",
    "datasets",
    "experiments",
    "plots",
    "tasks",
    "cluster",
    "reproduce",
    "lab",
]
LAYERS += ["checks", "__main__"]
MODULES = sorted(PACKAGE.rglob("*.py"))


def imported(path):
    """Layers that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "clothlab":
            parts = node.module.split(".")
            yield from [parts[1]] if len(parts) > 1 else [alias.name for alias in node.names]


def layer(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_only(path):
    if path == PACKAGE / "__init__.py":
        assert not set(imported(path))
    else:
        below = LAYERS[: LAYERS.index(layer(path))]
        assert set(imported(path)) <= {*below, layer(path)}


def test_every_module_has_its_layer():
    assert {layer(path) for path in MODULES} - {"__init__"} == set(LAYERS)


def name_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def public(module):
    """What a module defines under names without an underscore."""
    for name, item in vars(module).items():
        if not name.startswith("_") and getattr(item, "__module__", None) == module.__name__:
            yield name, item


@pytest.mark.parametrize("path", [path for path in MODULES if path.stem != "__main__"], ids=name_of)
def test_what_is_public_is_documented(path):
    module = importlib.import_module(name_of(path))
    assert module.__doc__
    for name, item in public(module):
        if inspect.isclass(item) or inspect.isfunction(item):
            assert item.__doc__, f"{module.__name__}.{name}"
        for method, each in vars(item).items() if inspect.isclass(item) else ():
            if not method.startswith("_") and (inspect.isfunction(each) or isinstance(each, property)):
                assert inspect.getdoc(getattr(item, method)), f"{module.__name__}.{name}.{method}"


@pytest.mark.parametrize("name", clothlab.__all__)
def test_modules_are_found_as_attributes(name):
    assert getattr(clothlab, name) is importlib.import_module(f"clothlab.{name}")
    assert name in dir(clothlab)


def test_unknown_modules_list_the_choices():
    with pytest.raises(AttributeError, match="clothlab has no 'alchemy'; it has analysis, artifacts"):
        clothlab.alchemy  # noqa: B018


def settings_classes():
    for path in MODULES:
        if path.stem == "__main__":
            continue
        module = importlib.import_module(name_of(path))
        for _, item in public(module):
            if dataclasses.is_dataclass(item) and issubclass(item, clothlab._validation.Checked):
                yield item


@pytest.mark.parametrize("cls", list(settings_classes()), ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_every_number_of_a_setting_has_its_unit(cls):
    for field in dataclasses.fields(cls):
        if not isinstance(field.type, str) and "float" in str(field.type):
            assert field.metadata.get("unit"), f"{cls.__name__}.{field.name} has no unit"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_rooms_stay_small(path):
    for node in ast.walk(ast.parse(path.read_text())):
        lines = getattr(node, "end_lineno", 0) - getattr(node, "lineno", 0) + 1
        if isinstance(node, ast.ClassDef):
            assert lines < 250, f"{node.name} has {lines} lines"
        elif isinstance(node, ast.FunctionDef):
            assert lines < 50, f"{node.name} has {lines} lines"


def test_nothing_asks_which_policy_or_arm_it_is_talking_to():
    for path in MODULES:
        for call in re.findall(r"isinstance\([^)]*\)", path.read_text()):
            assert not re.search(r"ControlPolicy|MuscleArm|TorqueArm", call), f"{path.name}: {call}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_every_module_has_its_tests(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    if parts[-1] in ("__init__", "__main__"):
        return
    choices = [f"test_{name}.py" for name in ("_".join(p.strip("_") for p in parts), parts[-1].strip("_"), parts[0])]
    tested = {"policies": "trials", "trained": "artifacts"}.get(parts[-1], parts[-1])
    choices.append(f"test_{tested}.py")
    assert any((ROOT / "tests" / name).exists() for name in choices), f"no tests/{choices[1]}"


def pins(name):
    return dict(re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / name).read_text(), flags=re.MULTILINE))


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_lock_holds_all_that_is_asked_for():
    locked = {normal(name): version for name, version in pins("environment.txt").items()}
    asked = {normal(name): version for name, version in pins("environment.in").items()}
    assert asked.items() <= locked.items(), "run `make lock`"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    names = {normal(re.match(r"[\w.-]+", need)[0]) for need in project["dependencies"]}
    assert names <= set(asked)


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == clothlab.__version__
    assert f"version: {clothlab.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {clothlab.__version__}" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize("name", ["README.md", "CHANGELOG.md", "data/README.md"])
def test_links_between_files_lead_somewhere(name):
    path = ROOT / name
    for link in re.findall(r"\]\(([^)#:]+)\)", path.read_text()):
        assert (path.parent / link).exists(), f"{name}: {link}"
