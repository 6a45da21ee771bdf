"""The page "Throw a cloth": the live lab in a browser, without Python behind it.

`python -m web build` makes it, and `python -m web serve` shows it. README.md says how.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "build" / "throw"  # where it is built
