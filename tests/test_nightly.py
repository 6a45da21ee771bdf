"""The nightly run: parts say how they went, and only a whole night is written down."""

import sys

import nightly


def part(monkeypatch, code):
    monkeypatch.setitem(nightly.PARTS, "inputs", ((sys.executable, "-c", code), {"CLOTHLAB_INPUTS": "7"}))


def test_a_part_gets_its_settings_and_its_summary_is_kept(monkeypatch):
    part(monkeypatch, "import os; print('noise'); print(os.environ['CLOTHLAB_INPUTS'], 'passed')")
    well, section = nightly.run("inputs")
    assert well
    assert "7 passed" in section
    assert "noise" not in section


def test_a_part_that_fails_says_so(monkeypatch):
    part(monkeypatch, "raise SystemExit(3)")
    well, section = nightly.run("inputs")
    assert not well
    assert section.startswith("## inputs: failed")


def test_one_part_leaves_the_record_alone(monkeypatch, tmp_path):
    part(monkeypatch, "print('1 passed')")
    monkeypatch.setattr(nightly, "REPORT", tmp_path / "nightly.md")
    monkeypatch.setattr(sys, "argv", ["nightly.py", "--only", "inputs"])
    assert nightly.main() == 0
    assert not nightly.REPORT.exists()
