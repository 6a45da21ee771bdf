"""Every link and every picture of every edition leads somewhere, and the address of the
repository is said once.
"""

import base64
import re
import subprocess
from urllib.parse import unquote, urlsplit

import editions
import nbformat
import pytest
import repository
from nbconvert import HTMLExporter
from nbformat.v4 import new_markdown_cell, new_notebook
from repository import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *ROOT.glob("data/*.md"),
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docs/course/*.md"),
    ]
)
LINK = re.compile(
    r"(?P<picture>!?)\[(?:[^\]\[]|\[[^\]]*\])*\]\((?P<target>[^)\s]+)\)|(?:src|href)=[\"'](?P<html>[^\"']+)"
)

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def targets(text):
    """What the links and pictures of a Markdown text, also those of pictures that are
    links, lead to.
    """
    text = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    inner = re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", text)
    return inner + [match["target"] or match["html"] for match in LINK.finditer(text)]


def leads_nowhere(target, folder, names=(), attachments=()):
    """Whether a target is missing: a file beside `folder`, one of `names`, an
    attachment, or the repository's own.
    """
    ours = f"{repository.address()}/blob/{repository.BRANCH}/"
    if target.startswith(ours):
        return not (ROOT / unquote(urlsplit(target[len(ours) :]).path)).exists()
    if target.startswith("attachment:"):
        return target.removeprefix("attachment:") not in attachments
    if urlsplit(target).scheme in (
        "http",
        "https",
        "mailto",
        "data",
    ) or target.startswith("#"):
        return False
    path = unquote(urlsplit(target).path)
    return path not in names and (folder is None or not (folder / path).exists())


def broken(notebook, folder, names=()):
    """The targets in a notebook's texts that lead nowhere."""
    texts = [cell for cell in notebook.cells if cell.cell_type == "markdown"]
    found = [
        (target, cell.get("attachments", {}))
        for cell in texts
        for target in targets(cell.source)
    ]
    return [
        target for target, held in found if leads_nowhere(target, folder, names, held)
    ]


@each_notebook
def test_links_and_pictures_of_a_notebook_in_the_repository(path):
    assert broken(nbformat.read(path, as_version=4), path.parent) == []


@each_notebook
def test_a_notebook_leads_to_no_program(path):
    """The site has no page of it, and building it would stop there."""
    texts = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells)
    assert [each for each in targets(texts) if each.endswith(".py")] == []


@each_notebook
def test_links_and_pictures_of_a_students_notebook_in_a_home_far_away(path):
    student = editions.student_edition(nbformat.read(path, as_version=4))
    assert broken(student, None, names={each.name for each in NOTEBOOKS}) == []
    nbformat.validate(student)


@pytest.mark.parametrize(
    "path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix()
)
def test_links_and_pictures_of_a_page(path):
    assert [
        target
        for target in targets(path.read_text("utf-8"))
        if leads_nowhere(target, path.parent)
    ] == []


def test_a_broken_link_or_picture_is_found():
    cells = [
        new_markdown_cell(text)
        for text in (
            "![a](b.gif)",
            "[a [b]](../c.md#d)",
            '<img src="e.png">',
            "`[f](g)`",
        )
    ]
    assert broken(new_notebook(cells=cells), ROOT / "notebooks") == [
        "b.gif",
        "b.gif",
        "../c.md#d",
        "e.png",
    ]
    gone = new_markdown_cell(
        f"![a](attachment:h.gif) [i]({repository.address()}/blob/main/none.md)"
    )
    assert len(broken(new_notebook(cells=[gone]), None)) == 3


def test_a_portable_notebook_holds_its_picture_and_leads_to_the_repository():
    source = "![an arm](../docs/control.gif)\n[results](../docs/results.md#a) [next](01_cloth_simulation.ipynb)"
    notebook = new_notebook(cells=[new_markdown_cell(source)])
    (cell,) = repository.portable(notebook).cells
    picture = base64.b64decode(cell.attachments["control.gif"]["image/gif"])
    assert picture == (ROOT / "docs" / "control.gif").read_bytes()
    address = repository.address()
    results = f"[results]({address}/blob/main/docs/results.md#a)"
    assert (
        cell.source
        == f"![an arm](attachment:control.gif)\n{results} [next](01_cloth_simulation.ipynb)"
    )
    assert notebook.cells[0].source == source
    page, _ = HTMLExporter().from_notebook_node(repository.portable(notebook))
    assert 'src="data:image/gif;base64,' in page
    with pytest.raises(FileNotFoundError, match=r"docs/none\.md"):
        repository.portable(
            new_notebook(cells=[new_markdown_cell("[a](../docs/none.md)")])
        )


def test_the_address_is_said_once_and_everything_else_is_made_from_it():
    files = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\n")
    kinds = (
        ".py",
        ".md",
        ".toml",
        ".ipynb",
        ".yml",
        ".json",
        ".cff",
        ".sh",
        ".rst",
        "Dockerfile",
        "Makefile",
    )
    holding = {
        name
        for name in files
        if name.endswith(kinds)
        and repository.address() in (ROOT / name).read_text("utf-8")
    }
    notebooks = {f"notebooks/{path.name}" for path in NOTEBOOKS}
    assert holding == {"pyproject.toml", "README.md"} | notebooks, (
        "CONTRIBUTING.md names the others where it stands"
    )


def test_the_first_notebook_and_the_demonstration_lead_to_the_live_lab():
    pages = ("docs/course/demo.md", "docs/book/index.md", "README.md")
    for name in (repository.START, *pages):
        assert repository.throw_page() in (ROOT / name).read_text("utf-8"), name


def test_doors_lead_to_the_notebook(monkeypatch):
    monkeypatch.setattr(
        repository, "address", lambda: "https://github.com/someone/cloth"
    )
    doors = repository.doors("notebooks/05_parametric_bias.ipynb")
    colab = "https://colab.research.google.com/github/someone/cloth/blob/main/notebooks/05_parametric_bias.ipynb"
    assert doors["Colab"] == colab
    binder = "https://mybinder.org/v2/gh/someone/cloth/main?urlpath=lab/tree/notebooks/05_parametric_bias.ipynb"
    assert doors["Binder"] == binder
    assert doors["Codespace"] == "https://codespaces.new/someone/cloth"
    page = "https://someone.github.io/cloth/throw/"
    assert repository.throw_page() == page
