"""The page of names says what the code says."""

import re

import make_api

import clothlab


def test_the_page_is_that_of_the_code():
    assert make_api.PAGE.read_text("utf-8") == make_api.page(), "run `make format`"


def test_every_name_of_the_method_has_its_place_and_text():
    page = make_api.page()
    names = [name for each in clothlab._CONTENTS[""].values() for name in each]
    names += [name for each in make_api.MORE.values() for name in each]
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
