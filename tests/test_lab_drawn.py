"""Figures that a Control draws beforehand: which ones, for where its controls stand."""

import base64
import io
from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from clothlab.lab import Control, PBMap, _drawn
from clothlab.lab._drawn import grid, places, slider_choices, thinned
from clothlab.lab._pictures import compact, encoded

BIASES = {
    "a": np.array([1.0, 0.5]),
    "b": np.array([-1.0, 0.2]),
    "c": np.array([0.1, -0.9]),
}


def titled(**values):
    figure, ax = plt.subplots(figsize=(2, 1))
    ax.plot([0, 1, 2], [0, 2, 1], label=f"{values}")
    ax.legend()
    return figure


def laid_out(controls, starts, most):
    return grid(controls, starts, {name: name for name in controls}, most)


def test_a_slider_offers_its_steps_its_end_and_its_start():
    assert slider_choices((1, 4, 1), 2) == [1, 2, 3, 4]
    # As the notebook writes them, not 0.30000000000000004
    assert slider_choices((0.1, 0.4, 0.1), 0.1) == [0.1, 0.2, 0.3, 0.4]
    assert slider_choices((3.0, 4.0, 0.6), 3.5) == [3.0, 3.5, 3.6, 4.0]


@pytest.mark.parametrize("count", [3, 4, 17, 41])
def test_fewer_stops_are_spread_evenly_with_both_ends_and_the_start(count):
    for stops, start in product(range(3, count + 1), range(count)):
        kept = thinned(count, stops, start)
        assert {0, start, count - 1} <= {*kept}
        assert kept == sorted(kept)
        assert stops - 1 <= len(kept) <= stops
        if stops > 3:  # a start near an end moves one stop, by one gap at most
            assert max(np.diff(kept)) <= 2 * (count - 1) / (stops - 1) + 1
    assert thinned(count, count, 1) == list(range(count))


def test_where_choices_are_few_all_of_them_are_drawn():
    controls = {"k": (0, 9, 1), "kind": ["a", "b"]}
    axes = laid_out(controls, {"k": 3, "kind": "b"}, 20)
    assert axes["k"].values == list(range(10))
    assert axes["kind"].values == ["a", "b"]
    assert not any(axis.thinned for axis in axes.values())
    assert [axis.about["start"] for axis in axes.values()] == [3, 1]
    assert axes["k"].about["names"] == [f"{k}" for k in range(10)]


def test_otherwise_sliders_keep_the_same_share_and_menus_all():
    controls = {"long": (0, 40, 1), "short": (0, 10, 1), "kind": [("A", 1), ("B", 2)]}
    axes = laid_out(controls, {"long": 7, "short": 10, "kind": 2}, 100)
    sizes = {name: len(axis.values) for name, axis in axes.items()}
    assert sizes["kind"] == 2
    assert axes["kind"].values == [1, 2]
    assert axes["kind"].about["names"] == ["A", "B"]
    assert 60 < np.prod([*sizes.values()]) <= 100
    assert sizes["long"] / 41 == pytest.approx(sizes["short"] / 11, rel=0.35)
    assert {0, 7, 40} <= {*axes["long"].values}
    assert {0, 10} <= {*axes["short"].values}
    assert [axis.thinned for axis in axes.values()] == [True, True, False]


def test_what_too_few_figures_would_show_is_left_to_the_still():
    controls = {"x": (0.0, 1.0, 0.1), "kind": list("abcd")}
    starts = {"x": 0.5, "kind": "a"}
    assert laid_out(controls, starts, 11) == {}
    axes = laid_out(controls, starts, 12)
    assert axes["x"].values == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("most", [4, 20, 60, 200])
def test_a_map_keeps_its_start_its_dots_and_a_lattice_away_from_them(most):
    pb_map = PBMap(BIASES, {}, p=[0.3, 0.3])
    found = places(pb_map.about, pb_map.chosen, most)
    assert 4 <= len(found) <= most
    assert found[0] == pytest.approx(pb_map.chosen)
    dots = [dot["at"] for dot in pb_map.about["dots"]]
    assert found[1:4] == [pytest.approx(dot) for dot in dots]
    assert np.abs(found).max() < pb_map.about["reach"]
    gaps = np.linalg.norm(np.array(found)[:, None] - np.array(found), axis=-1)
    assert gaps[~np.eye(len(found), dtype=bool)].min() > 0.05
    if most > 10:
        assert len(found) > most / 3


def test_a_start_on_a_dot_is_one_place():
    pb_map = PBMap(BIASES, {}, p=BIASES["b"])
    assert len(places(pb_map.about, pb_map.chosen, 4)) == 3


@pytest.mark.slow
def test_the_figures_are_those_of_draw_for_each_place_in_the_order_of_the_controls():
    calls = []

    def draw(k=2, kind="b", p=None):
        calls.append((k, kind, tuple(np.round(p, 6))))
        return titled(k=k, kind=kind, p=calls[-1][2])

    pb_map = PBMap(BIASES, {}, p=BIASES["a"])
    control = Control(draw, k=(1, 3, 1), kind=["a", "b"], p=pb_map)
    calls.clear()
    drawn = control.drawn(30)
    assert drawn["sizes"][:2] == [3, 2]
    assert len(drawn["figures"]) == len(calls) == np.prod(drawn["sizes"])
    at = drawn["controls"][2]["places"]
    expected = product([1, 2, 3], ["a", "b"], [tuple(each) for each in pb_map.at(at)])
    assert calls == [(k, kind, pytest.approx(p)) for k, kind, p in expected]

    # The picture of a place is the one that Python draws there, with its words
    one = drawn["figures"][4 * drawn["sizes"][2]]
    k, kind, p = calls[4 * drawn["sizes"][2]]
    figure = titled(k=k, kind=kind, p=p)
    assert base64.b64decode(one["picture"]) == compact(encoded(figure))
    assert f"'k': {k}, 'kind': '{kind}'" in one["alt"]
    assert f"'k': {k}, 'kind': '{kind}'" in one["details"][0]
    plt.close(figure)
    assert plt.get_fignums() == []

    # Where it starts, it shows what it shows now
    start = np.ravel_multi_index(
        [each["start"] for each in drawn["controls"]], drawn["sizes"]
    )
    assert drawn["figures"][start]["alt"] == control.still()[1].summary
    control.check()


def test_a_kernel_draws_beforehand_only_where_it_is_asked_for(monkeypatch):
    control = Control(lambda k=1: titled(k=k), k=(0, 3, 1))
    data, _ = control._repr_mimebundle_()
    assert _drawn.MIME not in data
    monkeypatch.setenv(_drawn.MOST, "10")
    data, _ = control._repr_mimebundle_()
    assert len(data[_drawn.MIME]["figures"]) == 4
    monkeypatch.setenv(_drawn.MOST, "2")
    data, _ = control._repr_mimebundle_()
    assert _drawn.MIME not in data


def test_a_choice_that_cannot_be_drawn_is_an_error_that_check_raises(monkeypatch):
    control = Control(lambda k=1: titled(k=1 / k), k=(0, 3, 1))
    control.check()
    monkeypatch.setenv(_drawn.MOST, "10")
    data, _ = control._repr_mimebundle_()
    assert _drawn.MIME not in data
    assert "image/png" in data
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        control.check()


def test_a_compact_picture_has_the_same_size_and_looks_the_same():
    figure = titled(a=1)
    figure.axes[0].set_facecolor("#f4f9fe")  # a tint that 16 levels would lose
    png = encoded(figure)
    plt.close(figure)
    small = compact(png)
    assert small[8:12] == b"WEBP"
    assert len(small) < 0.5 * len(png)
    before, after = [
        np.asarray(Image.open(io.BytesIO(each)).convert("RGB"), int)
        for each in (png, small)
    ]
    assert before.shape == after.shape
    assert np.abs(before - after).max() <= 8
    tint = (before == (0xF4, 0xF9, 0xFE)).all(axis=-1)
    assert tint.sum() > 1000
    assert (after[tint] == before[tint]).all()
    assert (after[before == 255] == 255).all()
