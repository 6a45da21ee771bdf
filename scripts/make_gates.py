"""Write what the tests of the live lab in a page measured into that page.

They are run before: `pytest -m "book or nightly" tests/book`. A figure that was not
measured stays as the page has it.
"""

import re

from course.lab_gates import GATES, Gate, kept
from course.repository import ROOT
from studies._pages import put_between, table

PAGE = ROOT / "docs" / "book" / "throw.md"
BEGIN = "<!-- gates -->"
END = "<!-- /gates -->"


def text_of(gate: Gate, number: float) -> str:
    """A number of a gate, with its unit."""
    digits = f"{number:.2g}" if number < 0.001 else f"{number:.4g}"
    return f"{digits} {gate.unit}".strip()


def main() -> None:
    """Write the table."""
    before = dict(
        re.findall(r"^\| (.*?) \| .*? \| (.*?) \|$", PAGE.read_text("utf-8"), re.M)
    )
    measured = kept()
    lines = [("", "bound", "measured")]
    for name, gate in GATES.items():
        side = "at least" if gate.least else "at most"
        bound = f"{side} {text_of(gate, gate.bound)}"
        if name in measured:
            found = text_of(gate, measured[name])
        else:
            found = before.get(gate.about, "not yet")
        lines.append((gate.about, bound, found))
    put_between(PAGE, f"\n{table(lines)}\n", BEGIN, END)


if __name__ == "__main__":
    main()
