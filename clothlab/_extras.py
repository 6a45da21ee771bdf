"""What is said where a package is missing that only an extra brings."""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


def lacking(what: str, module: str | None, extra: str) -> ModuleNotFoundError:
    """The error that says which extra brings a missing module."""
    return ModuleNotFoundError(
        f"{what} needs {module}: pip install 'clothlab[{extra}]'", name=module
    )


def require(what: str, module: str, extra: str) -> None:
    """Raise that error if the module is not installed; it is not imported."""
    if find_spec(module) is None:
        raise lacking(what, module, extra)


def bring(what: str, module: str, extra: str) -> ModuleType:
    """Import a module that only an extra brings, or raise that error."""
    require(what, module.partition(".")[0], extra)
    return import_module(module)
