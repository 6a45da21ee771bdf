"""A second engine: the page "Throw a cloth" in the Firefox of the system."""

import numpy as np
import pytest
from second_engine import firefox, lacks_firefox

pytestmark = pytest.mark.book

PERIODS = 3
STEPS = 8 * PERIODS
THROW = """(async () => {
    const { model } = document.getElementById("clothlab-lab");
    const messages = [];
    for (let k = 0; k < %d; k++) {
        await model.send({ do: "step", id: "" });
        messages.push(model.get("state").message.text);
    }
    while (!model.get("frame").clock.endsWith("step %d"))
        await new Promise((resolve) => setTimeout(resolve, 50));
    const [{ lines, limit }] = model.get("frame").traces;
    return { distances: lines[0].values, still: limit[1], messages };
})()"""
LOADED = """new Promise((resolve) => {
    const look = () => document.querySelector("[data-frame]") ? resolve(true) : setTimeout(look, 50);
    look();
})"""
PICTURES = """[...document.querySelectorAll("canvas.drawn")].map((canvas) => {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return new Set(new Uint32Array(data.buffer)).size;
})"""


@pytest.fixture
def engine(tmp_path):
    if reason := lacks_firefox():
        pytest.skip(reason)
    with firefox(tmp_path) as engine:
        yield engine
        assert engine.said == []


def test_a_robot_throws_in_firefox(engine, folder):
    engine.visit(f"{(folder / 'throw.html').as_uri()}")
    assert "Firefox" in engine.evaluate("navigator.userAgent")
    assert engine.evaluate(LOADED)
    found = engine.evaluate(THROW % (STEPS, STEPS))
    assert {*found["messages"]} == {""}
    ends = np.array(found["distances"])[7::8]
    assert np.median(ends) < 0.6 * found["still"]

    # What is drawn has colours
    assert min(engine.evaluate(PICTURES)) > 1


def test_what_goes_wrong_there_is_heard(engine, folder):
    engine.visit((folder / "throw.html").as_uri())
    engine.evaluate("console.error('heard')")
    assert engine.said == ["heard"]
    engine.said.clear()
