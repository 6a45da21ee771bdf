"""The page's JavaScript is written as Prettier writes it."""

import format_javascript
import pytest

from course.npm import packages

pytestmark = pytest.mark.book


def test_it_is_formatted():
    if not packages()["prettier"].folder.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    written = format_javascript.formatted()
    assert len(written) > 5
    differ = [
        path.name for path, text in written.items() if path.read_text("utf-8") != text
    ]
    assert differ == [], "run `make format`"
