"""Where the repository is published, and every link that follows from it.

The address is one line of `pyproject.toml`, empty until there is one. As long as it is
empty, no page links to it, and each says what to do in a clone instead. `make format`
runs this file: it writes README, docs, CITATION.cff and notebooks for one or the other.
The site and the page "Throw a cloth" read the address when they are built.
"""

import base64
import copy
import mimetypes
import re
import tomllib
from functools import cache, partial
from pathlib import Path
from urllib.parse import quote, urlsplit

import nbformat
import on_colab

from clothlab._files import write_bytes

ROOT = Path(__file__).resolve().parents[1]
BRANCH = "main"
START = "notebooks/00_start_here.ipynb"
# A link or a picture of Markdown that leads from `notebooks/` to another folder of the
# repository.
OUTWARD = re.compile(
    r"(?P<picture>!?)\[(?P<words>[^\]]*)\]"
    r"\(\.\./(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)"
)
# Words of a page that depend on the address
PASSAGE = re.compile(
    r"(?P<head><!-- address: (?P<name>\w+) -->).*?(?P<tail><!-- /address -->)",
    re.DOTALL,
)


@cache
def address() -> str:
    """The repository's address without a slash at its end, or "" if it has none.

    Raises:
        ValueError: it is not that of a repository on GitHub.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found = project["urls"]["Repository"].rstrip("/")
    if found and not re.fullmatch(r"https://github\.com/[\w.-]+/[\w.-]+", found):
        raise ValueError(
            f"Repository in pyproject.toml is {found!r}: write "
            '"https://github.com/OWNER/NAME", or "" as long as it is not published'
        )
    return found


def number_of(notebook: Path) -> str:
    """The number of a notebook, which may have a letter: `"07b"`, `"A1"`."""
    number, _, _ = notebook.stem.partition("_")
    return number


def page_of(path: str) -> str:
    """The address of a file of the published repository."""
    return f"{address()}/blob/{BRANCH}/{quote(path)}"


def site() -> str:
    """The address at which GitHub publishes the site."""
    owner, name = urlsplit(address()).path.strip("/").split("/")
    return f"https://{owner}.github.io/{name}/"


def throw_page() -> str:
    """The address of the page "Throw a cloth", which is part of the site."""
    return f"{site()}throw/"


def without_installation(notebook: str = START) -> dict[str, str]:
    """Where a notebook runs without an installation: addresses by name.

    Args:
        notebook: its path in the repository.

    Returns:
        Nothing, as long as the repository is not published.
    """
    if not address():
        return {}
    name = urlsplit(address()).path.strip("/")  # with its owner
    colab = "https://colab.research.google.com/github"
    binder = "https://mybinder.org/v2/gh"
    file = quote(notebook)
    return {
        "Colab": f"{colab}/{name}/blob/{BRANCH}/{file}",
        "Binder": f"{binder}/{name}/{BRANCH}?urlpath=lab/tree/{file}",
        "Codespace": f"https://codespaces.new/{name}",
    }


def passages() -> dict[str, str]:
    """What stands between the markers of a passage, by its name."""
    if not address():
        return {
            "open": "**`make throw`** puts the robot into your browser, "
            "**`make lab`** opens the notebooks.",
            "throw": "`make throw`",
            "clone": "In this folder:",
        }
    links = without_installation().items()
    elsewhere = " · ".join(f"[{name}]({link})" for name, link in links)
    return {
        "open": f"**[Throw a cloth now]({throw_page()})** in your browser, "
        f"[read the series]({site()}), or run it without an installation: {elsewhere}.",
        "throw": f"[Throw a cloth]({throw_page()})",
        "clone": f"`git clone {address()}`, and in its folder:",
    }


def with_passages(text: str) -> str:
    """A text whose passages fit the address; a KeyError names an unknown one."""
    words = passages()
    return PASSAGE.sub(
        lambda found: found["head"] + words[found["name"]] + found["tail"], text
    )


def with_address(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy of a notebook that fits the address.

    Its first code cell sets up Google Colab, which needs an address.
    """
    edition = copy.deepcopy(notebook)
    edition.cells = [cell for cell in edition.cells if cell.id != on_colab.CELL_ID]
    for cell in edition.cells:
        if cell.cell_type == "markdown":
            cell.source = with_passages(cell.source)
    if address():
        edition.cells.insert(1, on_colab.first_cell(address()))
    return edition


def citation(text: str) -> str:
    """The text of CITATION.cff with the address of the code, if there is one."""
    lines = [
        line for line in text.splitlines() if not line.startswith("repository-code:")
    ]
    if address():
        lines.insert(lines.index("license: MIT"), f"repository-code: {address()}")
    return "\n".join(lines) + "\n"


def write_links() -> None:
    """Write all that depends on the address; what fits already keeps its date."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    changed = {page: with_passages(page.read_text("utf-8")) for page in pages}
    cff = ROOT / "CITATION.cff"
    changed[cff] = citation(cff.read_text("utf-8"))
    for path in ROOT.glob("notebooks/*.ipynb"):
        notebook = with_address(nbformat.read(path, as_version=4))
        changed[path] = nbformat.writes(notebook) + "\n"
    for path, text in changed.items():
        if path.read_text("utf-8") != text:
            write_bytes(path, text.encode())


def portable(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy that is whole in any folder.

    Pictures lie inside it, and links to other folders lead to the published repository,
    or become words that name the file. Links between notebooks stay, since editions are
    handed out side by side.

    Raises:
        FileNotFoundError: a link leads nowhere already.
    """
    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        if cell.cell_type == "markdown":
            cell.source = OUTWARD.sub(partial(_anywhere, cell), cell.source)
    return edition


def _anywhere(cell: nbformat.NotebookNode, link: re.Match[str]) -> str:
    """What stands for a link to another folder in a notebook that may lie anywhere.

    The cell gets a picture that it shows.
    """
    path = ROOT / link["path"]
    if not path.exists():
        raise FileNotFoundError(
            f"a notebook links to {link['path']}, which is not in the repository"
        )
    if link["picture"]:
        kind, _ = mimetypes.guess_type(path.name)
        data = base64.b64encode(path.read_bytes()).decode()
        cell.setdefault("attachments", {})[path.name] = {kind: data}
        return f"![{link['words']}](attachment:{path.name})"
    if not address():
        return f"{link['words']} (`{link['path']}`)"
    return f"[{link['words']}]({page_of(link['path'])}{link['anchor'] or ''})"


if __name__ == "__main__":
    write_links()
