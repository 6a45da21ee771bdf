"""What the page takes of npm, in `build/npm`.

`npm.toml` names the packages and pins them by checksum. No npm is needed, nothing of
them is run, and what is there already is not fetched again.
"""

import base64
import tarfile
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pooch

from clothlab._files import write_bytes
from web import ROOT

NPM = ROOT / "build" / "npm"
_LIST = Path(__file__).with_name("npm.toml")
_REGISTRY = "https://registry.npmjs.org"


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
    def checksum(self) -> str:
        """The same as pooch writes it: kind of hash, hash in hexadecimal digits."""
        kind, _, digest = self.integrity.partition("-")
        return f"{kind}:{base64.b64decode(digest).hex()}"

    @property
    def folder(self) -> Path:
        """Where its files lie here: another version has another folder."""
        return NPM / f"{self.name}-{self.version}"


def packages() -> dict[str, Package]:
    """The packages that are pinned, by name."""
    pinned = tomllib.loads(_LIST.read_text("utf-8"))["package"]
    return {each["name"]: Package(**each) for each in pinned}


def fetch(package: Package) -> None:
    """Put a package's files into its folder, where they are not there yet.

    Another archive than the pinned one is a ValueError, no network a ConnectionError.
    """
    if all((package.folder / name).is_file() for name in package.files):
        return
    with tempfile.TemporaryDirectory() as folder:
        try:
            archive = pooch.retrieve(package.address, package.checksum, path=folder)
        except OSError as error:
            raise ConnectionError(
                f"cannot fetch {package.address} ({type(error).__name__}): go online "
                "and try again; once this is here, nothing needs a network"
            ) from error
        with tarfile.open(archive) as members:
            for name in package.files:
                content = members.extractfile(f"package/{name}")
                assert content is not None
                write_bytes(package.folder / name, content.read())
    print(f"{package.folder}: fetched", flush=True)
