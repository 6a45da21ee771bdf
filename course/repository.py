"""Where the repository lies on the web, said once in `pyproject.toml`, and all that
follows from it.
"""

import base64
import copy
import mimetypes
import re
import tomllib
from functools import cache
from pathlib import Path
from urllib.parse import quote, urlsplit

import nbformat

ROOT = Path(__file__).resolve().parents[1]
BRANCH = "main"
START = "notebooks/00_start_here.ipynb"
# A link or a picture of Markdown that leads from `notebooks/` to another folder of the
# repository.
OUTWARD = re.compile(
    r"(?P<picture>!?)\[(?P<words>[^\]]*)\]\(\.\./(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)"
)


@cache
def address() -> str:
    """The repository's address, without a slash at its end."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return project["urls"]["Repository"].rstrip("/")


def page_of(path: str) -> str:
    """The address of a file of the repository."""
    return f"{address()}/blob/{BRANCH}/{quote(path)}"


def doors(notebook: str = START) -> dict[str, str]:
    """Where a notebook runs without an installation: a name, and the address behind it.

    Args:
        notebook: its path in the repository.
    """
    owner_and_name = urlsplit(address()).path.strip("/")
    return {
        "Colab": f"https://colab.research.google.com/github/{owner_and_name}/blob/{BRANCH}/{quote(notebook)}",
        "Binder": f"https://mybinder.org/v2/gh/{owner_and_name}/{BRANCH}?urlpath=lab/tree/{quote(notebook)}",
        "Codespace": f"https://codespaces.new/{owner_and_name}",
    }


def portable(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """A copy that is whole in any folder: pictures lie inside it, links to other
    folders lead to the repository.

    Links between notebooks stay, since editions are handed out side by side. A
    FileNotFoundError names a link that leads nowhere already.
    """
    edition = copy.deepcopy(notebook)
    for cell in edition.cells:
        if cell.cell_type == "markdown":
            cell.source = OUTWARD.sub(
                lambda link, cell=cell: _anywhere(link, cell), cell.source
            )
    return edition


def _anywhere(link: re.Match[str], cell: nbformat.NotebookNode) -> str:
    """What stands for a link to another folder in a notebook that may lie anywhere;
    `cell` gets its picture.
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
