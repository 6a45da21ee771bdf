"""The nightly run: parts say how they went, and only a whole night is written down."""

import sys

import nightly
import pytest


@pytest.mark.parametrize(("status", "verdict"), [(0, "passed"), (3, "failed")])
def test_a_part_gets_its_settings_and_its_summary_is_kept(monkeypatch, tmp_path, status, verdict):
    code = f"import os; print('noise'); print(os.environ['CLOTHLAB_INPUTS'], 'passed'); raise SystemExit({status})"
    monkeypatch.setitem(nightly.PARTS, "inputs", ((sys.executable, "-c", code), {"CLOTHLAB_INPUTS": "7"}))
    well, section = nightly.run("inputs")
    assert well == (status == 0)
    assert section.startswith(f"## inputs: {verdict}")
    assert "7 passed" in section
    assert "noise" not in section
    monkeypatch.setattr(nightly, "REPORT", tmp_path / "nightly.md")
    monkeypatch.setattr(sys, "argv", ["nightly.py", "--only", "inputs"])
    assert nightly.main() == (status > 0)
    assert not nightly.REPORT.exists()
