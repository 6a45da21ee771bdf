"""A robot in a page that lies in a folder: MuJoCo in a worker, without a server."""

import mujoco
import numpy as np
import pytest
from test_same_physics import BOUND, here, some_commands

from clothlab.simulation.arm import ARMS
from course.lab_page import scene, sources, write_robot
from course.npm import packages

# Not in `make test` yet: the page's policy stops MuJoCo's JavaScript, which makes
# functions of strings; 'unsafe-eval' would let it pass.
pytestmark = pytest.mark.nightly

# What the page may load, and WebAssembly
POLICY = "default-src 'self' file: data: blob: 'unsafe-inline' 'wasm-unsafe-eval'"
PAGE = f"""<!doctype html><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<script src="worker.js"></script><script src="mujoco.js"></script><script src="robot-page.js"></script>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    if not packages()["@mujoco/mujoco"].folder.exists():
        pytest.skip("NO FILES OF NPM: run `make npm`")
    folder = tmp_path_factory.mktemp("page")
    write_robot(folder)
    (folder / "robot-page.js").write_text(sources("files", "robot"), "utf-8")
    (folder / "index.html").write_text(PAGE, "utf-8")
    return folder


def test_it_moves_as_in_python_and_is_seen(folder, visit):
    world = scene("torque", "damp0.05-mass0.10")
    model = mujoco.MjModel.from_xml_string(world["mjcf"])
    commands = some_commands(ARMS["torque"], model)
    page = visit(folder / "index.html")
    found = page.evaluate(
        """async ([scene, commands]) => {
            const ask = await startRobot(), positions = [];
            const { mask } = await ask("hold", { scene });
            for (const ctrl of commands) positions.push([...(await ask("advance", { ctrl })).qpos]);
            const again = await ask("reset");
            return [positions, mask.reduce((sum, on) => sum + on, 0), `${again.mask}` === `${mask}`];
        }""",
        [world, commands],
    )
    positions, pixels, same = found
    assert np.abs(np.array(positions) - here(world, commands)).max() < BOUND
    assert pixels > 100
    assert same


def test_what_cannot_be_simulated_is_said_and_changes_nothing(folder, visit):
    world = scene("torque", "damp0.05-mass0.10")
    page = visit(folder / "index.html")
    said, moved = page.evaluate(
        """async (scene) => {
            const ask = await startRobot();
            await ask("hold", { scene });
            const said = await ask("hold", { scene: { ...scene, mjcf: "<mujoco><nothing/></mujoco>" } }).catch((error) => error.message);
            return [said, (await ask("advance", { ctrl: [0.5, -0.5] })).qpos.length];
        }""",
        world,
    )
    assert "nothing" in said
    assert moved == len(world["start"]["qpos"])
