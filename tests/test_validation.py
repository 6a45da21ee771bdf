"""What is refused where input enters, and that the sentence names it."""

import json
from dataclasses import FrozenInstanceError, asdict, dataclass

import numpy as np
import pytest

from clothlab._validation import (
    Checked,
    check_array,
    check_name,
    check_number,
    choose,
    setting,
)
from clothlab.method.data import Run

NO_NUMBERS = [np.nan, np.inf, "1", None, True, 1j, [1.0], 10**400]


@dataclass(frozen=True)
class Widths(Checked):
    several: tuple[float, ...] = setting((1.0,), at_least=0)
    pair: tuple[int, int] = setting((1, 2), above=0, at_most=9)
    name: str = "x"


def test_choosing_returns_what_the_name_stands_for():
    assert choose("fruit", "fig", {"fig": 1, "plum": 2}) == 1


@pytest.mark.parametrize("name", ["felt", "", None, 3, ["fig"]])
def test_an_unknown_name_lists_the_choices(name):
    with pytest.raises(KeyError, match=r"unknown fruit .*; choose from fig, plum"):
        choose("fruit", name, {"fig": 1, "plum": 2})


@pytest.mark.parametrize(
    "name", ["target-1", "a", "torque_0", "großes-Ziel", "7", "damp0.03-mass0.05_1"]
)
def test_a_plain_name_is_a_good_name(name):
    assert check_name("target", name) == name


@pytest.mark.parametrize(
    "name",
    ["", "..", "../x", "/etc/x", "a\\b", ".hidden", "a b", "a.png", "a\n", None, 3],
)
def test_a_name_that_leads_elsewhere_or_hides_is_refused(name):
    with pytest.raises(
        ValueError, match="the name of a target has letters, digits, - and _ only"
    ):
        check_name("target", name)


@pytest.mark.parametrize(
    "given", [[1, 2], np.array([1, 2], np.uint8), np.array([True, False]), (1.0, 2)]
)
def test_an_array_is_converted_and_copied(given):
    array = check_array("p", given, (2,), np.float32)
    assert array.dtype == np.float32
    assert np.array_equal(array, np.asarray(given, float))
    assert not np.shares_memory(array, np.asarray(given))


def test_a_shape_may_leave_sizes_free():
    assert check_array("x", np.zeros((5, 0)), ("N", 0)).shape == (5, 0)
    assert check_array("x", np.zeros((4, 3, 2)), (..., 2)).shape == (4, 3, 2)
    with pytest.raises(
        ValueError, match=r"x is \[..., 3\] and finite, got the shape \[4, 2\]"
    ):
        check_array("x", np.zeros((4, 2)), (..., 3))


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (None, "None"),
        ("abc", "abc"),
        (["1", "2"], r"\['1', '2'\]"),
        ([[1], [2, 3]], r"\[\[1\], \[2, 3\]\]"),
        ([1, 2, 3], r"the shape \[3\]"),
        ([[1, 2]], r"the shape \[1, 2\]"),
        ([1, np.nan], "nan"),
        ([1, 1e39], "inf"),
        ([1, 10**400], "1000"),
        ([0.1 + 9j, 2], "9j"),
        (np.array(["2024-01-01", "2024-01-02"], "M8[D]"), "2024-01-01"),
        (np.array([["x" * 100]] * 3), "x{70}"),
    ],
)
def test_what_is_no_such_array_is_refused_in_one_line(value, found):
    with pytest.raises(
        ValueError, match=rf"p is \[2\] and finite, got .*{found}"
    ) as caught:
        check_array("p", value, (2,), np.float32)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 130


@pytest.mark.parametrize(
    ("value", "kind"), [(3, int), (np.int8(3), int), (3, float), (np.float32(3), float)]
)
def test_a_number_of_any_library_becomes_pythons(value, kind):
    number = check_number("n", value, kind)
    assert type(number) is kind
    assert number == 3


@pytest.mark.parametrize("kind", [float, int])
@pytest.mark.parametrize("wrong", [*NO_NUMBERS, np.ones(2)], ids=str)
def test_what_is_no_number_of_the_kind_is_refused(kind, wrong):
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
    with pytest.raises(
        ValueError, match=rf"n must be (at least|above|at most) \d, got {wrong}"
    ):
        check_number("n", wrong, **bounds)


def test_settings_take_lists_and_numpy_and_can_be_written_as_json():
    widths = Widths([1, np.float32(2)], np.array([3, 4]))
    assert json.loads(json.dumps(asdict(widths))) == {
        "several": [1.0, 2.0],
        "pair": [3, 4],
        "name": "x",
    }
    assert Widths(3).several == (3.0,)
    with pytest.raises(FrozenInstanceError):
        widths.name = "y"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"several": (1.0, -1)}, "Widths.several must be at least 0, got -1"),
        ({"pair": (1, 10)}, "Widths.pair must be at most 9, got 10"),
        ({"pair": (1, 2.5)}, "Widths.pair is a whole number, got 2.5"),
        ({"pair": (1, 2, 3)}, r"Widths.pair has 2 entries, got \(1, 2, 3\)"),
        ({"name": 3}, "Widths.name is a str, got 3"),
    ],
)
def test_a_setting_that_is_refused_is_named(given, message):
    with pytest.raises(ValueError, match=message):
        Widths(**given)


def test_what_holds_arrays_equals_nothing_but_itself():
    """A cache by runs would otherwise give one of them what belongs to another."""
    one, other = (Run(np.full((3, 2), k), np.zeros((3, 1)), "a") for k in (0, 1))
    assert one == one
    assert one != other
    assert len({one, other}) == 2
    assert Widths(3) == Widths(3.0) != Widths(4)
