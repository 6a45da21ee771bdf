"""What is taken of npm: the files that are named, and of no other archive than the one
that is pinned.
"""

import base64
import hashlib
import io
import tarfile

import pytest

from course import npm


@pytest.fixture
def archive():
    """A package with a file that is needed and one that is not."""
    kept = io.BytesIO()
    with tarfile.open(fileobj=kept, mode="w:gz") as members:
        for name in ("package/a.wasm", "package/b.js"):
            member = tarfile.TarInfo(name)
            member.size = len(name)
            members.addfile(member, io.BytesIO(name.encode()))
    return kept.getvalue()


def pinned(archive, files=("a.wasm",)):
    checksum = base64.b64encode(hashlib.sha512(archive).digest()).decode()
    return npm.Package("@some/thing", "1.2.3", f"sha512-{checksum}", files)


def test_only_the_files_that_are_needed_are_taken(archive):
    assert npm.unpacked(pinned(archive), archive) == {"a.wasm": b"package/a.wasm"}


def test_another_archive_is_refused_and_named(archive):
    with pytest.raises(ValueError, match=r"thing-1.2.3.tgz is not what npm.toml pins"):
        npm.unpacked(pinned(archive + b" "), archive)


def test_what_is_there_is_not_fetched_again(archive, tmp_path, monkeypatch):
    monkeypatch.setattr(npm, "NPM", tmp_path)
    answers = [archive]
    monkeypatch.setattr(
        npm.urllib.request, "urlopen", lambda *_, **__: io.BytesIO(answers.pop())
    )
    for _ in range(2):
        npm.fetch(pinned(archive))
    assert [each.name for each in tmp_path.rglob("*.*") if each.is_file()] == ["a.wasm"]


def test_each_package_is_pinned_by_a_strong_checksum():
    for package in npm.packages().values():
        assert package.integrity.startswith("sha512-")
        assert len(base64.b64decode(package.integrity.removeprefix("sha512-"))) == 64
        assert package.version in package.address
