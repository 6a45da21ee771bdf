"""The camera in JavaScript sees of the cloth what MuJoCo's renderer shows."""

import numpy as np
import pytest

from clothlab import ClothEnv, encode, iou, load
from web.scene import scene

STATES = 200
ALIKE = 0.05  # [s.d. of z], mean distance of what is seen
# Arm, cloth, and the mean IoU with the renderer's masks at least
WORLDS = [("torque", "damp0.05-mass0.10", 0.97), ("muscle", "soft-1", 0.95)]


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


@pytest.mark.parametrize(("arm", "cloth", "least"), WORLDS)
def test_masks_are_those_of_the_renderer(node, arm, cloth, least):
    states, expected = swung(arm, cloth)
    masks = node("masks.mjs", arm, {"scene": scene(arm, cloth), "states": states})
    found = np.array([list(mask) for mask in masks]).reshape(expected.shape) == "1"
    alike = iou(found, expected).mean()
    autoencoder = load(f"{arm}-0").autoencoder
    apart = encode(autoencoder, found) - encode(autoencoder, expected)
    apart = np.linalg.norm(apart, axis=-1).mean()
    print(f"{arm}: mean IoU {alike:.4f}, {apart:.4f} s.d. of z apart")
    assert alike > least
    assert apart < ALIKE

    # A mirrored camera would be noticed
    assert iou(found[:, :, ::-1], expected).mean() < least
