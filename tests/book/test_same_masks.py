"""The camera in JavaScript sees of the cloth what MuJoCo's renderer shows."""

import numpy as np
import pytest

from clothlab.data import load
from clothlab.lab._equipment import Equipment
from clothlab.masks import iou
from clothlab.method.autoencoder import encode
from clothlab.simulation.env import ClothEnv
from course.lab_constants import method_files
from course.lab_gates import GATES
from course.lab_scene import scene
from course.npm import packages

pytestmark = pytest.mark.book

STATES = 200
WORLDS = [("torque", "damp0.05-mass0.10"), ("muscle", "soft-1")]


def swung(arm, cloth):
    """States of random swinging, and their masks `[STATES, H, W]`."""
    env = ClothEnv(arm, cloth)
    rng = np.random.default_rng(7)
    states = []
    images = []
    for k in range(STATES):
        if k % 2 == 0:
            u = rng.uniform(env.arm.command_lower, env.arm.command_upper)
        env.advance(u)
        states.append(env.data.qpos.tolist())
        images.append(env.observe()["image"].astype(bool))
    env.close()
    return states, np.array(images)


@pytest.mark.parametrize(("arm", "cloth"), WORLDS)
def test_masks_are_those_of_the_renderer(node, gate, tmp_path, arm, cloth):
    states, expected = swung(arm, cloth)
    for name, content in method_files(Equipment.of(arm)).items():
        (tmp_path / name).write_bytes(content)
    runtime = packages()["onnxruntime-web"].folder / "dist"
    graphs = {"folder": str(tmp_path), "runtime": str(runtime)}
    world = {"scene": scene(arm, cloth), "states": states}
    masks = node("masks.mjs", graphs | world)
    found = np.array([list(mask) for mask in masks]).reshape(expected.shape) == "1"
    autoencoder = load(f"{arm}-0").autoencoder
    apart = encode(autoencoder, found) - encode(autoencoder, expected)
    gate(f"masks {arm}", iou(found, expected).mean())
    gate(f"seen {arm}", np.linalg.norm(apart, axis=-1).mean())

    # A mirrored camera would be noticed
    mirrored = iou(found[:, :, ::-1], expected).mean()
    assert not GATES[f"masks {arm}"].holds(mirrored)
