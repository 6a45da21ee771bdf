"""The live lab's canvas, in a real browser without JupyterLab: strokes leave discs
along lines.
"""

import numpy as np
import pytest

from clothlab._validation import HEIGHT, WIDTH
from clothlab.data import load_target
from clothlab.lab.widget import javascript

pytestmark = pytest.mark.browser

PAGE = f"""
<script>{javascript("target")}
const tool = {{ brush: 1, erase: false }};
let drawn = [];
const target = targetCanvas([{WIDTH}, {HEIGHT}], tool, (pixels) => (drawn = Array.from(pixels)));
target.canvas.style.position = "fixed";
target.canvas.style.left = target.canvas.style.top = "0";
addEventListener("load", () => document.body.append(target.canvas));
</script>
"""
STORED = {  # with which brush and strokes [pixel] the stored target was drawn
    "bar": (7, [[(64, 54), (92, 54)]]),
    "corner": (5, [[(62, 38), (62, 68), (82, 68)]]),
    "triangle": (
        3,
        [
            [(57, 42), (88, 50), (64, 70), (57, 42)],
            [(60, 46), (82, 51), (65, 64), (62, 50), (74, 53), (66, 59)],
        ],
    ),
}


@pytest.mark.parametrize("name", STORED)
def test_a_stored_target_is_what_the_canvas_makes_of_its_strokes(page, name):
    page.goto("about:blank")  # without what the page before declared
    page.set_content(PAGE, wait_until="load")
    brush, strokes = STORED[name]
    page.evaluate(f"tool.brush = {brush}")
    scale = page.evaluate("target.canvas.getBoundingClientRect().width") / WIDTH
    for stroke in strokes:
        for k, (column, row) in enumerate(stroke):
            page.mouse.move(column * scale, row * scale)
            if k == 0:
                page.mouse.down()
        page.mouse.up()
    drawn = np.array(page.evaluate("drawn"), bool).reshape(HEIGHT, WIDTH)
    assert np.array_equal(drawn, load_target(f"drawn/{name}"))
