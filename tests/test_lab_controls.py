"""Controls for notebooks without a browser: they draw when they are moved, and say what
goes wrong.
"""

import base64
import io

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from clothlab import analysis
from clothlab.lab import Control, PBMap, TargetCanvas
from clothlab.simulation.cloth import CLOTHS

BIASES = {
    name: np.array([cloth.damping / cloth.mass, 10 * cloth.mass])
    for name, cloth in CLOTHS.items()
}
LABELS = {name: cloth.label for name, cloth in CLOTHS.items()}


@pytest.fixture
def calls():
    return []


@pytest.fixture
def draw(calls):
    def draw(target="target-2", period=8):
        calls.append((target, period))
        figure = plt.figure()
        figure.subplots().plot([0, period])
        return figure

    return draw


def test_it_draws_once_at_the_start_and_whenever_a_control_moves(draw, calls):
    control = Control(
        draw,
        labels={"period": "N_periodic"},
        target=["target-1", "target-2"],
        period=(1, 12, 1),
    )
    assert calls == [("target-2", 8)]
    assert [each.description for each in control.controls.values()] == [
        "target",
        "N_periodic",
    ]
    first = control.picture.value
    assert bytes(first).startswith(b"\x89PNG")
    assert not control.controls["period"].continuous_update
    control.controls["period"].value = 3
    control.controls["target"].value = "target-1"
    assert calls[1:] == [("target-2", 3), ("target-1", 3)]
    assert control.picture.value != first
    assert plt.get_fignums() == []  # or the notebook would show them, too
    control.check()


def test_a_menu_shows_words_in_place_of_values():
    drawn = []

    def draw(claim="b"):
        drawn.append(claim)
        return Figure()

    control = Control(draw, claim=[("the first", "a"), ("the second", "b")])
    control.check()
    assert drawn == ["b"]


def test_a_film_is_played_by_its_picture():
    def draw(x=0):
        """A square moves; and more."""
        film = np.zeros((3, 8, 8, 3), np.uint8)
        film[np.arange(3), x, np.arange(3)] = 255
        return film

    control = Control(draw, x=(0, 3, 1))
    with Image.open(io.BytesIO(control.picture.value)) as picture:
        assert picture.format == "PNG"
        # A still for paper, here the second, and three that are played
        assert picture.info["default_image"]
        shown = []
        for k in range(picture.n_frames):
            picture.seek(k)
            shown += np.argwhere(np.asarray(picture.convert("L"))).tolist()
        assert shown == [[0, 1], [0, 0], [0, 1], [0, 2]]
        assert picture.info["duration"] == 50.0
    assert control.still()[1] == "A square moves; and more."
    first = control.picture.value
    control.controls["x"].value = 2
    assert control.picture.value != first
    control.check()


def test_an_error_is_shown_kept_and_raised_by_check(calls):
    def draw(x=0):
        calls.append((x, control.message.value if calls else ""))
        if x > 1:
            raise ZeroDivisionError("on <purpose>")
        return Figure()

    control = Control(draw, x=(0, 3, 1))
    good = control.picture.value
    control.controls["x"].value = 2
    assert "ZeroDivisionError: on &lt;purpose&gt;" in control.message.value
    assert control.picture.value == good
    control.controls["x"].value = 1
    assert control.message.value == ""
    assert calls == [(0, ""), (2, "computing …"), (1, "computing …")]
    with pytest.raises(RuntimeError, match="ZeroDivisionError: on <purpose>"):
        control.check()


def test_the_map_of_p_chooses_a_p(calls):
    name = "damp0.05-mass0.10"
    pb_map = PBMap(
        BIASES, LABELS, p=BIASES[name], reference=BIASES["damp0.03-mass0.05"]
    )
    dots = pb_map.about["dots"]
    assert [dot["label"] for dot in dots] == list(LABELS.values())
    axes = analysis.principal_axes(BIASES)
    assert dots[0]["at"] == pytest.approx(
        axes.transform(BIASES[dots[0]["name"]][None])[0]
    )
    control = Control(lambda p: calls.append(p) or Figure(), p=pb_map)
    pb_map.chosen = [0.3, -0.1]  # as a click does
    assert calls[0] == pytest.approx(BIASES[name])
    assert axes.transform(calls[1][None])[0] == pytest.approx([0.3, -0.1])
    control.check()


def test_a_canvas_has_what_is_drawn(calls):
    mask = np.zeros((96, 128), bool)
    mask[20:40, 50:60] = True
    canvas = TargetCanvas(mask)
    control = Control(lambda mask: calls.append(mask) or Figure(), mask=canvas)
    drawn = np.zeros((96, 128), np.uint8)
    drawn[5, 7] = 1
    canvas.chosen = drawn.tobytes()  # as a stroke does
    assert np.array_equal(calls[0], mask)
    assert np.argwhere(calls[1]).tolist() == [[5, 7]]
    assert np.array_equal(canvas.value, drawn > 0)
    control.check()


def test_a_page_without_a_kernel_gets_a_picture_and_its_words(draw):
    control = Control(draw, target=["target-1", "target-2"], period=(1, 12, 1))
    data, metadata = control._repr_mimebundle_()
    # JupyterLab shows the widget
    assert "application/vnd.jupyter.widget-view+json" in data
    assert base64.b64decode(data["image/png"]) == bytes(control.picture.value)
    assert metadata["image/png"]["alt"] == "Chart"
