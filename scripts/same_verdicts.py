"""Do README, `docs/results.md` and notebook 15 say the same of each claim?

    same_verdicts.py [NOTEBOOK]

The notebook is an executed one, by default that of `make notebooks`. Printed are all
claims of which two pages say something different; the exit status is 1 if there is one,
or if a page has no verdict at all.
"""

import sys
from pathlib import Path

import nbformat

from studies.claims import VERDICTS

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "build" / "small" / "15_results.ipynb"
Verdicts = dict[str, tuple[str, ...]]  # of each amount of recordings, by the claim


def verdicts_in(text: str) -> Verdicts:
    """Verdicts of a page's tables in Markdown, by the claim in bold."""
    found = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        _, mark, rest = cells[0].partition("**")
        claim, end, _ = rest.partition("**")
        verdicts = tuple(cell for cell in cells[1:] if cell in VERDICTS)
        if mark and end and verdicts:
            found[claim] = verdicts
    return found


def shown_by(notebook: Path) -> str:
    """All tables in Markdown that an executed notebook shows."""
    shown = []
    for cell in nbformat.read(notebook, as_version=4).cells:
        for output in cell.get("outputs", []):
            shown.append(output.get("data", {}).get("text/markdown", ""))
    return "\n".join(shown)


def differences(pages: dict[str, Verdicts]) -> list[str]:
    """A line for each claim of which two pages say something different."""
    said: dict[str, dict[tuple[str, ...], list[str]]] = {}
    for page, verdicts in pages.items():
        for claim, verdict in verdicts.items():
            said.setdefault(claim, {}).setdefault(verdict, []).append(page)
    found = []
    for claim, by_verdict in said.items():
        if len(by_verdict) > 1:
            each = [
                f"{' and '.join(on)}: {', '.join(v)}" for v, on in by_verdict.items()
            ]
            found.append(f"{claim}: {'; '.join(each)}")
    return found + [
        f"{page} has no verdict" for page, each in pages.items() if not each
    ]


def main() -> int:
    """Compare the three; returns the exit status."""
    notebook = Path(sys.argv[1]) if sys.argv[1:] else NOTEBOOK
    texts = {
        "README.md": (ROOT / "README.md").read_text(),
        "docs/results.md": (ROOT / "docs" / "results.md").read_text(),
        notebook.name: shown_by(notebook),
    }
    pages = {name: verdicts_in(text) for name, text in texts.items()}
    found = differences(pages)
    for line in found:
        print(line)
    counts = ", ".join(f"{len(each)} in {name}" for name, each in pages.items())
    print(f"claims with verdicts: {counts}; {len(found)} faults")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
