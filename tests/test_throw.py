"""`make throw` serves the page that was built, on this machine or to a network."""

import subprocess
import sys
from contextlib import contextmanager
from urllib.request import urlopen

import pytest

from web import ROOT
from web.__main__ import main

COMMAND = [sys.executable, "-m", "web", "serve", "--folder"]


@contextmanager
def serving(folder, *options):
    """The address that a server of a folder prints, at any free port."""
    command = [*COMMAND, folder, "--port", "0", *options]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            yield server.stdout.readline().split()[-1]
        finally:
            server.terminate()


def page_in(folder):
    (folder / "index.html").write_text("a robot", "utf-8")
    return folder


def test_it_prints_where_the_page_is_on_this_machine(tmp_path):
    with serving(page_in(tmp_path)) as address:
        assert address.startswith("http://localhost:")
        here = address.replace("localhost", "127.0.0.1")
        assert urlopen(here).read() == b"a robot"


def test_on_request_others_in_the_network_reach_it(tmp_path):
    with serving(page_in(tmp_path), "--host", "0.0.0.0") as address:
        assert "0.0.0.0" not in address
        port = address.rpartition(":")[2]
        assert urlopen(f"http://127.0.0.1:{port}").read() == b"a robot"


@pytest.mark.parametrize("fault", ["no page", "a port in use"])
def test_what_hinders_it_is_said_in_one_sentence(tmp_path, fault):
    if fault == "no page":
        command, words = [*COMMAND, tmp_path], "run `python -m web build` first"
        ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    else:
        with serving(page_in(tmp_path)) as address:
            port = address.rpartition(":")[2]
            command = [*COMMAND, tmp_path, "--port", port]
            words = "name another port, such as `make throw PORT=8001`"
            ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 1
    assert words in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.slow
def test_without_a_network_the_first_build_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("web.npm.NPM", tmp_path)
    monkeypatch.setattr("pooch.retrieve", no_network)
    monkeypatch.setattr("sys.argv", ["web", "build", "--into", str(tmp_path / "page")])
    with pytest.raises(
        SystemExit, match=r"cannot fetch https.*: go online and try again"
    ):
        main()


def no_network(*_, **__):
    raise OSError("Failed to resolve a name")
