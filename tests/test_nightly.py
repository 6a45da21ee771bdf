"""One command for what takes hours, and what it says of it."""

import datetime
import sys
from dataclasses import replace

import nightly
import pytest

COUNTS = nightly.Part("{} things", (sys.executable, "-c", ""), "CLOTHLAB_THINGS", 1000, r"^\d+ things")


def saying(code: str) -> nightly.Part:
    return replace(COUNTS, command=(sys.executable, "-c", f"import os; n = os.environ['CLOTHLAB_THINGS']; {code}"))


@pytest.mark.parametrize(("small", "amount"), [(True, "100"), (False, "1000")])
def test_a_part_is_told_how_much_and_its_summary_kept(small, amount):
    outcome = nightly.run(saying("print('noise'); print(n, 'things')"), small=small)
    assert outcome.well
    assert outcome.lines == [f"{amount} things"]
    assert outcome.what == f"{int(amount):,} things"


def test_a_part_that_fails_is_said_to_have_failed():
    outcome = nightly.run(saying("raise SystemExit(3)"), small=True)
    assert not outcome.well
    text = nightly.report([outcome], datetime.date(2030, 1, 2))
    assert text.startswith("# Nightly run of 2030-01-02\n")
    assert f"| 100 things | **failed** | 0.0 | {nightly.commit()} |" in text


def test_the_machine_is_told_without_its_name():
    import platform

    assert f"Python {platform.python_version()}" in nightly.machine()
    assert platform.node() not in nightly.machine()


def test_of_the_bench_all_is_kept_but_progress():
    said = "a / b: 1.2\n100%|###| 20/20\r  5%|#| 1/20\n\nfive models:\n    memory 3 MiB\n"
    part = replace(COUNTS, command=(sys.executable, "-c", f"print({said!r})"), told=nightly.PARTS["bench"].told)
    assert nightly.run(part, small=True).lines == ["a / b: 1.2", "five models:", "    memory 3 MiB"]


def test_everything_that_is_counted_is_asked_for():
    for name, part in nightly.PARTS.items():
        tests = [nightly.ROOT / word for word in part.command if word.startswith(("tests/", "scripts/"))]
        assert tests, name
        assert all(path.exists() for path in tests)
        assert not part.variable or part.variable in tests[0].read_text()


def test_a_small_run_leaves_the_record_alone(monkeypatch, capsys):
    monkeypatch.setattr(nightly, "PARTS", {"things": saying("print(n, 'things')")})
    monkeypatch.setattr(nightly, "REPORT", None)  # it would fail
    monkeypatch.setattr(sys, "argv", ["nightly.py", "--small"])
    assert nightly.main() == 0
    assert "| 100 things | held | 0.0 |" in capsys.readouterr().out


def test_an_interrupted_night_goes_on_where_it_stopped(monkeypatch, tmp_path):
    done = tmp_path / "done"
    first = saying(f"open({str(done)!r}, 'a').write('x'); print(n, 'things')")
    monkeypatch.setattr(nightly, "PARTS", {"first": first, "second": saying("raise SystemExit(1)")})
    for name in ("REPORT", "KEPT"):
        monkeypatch.setattr(nightly, name, tmp_path / name)
    now = {"commit": "one"}
    monkeypatch.setattr(nightly, "commit", lambda: now["commit"])
    assert [each.well for each in nightly.night(["first", "second"])] == [True, False]
    assert nightly.night(["first"])[0].lines == ["1000 things"]
    assert done.read_text() == "x"
    now["commit"] = "another"
    assert nightly.night(["first"])[0].well
    assert done.read_text() == "xx"
    assert nightly.night(["first"], "another")[0].commit == "another"
    now["commit"] = "mended"
    assert [each.commit for each in nightly.night(["first", "second"], "another")] == ["another", "mended"]
    now["commit"] = "another"
    monkeypatch.setattr(sys, "argv", ["nightly.py"])
    assert nightly.main() == 1
    assert not (tmp_path / "KEPT").exists()  # the night is over
    assert "| 1,000 things | held |" in (tmp_path / "REPORT").read_text()


def test_a_whole_run_is_written_down(monkeypatch, tmp_path):
    monkeypatch.setattr(nightly, "PARTS", {"things": saying("raise SystemExit(1)")})
    monkeypatch.setattr(nightly, "KEPT", tmp_path / "kept")
    monkeypatch.setattr(nightly, "REPORT", tmp_path / "nightly.md")
    monkeypatch.setattr(sys, "argv", ["nightly.py"])
    assert nightly.main() == 1
    assert "**failed**" in (tmp_path / "nightly.md").read_text()
