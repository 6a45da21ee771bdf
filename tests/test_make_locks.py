"""`make lock`: what it keeps out of a lock, and what its table says of a machine that
lacks a wheel.
"""

import subprocess

import make_locks
import pytest


@pytest.fixture
def locks(tmp_path, monkeypatch):
    """Two small locks in a folder of their own, instead of the repository's."""
    monkeypatch.setattr(make_locks, "ROOT", tmp_path)
    monkeypatch.setattr(
        make_locks, "LOCKS", (make_locks.Lock("a.txt", "A", last_lines=("-e .",)),)
    )
    (tmp_path / "a.txt").write_text(
        "# A: x==1\nsoupsieve==4.1.2\ntorch==2.13.0\n-e .\n"
    )
    return tmp_path


def option(words, name):
    """What an option of a command is set to."""
    (found,) = (word for word in words if word.startswith(f"{name}="))
    return found.removeprefix(f"{name}=")


def test_a_machine_without_a_wheel_is_named_with_its_reason(locks, monkeypatch, capsys):
    asked = []

    def uv(*words):
        version = option(words, "--python-version")
        with open(words[2]) as file:
            asked.append(file.read())
        fails = version == make_locks.OLDEST
        return subprocess.CompletedProcess(
            words, int(fails), stderr="soupsieve needs\n Python>=3.11.5" * fails
        )

    monkeypatch.setattr(make_locks, "uv", uv)
    faults = make_locks.check_locks()
    machine = f"a.txt, Python {make_locks.OLDEST}"
    assert faults == [
        f"{machine}, {name}: soupsieve needs Python>=3.11.5"
        for name in make_locks.PLATFORMS
    ]
    assert set(asked) == {"soupsieve==4.1.2\ntorch==2.13.0"}
    table = [
        line.split()[-1]
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("3.")
    ]
    assert table == ["FAULT"] + ["wheels"] * (len(make_locks.PYTHONS) - 1)


def test_nothing_of_cuda_is_locked_and_a_later_lock_holds_only_what_is_new(
    locks, monkeypatch
):
    first = "numpy==2.4.6\nnvidia-cublas==1 ; sys_platform == 'linux'\ncuda-bindings==2\ntriton==3\ntorch==2.13.0\n"

    def uv(*words):
        with open(option(words, "--output-file"), "w") as file:
            file.write(first + "pytest==9.2.0\n" * ("--group=dev" in words))
        return subprocess.CompletedProcess(words, 0)

    monkeypatch.setattr(make_locks, "uv", uv)
    both = (
        *make_locks.LOCKS,
        make_locks.Lock("b.txt", "B", group="dev", first_lines=("-r a.txt",)),
    )
    monkeypatch.setattr(make_locks, "LOCKS", both)
    (locks / "b.txt").write_text("")
    make_locks.write_locks(upgrade=False)
    assert (locks / "a.txt").read_text().splitlines()[1:] == [
        "numpy==2.4.6",
        "torch==2.13.0",
        "-e .",
    ]
    assert (locks / "b.txt").read_text().splitlines()[1:] == [
        "-r a.txt",
        "pytest==9.2.0",
    ]


def test_names_that_do_not_fit_together_end_with_uvs_reason(locks, monkeypatch):
    refused = subprocess.CompletedProcess((), 1, stderr="No solution found")
    monkeypatch.setattr(make_locks, "uv", lambda *words: refused)
    with pytest.raises(SystemExit, match="No solution found"):
        make_locks.write_locks(upgrade=True)
