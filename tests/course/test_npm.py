"""What is taken of npm: the files that are named, and of no other archive than the one
that is pinned.
"""

import base64
import gc
import hashlib
import io
import tarfile

import pytest
from shared import serving

from course import npm


@pytest.fixture
def archive():
    """A package with a file that is needed and one that is not."""
    kept = io.BytesIO()
    with tarfile.open(fileobj=kept, mode="w:gz") as members:
        for name in ("package/dist/a.wasm", "package/b.js"):
            member = tarfile.TarInfo(name)
            member.size = len(name)
            members.addfile(member, io.BytesIO(name.encode()))
    return kept.getvalue()


def pinned(archive, files=("dist/a.wasm",)):
    checksum = base64.b64encode(hashlib.sha512(archive).digest()).decode()
    return npm.Package("@some/thing", "1.2.3", f"sha512-{checksum}", files)


@pytest.fixture
def registry(archive, tmp_path, monkeypatch):
    """What was asked of a registry that has this archive."""
    at = tmp_path / "served" / "@some" / "thing" / "-" / "thing-1.2.3.tgz"
    at.parent.mkdir(parents=True)
    at.write_bytes(archive)
    with serving(tmp_path / "served") as (address, asked):
        monkeypatch.setattr(npm, "_REGISTRY", address)
        monkeypatch.setattr(npm, "NPM", tmp_path / "npm")
        yield asked


def fetched():
    return {
        path.relative_to(npm.NPM).as_posix(): path.read_bytes()
        for path in npm.NPM.rglob("*")
        if path.is_file()
    }


def test_only_the_files_that_are_needed_are_taken(registry, archive):
    npm.fetch(pinned(archive))
    assert fetched() == {"@some/thing-1.2.3/dist/a.wasm": b"package/dist/a.wasm"}


def test_another_archive_is_refused_and_named(registry, archive):
    with pytest.raises(ValueError, match=r"thing-1.2.3.tgz\) does not match the known"):
        npm.fetch(pinned(archive + b" "))
    assert fetched() == {}


def test_what_is_there_is_not_fetched_again(registry, archive):
    for _ in range(2):
        npm.fetch(pinned(archive))
    assert registry == ["@some/thing/-/thing-1.2.3.tgz"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", ["no server", "no such package"])
def test_without_a_network_one_sentence_says_so(registry, archive, monkeypatch, fault):
    if fault == "no server":
        monkeypatch.setattr(npm, "_REGISTRY", "http://127.0.0.1:9")
    lacking = pinned(archive)._replace(version="9.9.9")
    monkeypatch.setattr(npm, "packages", lambda: {"thing": lacking})
    with pytest.raises(SystemExit, match=r"^cannot fetch http://.*9.9.9.tgz \(\w+\): "):
        npm.main()
    assert fetched() == {}
    gc.collect()  # pooch leaves the answer of a server that lacks a file open


def test_each_package_is_pinned_by_a_strong_checksum():
    for package in npm.packages().values():
        kind, digest = package.checksum.split(":")
        assert kind == "sha512"
        assert len(bytes.fromhex(digest)) == 64
        assert package.version in package.address
