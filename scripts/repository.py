"""Where the repository lies on the web, and all that follows from it.

The address is said once, in `pyproject.toml`.
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

ROOT = Path(__file__).resolve().parents[1]
BRANCH = "main"
START = "notebooks/00_start_here.ipynb"
# A link or a picture of Markdown that leads from `notebooks/` to another folder of the
# repository.
OUTWARD = re.compile(
    r"(?P<picture>!?)\[(?P<words>[^\]]*)\]"
    r"\(\.\./(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)"
)


@cache
def address() -> str:
    """The repository's address, without a slash at its end."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return project["urls"]["Repository"].rstrip("/")


def number_of(notebook: Path) -> str:
    """The number of a notebook, which may have a letter: `"07b"`, `"A1"`."""
    number, _, _ = notebook.stem.partition("_")
    return number


def page_of(path: str) -> str:
    """The address of a file of the repository."""
    return f"{address()}/blob/{BRANCH}/{quote(path)}"


def throw_page() -> str:
    """The address of the page with the live lab, where GitHub has the site."""
    owner, name = urlsplit(address()).path.strip("/").split("/")
    return f"https://{owner}.github.io/{name}/throw/"


def doors(notebook: str = START) -> dict[str, str]:
    """Where a notebook runs without an installation: a name, and the address behind it.

    Args:
        notebook: its path in the repository.
    """
    name = urlsplit(address()).path.strip("/")  # with its owner
    colab = "https://colab.research.google.com/github"
    binder = "https://mybinder.org/v2/gh"
    file = quote(notebook)
    return {
        "Colab": f"{colab}/{name}/blob/{BRANCH}/{file}",
        "Binder": f"{binder}/{name}/{BRANCH}?urlpath=lab/tree/{file}",
        "Codespace": f"https://codespaces.new/{name}",
    }


def portable(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy that is whole in any folder.

    Pictures lie inside it, and links to other folders lead to the repository. Links
    between notebooks stay, since editions are handed out side by side. A
    FileNotFoundError names a link that leads nowhere already.
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
    if not link["picture"]:
        return f"[{link['words']}]({page_of(link['path'])}{link['anchor'] or ''})"
    kind, _ = mimetypes.guess_type(path.name)
    data = base64.b64encode(path.read_bytes()).decode()
    cell.setdefault("attachments", {})[path.name] = {kind: data}
    return f"![{link['words']}](attachment:{path.name})"
