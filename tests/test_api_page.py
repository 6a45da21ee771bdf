"""The page of names says what the code says."""

import re

import make_api

import clothlab


def test_the_page_is_that_of_the_code():
    assert make_api.PAGE.read_text("utf-8") == make_api.page(), "run `make format`"


def test_every_name_of_the_method_has_its_place_and_text():
    page = make_api.page()
    modules = [*clothlab._METHOD.values(), make_api.MORE]
    names = [name for each in modules for names in each.values() for name in names]
    assert re.findall(r"^### (\w+)$", page, re.MULTILINE) == names
    for part in page.split("### ")[1:]:
        assert len(part.split()) > 8, part


def test_parameters_are_split_where_no_bracket_is_open():
    assert list(make_api._split("a: dict[str, int], b=(1, 2), *, c")) == [
        "a: dict[str, int]",
        "b=(1, 2)",
        "*",
        "c",
    ]
