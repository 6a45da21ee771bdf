"""Looking things up by name, with an error that helps whoever mistyped it."""

from collections.abc import Mapping
from typing import TypeVar

__all__ = ["choose"]

T = TypeVar("T")


def choose(kind: str, name: str, choices: Mapping[str, T], none_yet: str = "(none)") -> T:
    """Return `choices[name]`.

    Args:
        kind: what the choices are, for the message.
        name: which one.
        choices: all there are.
        none_yet: what to say where there are none.

    Raises:
        KeyError: unknown name; the message lists the choices.
    """
    if name not in choices:
        raise KeyError(f"unknown {kind} {name!r}; choose from {', '.join(choices) or none_yet}")
    return choices[name]
