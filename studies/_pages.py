"""What is written into pages of Markdown: tables, and texts between marks."""

from collections.abc import Iterable
from pathlib import Path


def table(lines: Iterable[tuple[str, ...]]) -> str:
    """A table of text; its first line is the head."""
    head, *body = lines
    rule = ("---",) * len(head)
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, rule, *body])


def put_between(path: Path, text: str, begin: str, end: str) -> None:
    """Put a text between the marks of a page; a ValueError where it has none."""
    before, mark, rest = path.read_text("utf-8").partition(begin)
    _, last, after = rest.partition(end)
    if not mark or not last:
        raise ValueError(f"{path.name} has no place for this text: {begin} and {end}")
    path.write_text(f"{before}{begin}\n{text}\n{end}{after}", "utf-8")
