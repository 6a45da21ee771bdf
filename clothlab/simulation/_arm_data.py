"""Arms by their names, and what files say of them."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from clothlab._files import OtherKindError
from clothlab._validation import choose
from clothlab.simulation.arm import ARMS, Arm, Camera


def get_arm(arm: Arm | str) -> Arm:
    """Return the arm of that name; an arm is returned as it is."""
    return arm if isinstance(arm, Arm) else choose("arm", arm, ARMS)


def arm_data(arm: Arm) -> str | dict[str, Any]:
    """Return what a file says of an arm: its class and fields.

    One of `ARMS` is only named. A changed arm is written as what it is, even where it
    has kept its name.
    """
    if arm in ARMS.values():
        return arm.name
    return {"class": type(arm).__name__, **asdict(arm)}


def arm_from_data(data: str | dict[str, Any]) -> Arm:
    """Return the arm of which a file says this.

    An `OtherKindError` if it is none of `ARMS`, or no class of arms that is defined
    here has this name: one's own is imported before its file is read.
    """
    if isinstance(data, str):
        if data not in ARMS:
            known = ", ".join(ARMS)
            raise OtherKindError(f"its arm {data!r} is unknown; known are {known}")
        return ARMS[data]

    fields = dict(data)
    name = fields.pop("class")
    classes = {each.__name__: each for each in _subclasses(Arm)}
    if name not in classes:
        known = ", ".join(classes)
        raise OtherKindError(
            f"its class of arms {name!r} is unknown; known are {known}. "
            "Import yours before reading the file"
        )
    fields["camera"] = Camera(**_tuples(fields["camera"]))
    return classes[name](**_tuples(fields))


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    """The same fields, with tuples for JSON's lists."""
    return {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in fields.items()
    }


def _subclasses(parent: type) -> Iterator[type]:
    """Every class below this one that is defined at this moment."""
    child: type
    for child in parent.__subclasses__():
        yield child
        yield from _subclasses(child)
