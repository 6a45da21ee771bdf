"""What is refused where input enters, and that the sentence names it."""

import dataclasses
import importlib
import importlib.util
import inspect
import json
import pkgutil
import typing
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

import clothlab
from clothlab._validation import Checked, check_array, check_name, check_number, choose, setting

WRONG: dict[Any, list[Any]] = {
    float: [float("nan"), float("inf"), "1", None, True, 1j, [1.0]],
    int: [float("nan"), float("inf"), 1.5, "3", None, True, [1]],
    str: [3, None, b"name"],
}


def import_all() -> None:
    """Import every module that may hold settings, so that every class of them is there to be found."""
    for name in clothlab.__all__:
        if importlib.util.find_spec(f"clothlab.{name}"):
            module = importlib.import_module(f"clothlab.{name}")
            for inner in pkgutil.walk_packages(getattr(module, "__path__", ()), f"{module.__name__}."):
                importlib.import_module(inner.name)


def settings_classes(parent: type = Checked) -> Iterator[type[Checked]]:
    """Every class of settings; those that hold arrays have tests of their own."""
    for cls in parent.__subclasses__():
        yield from settings_classes(cls)
        ours = cls.__module__.startswith("clothlab") and not inspect.isabstract(cls)
        if ours and all(field.type is not np.ndarray for field in fields(cls)):
            yield cls


def example(cls: type) -> Any:
    """An instance with the defaults, and something plain where there are none."""
    needed = [field for field in fields(cls) if field.init and _without_default(field)]
    return cls(**{field.name: plain(field.type) for field in needed})


def _without_default(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def plain(kind: Any) -> Any:
    if typing.get_origin(kind) is tuple:
        return tuple(plain(each) for each in typing.get_args(kind) if each is not ...)
    return example(kind) if dataclasses.is_dataclass(kind) else kind(1)


import_all()
CLASSES = sorted(settings_classes(), key=lambda cls: f"{cls.__module__}.{cls.__name__}")
FIELDS = [pytest.param(cls, field, id=f"{cls.__name__}.{field.name}") for cls in CLASSES for field in fields(cls)]


def wrong_values(field: dataclasses.Field) -> list[Any]:
    """What a field must not take: other types, and numbers just outside its bounds."""
    kinds = typing.get_args(field.type) or (field.type,)
    wrong = list(WRONG.get(kinds[0], [None] if isinstance(kinds[0], type) else []))
    for word, bound in field.metadata.get("bounds", {}).items():
        wrong.append({"at_least": bound - 1, "above": bound, "at_most": bound + 1}[word])
    if typing.get_origin(field.type) is not tuple:
        return wrong
    rest = getattr(example_of_owner(field), field.name)[1:]
    too_many = [] if ... in kinds else [(*rest, *rest, *rest)]
    return [(value, *rest) for value in wrong] + too_many + [None]


def example_of_owner(field: dataclasses.Field) -> Any:
    return example(next(cls for cls in CLASSES if field in fields(cls)))


@pytest.mark.parametrize(("cls", "field"), FIELDS)
def test_every_setting_refuses_what_it_is_not_and_says_its_name(cls, field):
    good = example(cls)
    for wrong in wrong_values(field):
        with pytest.raises(ValueError, match=rf"{cls.__name__}\.{field.name} "):
            replace(good, **{field.name: wrong})


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_settings_can_be_written_as_json_though_they_were_given_numbers_of_numpy(cls):
    good = example(cls)
    given = {name: np.array(value) for name, value in asdict(good).items() if isinstance(value, int | float | tuple)}
    again = replace(good, **{name: value if value.ndim else value[()] for name, value in given.items()})
    assert json.loads(json.dumps(asdict(again))) == json.loads(json.dumps(asdict(good)))


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_settings_cannot_be_changed_in_place(cls):
    first = fields(cls)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(example(cls), first, getattr(example(cls), first))


def test_a_list_is_as_good_as_a_tuple_and_one_number_stands_for_one_entry():
    @dataclass(frozen=True)
    class Widths(Checked):
        several: tuple[float, ...] = setting((1.0,), at_least=0)

    assert Widths([1, np.float32(2)]).several == (1.0, 2.0)
    assert Widths(3).several == (3.0,)
    with pytest.raises(ValueError, match=r"Widths.several must be at least 0, got -1"):
        Widths((1.0, -1))


def test_choosing_returns_what_the_name_stands_for():
    assert choose("fruit", "fig", {"fig": 1, "plum": 2}) == 1


@pytest.mark.parametrize("name", ["felt", "", None, 3, ["fig"], {}])
def test_an_unknown_name_lists_the_choices(name):
    with pytest.raises(KeyError, match=r"unknown fruit .*; choose from fig, plum"):
        choose("fruit", name, {"fig": 1, "plum": 2})


def test_where_there_is_nothing_to_choose_that_is_said():
    with pytest.raises(KeyError, match="choose from nothing so far"):
        choose("fruit", "fig", {}, none_yet="nothing so far")


@pytest.mark.parametrize("name", ["target-1", "a", "torque_0", "großes-Ziel", "7", "damp0.03-mass0.05_1"])
def test_a_plain_name_is_a_good_name(name):
    assert check_name("target", name) == name


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        "../x",
        "/etc/x",
        "a/b",
        "a\\b",
        ".hidden",
        "-x",
        "a b",
        "a.png",
        "a.1",
        "1.a",
        "1..2",
        "1.",
        ".1",
        "a\n",
        "a\0",
        None,
        3,
        b"a",
    ],
)
def test_a_name_that_leads_elsewhere_or_hides_is_refused(name):
    with pytest.raises(ValueError, match="the name of a target has letters, digits, - and _ only"):
        check_name("target", name)


def test_an_array_is_converted_and_keeps_its_numbers():
    array = check_array("p", [1, 2], (2,), np.float32)
    assert array.dtype == np.float32
    assert array.tolist() == [1, 2]
    assert check_array("x", np.zeros((5, 0)), ("N", 0)).shape == (5, 0)


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (None, r"the shape \[\]"),
        ("abc", "abc"),
        ([1, "x"], r"\[1, 'x'\]"),
        ([[1], [2, 3]], r"\[\[1\], \[2, 3\]\]"),
        (1.0, r"the shape \[\]"),
        ([], r"the shape \[0\]"),
        ([1, 2, 3], r"the shape \[3\]"),
        ([[1, 2]], r"the shape \[1, 2\]"),
        ([1, np.nan], "nan"),
        ([np.inf, 1], "inf"),
        ([1, 1e39], "inf"),
        ([1, 10**400], "1000"),
        ([1j, 2], "1j"),
        ({"a": 1}, "a"),
        (object(), "object"),
        ("x" * 10_000, "x{80}$"),
    ],
)
def test_an_array_that_is_none_is_refused_in_one_short_sentence(value, found):
    with pytest.raises(ValueError, match=rf"p is \[2\] and finite, got {found}|got .*{found}"):
        check_array("p", value, (2,), np.float32)


@pytest.mark.parametrize(("value", "kind"), [(3, int), (np.int8(3), int), (3, float), (np.float32(3), float)])
def test_a_number_of_any_library_becomes_pythons(value, kind):
    number = check_number("n", value, kind)
    assert type(number) is kind
    assert number == 3


@pytest.mark.parametrize("kind", [float, int])
def test_what_is_no_number_of_the_kind_is_refused(kind):
    for wrong in WRONG[kind]:
        with pytest.raises(ValueError, match=r"n is a (finite|whole) number, got "):
            check_number("n", wrong, kind)


@pytest.mark.parametrize(
    ("bounds", "wrong", "right"),
    [
        ({"at_least": 1}, 0.99, 1),
        ({"above": 0}, 0, 1e-9),
        ({"at_most": 5}, 5.01, 5),
        ({"above": 0, "at_most": 5}, 6, 5),
    ],
)
def test_a_number_stays_within_its_bounds(bounds, wrong, right):
    assert check_number("n", right, **bounds) == right
    with pytest.raises(ValueError, match=rf"n must be (at least|above|at most) \d, got {wrong}"):
        check_number("n", wrong, **bounds)


def test_an_array_that_entered_belongs_to_whoever_took_it():
    given = np.array([1.0, 2.0])
    taken = check_array("p", given, (2,))
    given[0] = 9.0
    assert taken[0] == 1.0
