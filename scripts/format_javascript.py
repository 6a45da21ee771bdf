"""Write the JavaScript of the page "Throw a cloth" as Prettier does.

Part of `make format`. Prettier comes by `make npm`, and Node.js with Playwright.
"""

import json
import subprocess
from pathlib import Path

import playwright

from clothlab._files import write_bytes
from course.npm import fetch, packages
from course.repository import ROOT

FILES = sorted(
    path
    for pattern in ("docs/book/lab/*.js", "tests/book/*.mjs", "scripts/*.mjs")
    for path in ROOT.glob(pattern)
)


def node() -> Path:
    """The Node.js that Playwright brings along."""
    return next((Path(playwright.__file__).parent / "driver").glob("node*"))


def formatted() -> dict[Path, str]:
    """Each file as Prettier writes it."""
    script = Path(__file__).with_suffix(".mjs")
    command = [node(), script, packages()["prettier"].folder, *FILES]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {Path(path): text for path, text in json.loads(done.stdout).items()}


def main() -> None:
    """Write them."""
    fetch(packages()["prettier"])
    for path, text in formatted().items():
        if path.read_text("utf-8") != text:
            write_bytes(path, text.encode())
            print(f"{path.relative_to(ROOT)}: formatted")


if __name__ == "__main__":
    main()
