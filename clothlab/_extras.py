"""What is said where a package is missing that only an extra brings."""

from importlib.util import find_spec


def lacking(what: str, module: str | None, extra: str) -> ModuleNotFoundError:
    """The error that says which extra brings a missing module."""
    return ModuleNotFoundError(
        f"{what} needs {module}: pip install 'clothlab[{extra}]'", name=module
    )


def require(what: str, module: str, extra: str) -> None:
    """Raise that error if the module is not installed; it is not imported."""
    if find_spec(module) is None:
        raise lacking(what, module, extra)
