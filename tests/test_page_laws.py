"""What the page "Throw a cloth" may not turn around: axes, signs and the estimate's step.

Its sources run in the Node.js that Playwright brings along; nothing has to be built.
"""

import json
import subprocess
from pathlib import Path

import playwright
import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "web" / "page"
WIDGETS = ROOT / "clothlab" / "lab" / "static"


def node(*sources: Path, script: str):
    """What a script, behind these sources, hands to `say`."""
    program = next((Path(playwright.__file__).parent / "driver").glob("node*"))
    begin = "const say = (found) => console.log(JSON.stringify(found));"
    texts = [begin, *(source.read_text("utf-8") for source in sources), script]
    done = subprocess.run(
        [program, "--input-type=module", "-"],
        input="\n".join(texts),
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


CANVAS = """
const dots = [], handlers = {}, chosen = [];
const known = { arc: (x, y) => dots.push([x, y]) };
const ctx = new Proxy({}, { get: (_, name) => known[name] ?? (() => null), set: () => true });
const canvas = {
  style: { setProperty() {} }, dataset: {}, clientWidth: 300, setAttribute() {}, getContext: () => ctx,
  addEventListener: (name, act) => (handlers[name] = act),
  getBoundingClientRect: () => ({ left: 10, top: 20, width: 300 }),
};
globalThis.document = { createElement: () => canvas };
globalThis.ResizeObserver = class { observe() {} };
globalThis.writer = () => ({ size: 10, thick: 1, width: () => 10, write() {}, upwards() {} });
const map = pbMap((at) => chosen.push(at));
const places = [[0, 0], [2, 0], [0, 1]];
map.draw({ dots: places.map((at, k) => ({ name: `${k}`, label: "", at })), reach: 2 });
handlers.click({ clientX: dots[1][0] + 10, clientY: dots[1][1] + 20 });
handlers.click({ clientX: dots[2][0] + 10, clientY: dots[2][1] + 20 });
const key = (name) => handlers.keydown({ key: name, preventDefault() {}, stopPropagation() {} });
map.draw({ at: [0, 0] });
key("ArrowUp");
say({ dots, chosen });
"""


def test_on_the_map_pc1_is_across_and_pc2_upwards_for_eyes_and_clicks():
    found = node(WIDGETS / "map.js", script=CANVAS)
    (x, y), (right, level), (across, higher) = found["dots"][:3]
    assert right > x + 50
    assert level == y
    assert across == x
    assert higher < y - 25  # lines of a picture count downwards
    clicked_right, clicked_up, moved_up = found["chosen"]
    assert clicked_right == pytest.approx([2, 0])
    assert clicked_up == pytest.approx([0, 1])
    assert moved_up == pytest.approx([0, 0.1])


PLANE = """
const plane = makePlane({ mean: [1, 2, 3], axes: [[0, 1, 0], [0, 0, 1]] });
say({ at: plane.at([9, 4, 8]), p: plane.p([2, 5]) });
"""


def test_a_place_of_the_plane_counts_along_its_first_axis_first():
    found = node(PAGE / "geometry.js", PAGE / "views.js", script=PLANE)
    assert found == {"at": [2, 5], "p": [1, 4, 8]}


ELLIPSE = """
const [count, pushes] = [2, []];
// Of two elbows, and of two softnesses each: one push, whose end tells both.
for (const elbow of [0, 1]) for (const soft of [0, 1]) pushes.push(elbow + 10, soft + 20);
const grid = { elbows: [-1, 0], softness: [0.01, 0.1], count, pushes: Float64Array.from(pushes) };
const pushed = makeEllipse(grid);
say({ still: pushed([0, -1], 100)[0], bent: pushed([0, 0], 100)[0], soft: pushed([0, -1], 10)[0],
  lowered: pushed([Math.PI / 2, -1], 100)[0] });
"""


def test_a_push_s_end_is_forward_then_up_and_turns_with_the_shoulder():
    found = node(PAGE / "geometry.js", PAGE / "ellipse.js", script=ELLIPSE)
    assert found["still"] == pytest.approx([10, 20])
    assert found["bent"] == pytest.approx([11, 20])
    assert found["soft"] == pytest.approx([10, 21])
    # An angle grows downwards: what was forward is down, what was up is forward
    assert found["lowered"] == pytest.approx([20, -10])


ESTIMATE = """
class Refusal extends Error {}
const asked = [];
const networks = { estimate: async ({ s, u, p, judged }) => {
  asked.push({ s: [...s], u: [...u], p: [...p], judged });
  return { step: [0.25, -0.5] };
} };
const estimation = { window: 3, warmup: 1, least: 2 };
const update = makeTracker(networks, { estimation }, [1, 2]);
const path = [];
for (let t = 0; t < 5; t++) path.push([...(await update([t], [10 * t], { atRest: true }))]);
say({ path, asked });
"""


def test_the_page_s_estimate_moves_by_the_whole_step_and_judges_what_lies_in_the_window():
    sources = [PAGE / f"{name}.js" for name in ("geometry", "controller", "estimator")]
    found = node(*sources, script=ESTIMATE)
    moved = [[1.25, 1.5], [1.5, 1.0], [1.75, 0.5]]
    assert found["path"] == [[1, 2], [1, 2], *moved]
    # Until the window is full, all predictions count; then the first fills the memory
    judged = [each["judged"] for each in found["asked"]]
    assert judged == [[1, 1], [0, 1, 1], [0, 1, 1]]
    last = found["asked"][-1]
    assert last["s"] == [1, 2, 3, 4]
    assert last["u"] == [10, 20, 30, 40]
    assert last["p"] == moved[1]
