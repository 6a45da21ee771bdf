"""Every link and every picture of every edition leads somewhere, and the address of the
repository is said once.
"""

import base64
import re
import shutil
import subprocess
import sys
from urllib.parse import unquote, urlsplit

import editions
import nbformat
import pytest
import repository
from nbconvert import HTMLExporter
from nbformat.v4 import new_markdown_cell, new_notebook
from repository import ROOT

ADDRESS = "https://github.com/someone/cloth"
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
    if repository.address() and target.startswith(ours):
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


def test_a_broken_link_or_picture_is_found(monkeypatch):
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
    monkeypatch.setattr(repository, "address", lambda: ADDRESS)
    gone = new_markdown_cell(f"![a](attachment:h.gif) [i]({ADDRESS}/blob/main/none.md)")
    assert len(broken(new_notebook(cells=[gone]), None)) == 3


def test_a_portable_notebook_holds_its_picture_and_names_what_is_not_published(
    monkeypatch,
):
    source = "![an arm](../docs/control.gif)\n[words](../docs/glossary.md#letters) [next](01_cloth_simulation.ipynb)"
    notebook = new_notebook(cells=[new_markdown_cell(source)])
    picture = "![an arm](attachment:control.gif)"
    following = "[next](01_cloth_simulation.ipynb)"
    for address, words in {
        "": "words (`docs/glossary.md`)",
        ADDRESS: f"[words]({ADDRESS}/blob/main/docs/glossary.md#letters)",
    }.items():
        monkeypatch.setattr(repository, "address", lambda address=address: address)
        (cell,) = repository.portable(notebook).cells
        assert cell.source == f"{picture}\n{words} {following}"
        held = base64.b64decode(cell.attachments["control.gif"]["image/gif"])
        assert held == (ROOT / "docs" / "control.gif").read_bytes()
    assert notebook.cells[0].source == source
    page, _ = HTMLExporter().from_notebook_node(repository.portable(notebook))
    assert 'src="data:image/gif;base64,' in page
    with pytest.raises(FileNotFoundError, match=r"docs/none\.md"):
        repository.portable(
            new_notebook(cells=[new_markdown_cell("[a](../docs/none.md)")])
        )


def tracked(*kinds):
    """Text files of the repository that end in one of these ways, by name."""
    if not (ROOT / ".git").exists():
        pytest.skip("this is no clone: only there git lists the files")
    files = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    found = [name for name in files if name.endswith(kinds) and (ROOT / name).exists()]
    return {name: (ROOT / name).read_text("utf-8") for name in found}


def test_no_page_leads_to_where_the_repository_is_not_published():
    """The address is one line; each other file has it from there, or not at all."""
    kinds = (".py", ".md", ".toml", ".ipynb", ".yml", ".json", ".cff", ".sh", ".html")
    own = re.compile(
        r"github\.com/(?:[\w.-]+/)?clothlab|clothlab\.github\.io|pip install clothlab"
    )
    holding = {name for name, text in tracked(*kinds).items() if own.search(text)}
    holding -= {"tests/course/test_links.py"}
    if not repository.address():
        assert holding == set()


def no_address(text):
    """The links of a text to other machines that cannot be right as they stand.

    A name that is made up for examples is no machine.
    """
    wrong = []
    # In a notebook's JSON, a line ends with a backslash
    for link in re.findall(r"https?://[^\s\"'<>)\]`\\$]*", text):
        parts = urlsplit(link.rstrip(".,;:"))
        host = parts.hostname or ""
        named = re.fullmatch(r"([a-z0-9-]+\.)+[a-z]{2,}", host)
        made_up = re.search(r"(^|\.)example(\.(com|org|net))?$", host)
        here = host in ("localhost", "127.0.0.1")
        if not here and (not named or made_up or parts.scheme != "https"):
            wrong.append(link)
    return wrong


def test_every_link_to_the_outside_is_an_address():
    texts = tracked(".md", ".ipynb", ".cff", ".html")
    wrong = {name: no_address(text) for name, text in texts.items()}
    assert {name: links for name, links in wrong.items() if links} == {}


@pytest.mark.parametrize(
    "link", ["https://ADDRESS/a", "https://…", "http://doi.org/1", "https://a.example"]
)
def test_a_link_to_the_outside_that_is_no_address_is_found(link):
    assert no_address(f"[a]({link}) and [b](https://doi.org/10.1)") == [link]


def test_no_placeholder_is_left_in_what_a_reader_sees():
    texts = tracked(".md", ".ipynb", ".cff", ".html")
    words = r"\bTODO\b|\bTBD\b|\bFIXME\b|\bXXX\b|lorem ipsum|ADDRESS-OF|\]\(\)|\]\(…"
    found = [
        (name, match)
        for name, text in texts.items()
        for match in re.findall(words, text)
    ]
    assert found == []


def test_links_of_a_published_repository_lead_to_the_notebook(monkeypatch):
    monkeypatch.setattr(repository, "address", lambda: ADDRESS)
    places = repository.without_installation("notebooks/05_parametric_bias.ipynb")
    colab = "https://colab.research.google.com/github/someone/cloth/blob/main/notebooks/05_parametric_bias.ipynb"
    assert places["Colab"] == colab
    binder = "https://mybinder.org/v2/gh/someone/cloth/main?urlpath=lab/tree/notebooks/05_parametric_bias.ipynb"
    assert places["Binder"] == binder
    assert places["Codespace"] == "https://codespaces.new/someone/cloth"
    assert repository.throw_page() == "https://someone.github.io/cloth/throw/"


@pytest.mark.parametrize("address", ["clothlab", "https://github.com/OWNER", "none"])
def test_an_address_that_is_none_is_refused(address, monkeypatch, tmp_path):
    project = f'[project.urls]\nRepository = "{address}"\n'
    (tmp_path / "pyproject.toml").write_text(project)
    monkeypatch.setattr(repository, "ROOT", tmp_path)
    with pytest.raises(ValueError, match=r'write "https://github\.com/OWNER/NAME"'):
        repository.address.__wrapped__()


def test_the_site_is_published_once_there_is_an_address():
    workflow = (ROOT / ".github" / "workflows" / "site.yml").read_text("utf-8")
    (wanted,) = re.findall(r"grep -q '(.*?)' pyproject.toml", workflow)
    line = r'^Repository = ".*"$'
    project = (ROOT / "pyproject.toml").read_text("utf-8")
    for address in ("", ADDRESS):
        text = re.sub(line, f'Repository = "{address}"', project, flags=re.MULTILINE)
        assert bool(re.search(wanted, text, re.MULTILINE)) == bool(address)


@pytest.fixture
def copied(tmp_path):
    """A copy of what depends on the address, and what writes all that in it."""
    for name in ["pyproject.toml", "CITATION.cff", *tracked(".md", ".ipynb")]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")

    def publish(address):
        path = tmp_path / "pyproject.toml"
        text = re.sub(
            r'^Repository = ".*"$',
            f'Repository = "{address}"',
            path.read_text("utf-8"),
            flags=re.MULTILINE,
        )
        path.write_text(text, "utf-8")
        command = [sys.executable, tmp_path / "scripts" / "repository.py"]
        subprocess.run(command, cwd=ROOT, check=True)
        names = [*tmp_path.rglob("*.md"), *tmp_path.rglob("*.ipynb")]
        names.append(tmp_path / "CITATION.cff")
        return {
            path.relative_to(tmp_path).as_posix(): path.read_text("utf-8")
            for path in names
        }

    return publish


@pytest.mark.slow
def test_one_command_writes_every_link_of_an_address_and_takes_it_back(copied):
    before = copied("")
    assert not any(ADDRESS in text for text in before.values())
    after = copied(ADDRESS)
    for place in repository_places():
        assert place in after["README.md"]
    throw = "https://someone.github.io/cloth/throw/"
    for name in (repository.START, "docs/course/README.md", "docs/book/index.md"):
        assert throw in after[name], name
    assert f"repository-code: {ADDRESS}\n" in after["CITATION.cff"]
    for path in NOTEBOOKS:
        notebook = nbformat.reads(after[f"notebooks/{path.name}"], as_version=4)
        nbformat.validate(notebook)
        assert notebook.cells[1].id == "colab"
        assert f'"{ADDRESS}"' in notebook.cells[1].source
    assert copied("") == before
    assert before["README.md"] == (ROOT / "README.md").read_text("utf-8"), (
        "run `make format`"
    )


def repository_places():
    """Where a visitor of the made-up repository is led from its README."""
    return [
        "https://colab.research.google.com/github/someone/cloth/",
        "https://mybinder.org/v2/gh/someone/cloth/",
        "https://codespaces.new/someone/cloth",
        "https://someone.github.io/cloth/throw/",
        f"git clone {ADDRESS}",
    ]
