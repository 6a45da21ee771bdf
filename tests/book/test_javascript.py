"""The page's JavaScript is written as Prettier writes it."""

import format_javascript
import pytest

from course.lab_page import SOURCES
from course.npm import packages

pytestmark = pytest.mark.book

LINES = 1497  # at most, of what the page's own files have together


def test_it_is_formatted():
    if not packages()["prettier"].folder.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    written = format_javascript.formatted()
    assert len(written) > 5
    differ = [
        path.name for path, text in written.items() if path.read_text("utf-8") != text
    ]
    assert differ == [], "run `make format`"


def test_it_is_no_longer_than_it_has_to_be():
    lines = {
        path.name: len(path.read_text("utf-8").splitlines())
        for path in SOURCES.glob("*.js")
    }
    assert len(lines) > 5
    assert sum(lines.values()) <= LINES, lines
