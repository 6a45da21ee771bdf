"""What is refused where input enters, and that the sentence names it."""

import numpy as np
import pytest

from clothlab._validation import check_array, check_name, check_number, choose
from clothlab.method.data import Run


def test_a_choice_is_what_its_name_stands_for_and_another_lists_them():
    assert choose("fruit", "fig", {"fig": 1, "plum": 2}) == 1
    with pytest.raises(KeyError, match=r"unknown fruit 'felt'; choose from fig, plum"):
        choose("fruit", "felt", {"fig": 1, "plum": 2})


@pytest.mark.parametrize("name", ["target-1", "großes-Ziel", "damp0.03-mass0.05_1"])
def test_a_plain_name_is_a_good_name(name):
    assert check_name("target", name) == name


@pytest.mark.parametrize("name", ["", "../x", "a\\b", ".hidden", "a b", "a.png"])
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
        ([[1], [2, 3]], r"\[\[1\], \[2, 3\]\]"),
        ([1, 2, 3], r"the shape \[3\]"),
        ([1, np.nan], "nan"),
    ],
)
def test_what_is_no_such_array_is_refused_in_one_line(value, found):
    with pytest.raises(
        ValueError, match=rf"p is \[2\] and finite, got .*{found}"
    ) as caught:
        check_array("p", value, (2,), np.float32)
    assert "\n" not in str(caught.value)


def test_a_number_of_any_library_becomes_pythons_within_its_bounds():
    assert type(check_number("n", np.int8(3), int)) is int
    assert type(check_number("n", np.float32(3), at_least=1, at_most=5)) is float
    with pytest.raises(ValueError, match=r"n is a whole number, got 2\.5"):
        check_number("n", 2.5, int)
    with pytest.raises(ValueError, match="n must be above 0, got 0"):
        check_number("n", 0, above=0)


def test_what_holds_arrays_equals_nothing_but_itself():
    """A cache by runs would otherwise give one of them what belongs to another."""
    one, other = (Run(np.full((3, 2), k), np.zeros((3, 1)), "a") for k in (0, 1))
    assert one == one
    assert one != other
    assert len({one, other}) == 2
