"""What keeps the project in shape: budgets, layers, names, units, files."""

import ast
import contextlib
import dataclasses
import importlib
import inspect
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import (
    PackageNotFoundError,
    distribution,
    packages_distributions,
)
from pathlib import Path

import make_locks
import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

import clothlab
from clothlab._validation import Checked

ROOT = Path(clothlab.__file__).parents[1]
PACKAGE = ROOT / "clothlab"
STUDIES = ROOT / "studies"
MODULES = sorted(PACKAGE.rglob("*.py"))
STUDY_MODULES = sorted(STUDIES.rglob("*.py"))
SCRIPTS = sorted((ROOT / "scripts").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
LAYERS = [
    "_extras",
    "_validation",
    "_files",
    "_store",
    "_alt_text",
    "_certainty",
    "masks",
    "method",
    "simulation",
    "policies",
    "trials",
    "calibration",
]
LAYERS += [
    "cloth_checkpoint",
    "data",
    "analysis",
    "tables",
    "claims",
    "plots",
    "diagrams",
    "lab",
    "checks",
    "__main__",
    "studies",
    "scripts",
]
BUDGETS = {  # at most; lines are only reported
    "lines of clothlab": None,
    "lines of clothlab without lab, checks": None,
    "lines of studies": None,
    "lines of scripts": None,
    "lines of tests": None,
    "rooms": 20,
    "floors": 9,  # the studies steer the live lab
    "imports between rooms": 95,
    # An exercise has one check, which only its page calls.
    "public names without the checks of exercises": 160,
}


def room(path):
    """The module or folder of the package that a file belongs to, or the studies, or
    the scripts.
    """
    if path.is_relative_to(PACKAGE):
        return path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return "studies" if path.is_relative_to(STUDIES) else "scripts"


@cache
def tree(path):
    return ast.parse(path.read_text())


def imported(path):
    """Rooms that a file imports."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import) and room(path) != "studies":
            yield from (
                "studies"
                for alias in node.names
                if alias.name.split(".")[0] == "studies"
            )
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in (
            "clothlab",
            "studies",
        ):
            parts = node.module.split(".")
            if parts[0] == "studies":
                yield from ["studies"] * (room(path) != "studies")
                continue
            names = (
                [parts[1]] if len(parts) > 1 else [alias.name for alias in node.names]
            )
            yield from (
                name
                for name in names
                if name != room(path) and not name.startswith("__")
            )


@cache
def doors():
    """Every pair of rooms of which the first imports the second."""
    return {
        (room(path), name)
        for path in [*MODULES, *STUDY_MODULES, *SCRIPTS]
        for name in imported(path)
    }


@cache
def floor_of(name):
    return 1 + max(
        (floor_of(below) for above, below in doors() if above == name), default=0
    )


def lines(paths):
    return sum(len(path.read_text().splitlines()) for path in paths)


def is_private(module):
    """Whether a part of a module's name begins with one underscore."""
    return any(
        part.startswith("_") and not part.startswith("__") for part in module.split(".")
    )


def defined(path):
    """Functions, classes and constants that a module defines."""
    for node in tree(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        if isinstance(node, ast.Assign):
            yield from (each.id for each in node.targets if isinstance(each, ast.Name))
        if isinstance(node, ast.AnnAssign):
            yield node.target.id


def passed_on(path):
    """What a folder's door (its `__init__`) takes from rooms behind it that are private."""
    for node in tree(path).body:
        if isinstance(node, ast.ImportFrom) and is_private(node.module or ""):
            yield from (alias.asname or alias.name for alias in node.names)


def public_names(path):
    """Names without an underscore that a reader can import from a module, counted once.

    A module with an underscored part in its path is nobody's door: what it defines counts
    only where an `__init__` passes it on.
    """
    closed = is_private(name_of(path)) or path.stem == "__main__"  # a program
    names = set() if closed else set(defined(path))
    if path.name == "__init__.py":
        names |= set(passed_on(path))
    return {name for name in names if not name.startswith("_")}


MEASURES = {
    "lines of clothlab": lambda: lines(MODULES),
    "lines of clothlab without lab, checks": lambda: lines(
        path for path in MODULES if room(path) not in ("lab", "checks")
    ),
    "lines of studies": lambda: lines(STUDY_MODULES),
    "lines of scripts": lambda: lines(SCRIPTS),
    "lines of tests": lambda: lines(TESTS),
    "rooms": lambda: len(
        {
            room(path)
            for path in [*MODULES, *STUDY_MODULES, *SCRIPTS]
            if path not in MODULES or not is_private(name_of(path))
        }
    ),
    "floors": lambda: max(
        floor_of(room(path)) for path in [*MODULES, *STUDY_MODULES, *SCRIPTS]
    ),
    "imports between rooms": lambda: len(doors()),
    "public names without the checks of exercises": lambda: sum(
        len(public_names(path)) for path in MODULES if room(path) != "checks"
    ),
}


@pytest.mark.parametrize("name", BUDGETS)
def test_budget(name):
    found, most = MEASURES[name](), BUDGETS[name]
    print(f"\n{name:54}{found:7,}" + (f" of {most:7,}" if most else ""))
    assert most is None or found <= most


def test_imports_go_down_only():
    for path in [*MODULES, *STUDY_MODULES, *SCRIPTS]:
        below = (
            ["_extras"]
            if path == PACKAGE / "__init__.py"
            else LAYERS[: LAYERS.index(room(path))]
        )
        assert set(imported(path)) <= set(below), path


def test_every_room_has_its_layer():
    assert {room(path) for path in MODULES} - {"__init__"} | {
        "studies",
        "scripts",
    } == set(LAYERS)


def test_the_table_scene_knows_of_no_study():
    for path in (STUDIES / "table_scene").rglob("*.py"):
        others = re.findall(
            r"(?:from|import) studies(?!\.table_scene)\S*", path.read_text()
        )
        assert others == [], path


def name_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(
        ".__init__"
    )


def public(module):
    """What a module defines under names without an underscore."""
    for name, item in vars(module).items():
        if (
            not name.startswith("_")
            and getattr(item, "__module__", None) == module.__name__
        ):
            yield name, item


def documented():
    """Every public class, function, method and property of the package, with its
    docstring.
    """
    for path in [*MODULES, *STUDY_MODULES]:
        if path.stem != "__main__":
            module = importlib.import_module(name_of(path))
            yield module.__name__, module.__doc__
            for name, item in public(module):
                if inspect.isclass(item) or inspect.isfunction(item):
                    yield f"{module.__name__}.{name}", item.__doc__
                for method, each in vars(item).items() if inspect.isclass(item) else ():
                    if not method.startswith("_") and (
                        inspect.isfunction(each) or isinstance(each, property)
                    ):
                        yield (
                            f"{module.__name__}.{name}.{method}",
                            inspect.getdoc(getattr(item, method)),
                        )


def test_what_is_public_is_documented():
    assert [name for name, text in documented() if not text] == []


def settings_classes(parent=Checked):
    for cls in parent.__subclasses__():
        yield cls
        yield from settings_classes(cls)


def test_every_number_of_a_setting_has_its_unit():
    list(documented())  # which imports every module
    for cls in settings_classes():
        for field in (
            dataclasses.fields(cls) if cls.__module__.startswith("clothlab") else ()
        ):
            if not isinstance(field.type, str) and "float" in str(field.type):
                assert field.metadata.get("unit"), (
                    f"{cls.__name__}.{field.name} has no unit"
                )


def test_nothing_asks_which_policy_or_arm_it_is_talking_to():
    for path in [*MODULES, *STUDY_MODULES]:
        for call in re.findall(r"isinstance\([^)]*\)", path.read_text()):
            assert not re.search(
                r"ControlPolicy|MuscleArm|TorqueArm|GripperArm", call
            ), f"{path.name}: {call}"


# Each holds what these parts of pyproject.toml name, and what the locks before it lack
LOCKS = {
    "environment.txt": ("dependencies", "cloth", "notebooks", "sysid", "robots"),
    "environment-dev.txt": ("cluster", "dev"),
    "docs/requirements.txt": ("book",),
}


def pins(name):
    """Versions that a lock pins, by canonical name."""
    lines = [
        line
        for line in (ROOT / name).read_text().splitlines()
        if "==" in line and not line.startswith("#")
    ]
    return {
        canonicalize_name(line.split("==")[0]): line.split("==")[1].split(" ;")[0]
        for line in lines
    }


def named(*parts):
    """Canonical names in parts of pyproject.toml."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = settings["project"]
    lists = (
        project["optional-dependencies"]
        | settings["dependency-groups"]
        | {"dependencies": project["dependencies"]}
    )
    names = {
        canonicalize_name(Requirement(need).name)
        for part in parts
        for need in lists[part]
    }
    return names - {"clothlab"}  # an extra may ask for another one


def test_the_locks_pin_all_that_is_named_once():
    seen = set()
    for lock, parts in LOCKS.items():
        assert named(*parts) <= set(pins(lock)) | seen, f"{lock}: run `make lock`"
        assert not seen & set(pins(lock)), "one version of everything"
        seen |= set(pins(lock))


def test_who_runs_notebooks_installs_no_developers_tools():
    tools = named("dev") | {"dask", "distributed", "django"}
    assert tools & set(pins("environment.txt")) == set()


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_names_no_host_no_build_and_nothing_of_cuda(name):
    text = "".join(
        line
        for line in (ROOT / name).read_text().splitlines(True)
        if not line.startswith("#")
    )
    assert re.findall(r"https?:|--\w+|\+cpu|nvidia\S*|cuda\S*|triton\S*", text) == []


@pytest.mark.parametrize("lock", LOCKS)
def test_what_is_pinned_runs_on_the_python_of_debian_12(lock):
    for name, version in pins(lock).items():
        with contextlib.suppress(PackageNotFoundError):
            about = distribution(name)
            if about.version.split("+")[0] == version:
                assert SpecifierSet(about.metadata.get("Requires-Python", "")).contains(
                    make_locks.OLDEST
                ), name


def imported_packages(paths):
    """Packages beside the standard library that files import, as the names that pip
    knows.
    """
    known = packages_distributions()
    for path in paths:
        for node in ast.walk(tree(path)):
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else []
            )
            names += (
                [node.module]
                if isinstance(node, ast.ImportFrom) and not node.level
                else []
            )
            for name in {each.split(".")[0] for each in names} - {
                *sys.stdlib_module_names,
                "clothlab",
                "studies",
            }:
                yield {canonicalize_name(each) for each in known[name]}


# Rooms by the extra that brings what they import; what stands in none comes with
# `notebooks`.
BARE = {"__init__", "_validation", "_files", "_extras", "masks", "method"}
CLOTH = {"_certainty", "_store", "simulation", "policies", "trials", "calibration"}
CLOTH |= {"cloth_checkpoint", "data", "__main__"}


@pytest.mark.slow
@pytest.mark.parametrize("extra", ["", "cloth", "notebooks"])
def test_what_is_imported_is_named(extra):
    """An extra brings all that its rooms import, and the ones before it do not."""
    rooms = {"": BARE, "cloth": BARE | CLOTH}.get(extra)
    parts = [
        "dependencies",
        *{"cloth": ["cloth"], "notebooks": ["cloth", "notebooks"]}.get(extra, []),
    ]
    paths = [path for path in MODULES if rooms is None or room(path) in rooms]
    if extra == "notebooks":
        paths += STUDY_MODULES
        parts += ["sysid"]
    unnamed = [names for names in imported_packages(paths) if not names & named(*parts)]
    assert unnamed == []


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == clothlab.__version__
    assert f"version: {clothlab.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {clothlab.__version__}" in (ROOT / "CHANGELOG.md").read_text()
