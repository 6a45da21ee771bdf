"""`make npm`: what the live lab in a page takes of npm, in `build/npm`.

`docs/book/lab/npm.toml` names the packages and pins them by checksum. No npm is needed,
nothing of them is run, and what is there already is not fetched again.
"""

import base64
import hashlib
import io
import tarfile
import tomllib
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from clothlab._files import write_bytes
from course.repository import ROOT

NPM = ROOT / "build" / "npm"
_LIST = ROOT / "docs" / "book" / "lab" / "npm.toml"
_REGISTRY = "https://registry.npmjs.org"
_TIMEOUT = 60.0  # [s] without an answer


class Package(NamedTuple):
    """A package of npm."""

    name: str
    version: str
    integrity: str  # of its archive, as npm writes it: kind of hash, hash in base64
    files: Sequence[str]  # that are needed, by their paths in it

    @property
    def address(self) -> str:
        """Where its archive lies."""
        last = self.name.split("/")[-1]
        return f"{_REGISTRY}/{self.name}/-/{last}-{self.version}.tgz"

    @property
    def folder(self) -> Path:
        """Where its files lie here: another version has another folder."""
        return NPM / f"{self.name}-{self.version}"


def packages() -> dict[str, Package]:
    """The packages that are pinned, by name."""
    pinned = tomllib.loads(_LIST.read_text("utf-8"))["package"]
    return {each["name"]: Package(**each) for each in pinned}


def unpacked(package: Package, archive: bytes) -> dict[str, bytes]:
    """The files that are needed, out of an archive that has the right checksum."""
    kind, _, expected = package.integrity.partition("-")
    got = base64.b64encode(hashlib.new(kind, archive).digest()).decode()
    if got != expected:
        raise ValueError(
            f"{package.address} is not what {_LIST.name} pins: its {kind} is {got}"
        )
    with tarfile.open(fileobj=io.BytesIO(archive)) as members:
        found = {name: members.extractfile(f"package/{name}") for name in package.files}
        return {name: file.read() for name, file in found.items() if file}


def fetch(package: Package) -> None:
    """Put a package's files into its folder, where they are not there yet."""
    if all((package.folder / name).is_file() for name in package.files):
        return
    with urllib.request.urlopen(package.address, timeout=_TIMEOUT) as answer:
        archive = answer.read()
    for name, content in unpacked(package, archive).items():
        write_bytes(package.folder / name, content)
    print(f"{package.folder}: fetched")


def main() -> None:
    """Fetch all of them."""
    for package in packages().values():
        fetch(package)


if __name__ == "__main__":
    main()
