"""What is kept is used again while it is what it was, and made again otherwise."""

import pytest

from clothlab.experiments._kept import once, version


@pytest.fixture
def work(tmp_path):
    """Work that counts how often it is done, and writes a file beside its answer."""

    def do(made_with, name="work"):
        def make():
            do.done += 1
            (tmp_path / "weights").write_text("many numbers")
            return {"answer": (do.done, 0.1)}

        return once(name, made_with, make, folder=tmp_path, files=["weights"])

    do.done = 0
    return do


def test_what_was_made_with_the_same_is_not_made_again(work):
    first = work({"seed": 0, "steps": (1, 2)})
    assert first == work({"steps": [1, 2], "seed": 0}) == {"answer": [1, 0.1]}
    assert work.done == 1


def test_other_settings_make_it_anew_and_other_names_are_kept_apart(work):
    assert [work({"seed": seed})["answer"][0] for seed in (0, 1, 1, 0)] == [1, 2, 2, 3]
    work({"seed": 0}, name="other")
    work({"seed": 0})
    assert work.done == 4


@pytest.mark.parametrize("harm", ["results/work.json", "weights"])
@pytest.mark.parametrize("how", ["gone", "altered"])
def test_what_is_gone_or_altered_is_made_again(work, tmp_path, harm, how):
    work({})
    if how == "gone":
        (tmp_path / harm).unlink()
    else:
        (tmp_path / harm).write_text("{}")
    assert work({}) == work({}) == {"answer": [2, 0.1]}


def test_work_that_fails_leaves_nothing_that_looks_done(tmp_path):
    def fail():
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        once("work", {}, fail, folder=tmp_path)
    assert once("work", {}, lambda: "done", folder=tmp_path) == "done"
    with pytest.raises(TypeError, match="not JSON serializable"):
        once("work", {"what": object()}, lambda: "done", folder=tmp_path)


def test_files_are_known_by_a_pattern_too(tmp_path):
    (tmp_path / "part").mkdir()
    counts = []

    def make():
        counts.append(len(counts))
        for name in "ab":
            (tmp_path / "part" / f"{name}.txt").write_text(name)

    def do():
        once("parts", {}, make, folder=tmp_path, files=["part/*.txt"])
        return len(counts)

    assert [do(), do()] == [1, 1]
    (tmp_path / "part" / "b.txt").unlink()
    assert [do(), do()] == [2, 2]
    (tmp_path / "part" / "c.txt").write_text("of somebody else")
    assert do() == 3


def test_the_version_is_of_the_code_where_data_has_no_hashes(tmp_path, monkeypatch):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    version.cache_clear()
    without = version()
    (tmp_path / "SHA256SUMS").write_text("something")
    version.cache_clear()
    assert len(without) == len(version()) == 64
    assert version() != without
    version.cache_clear()
