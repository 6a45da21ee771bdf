"""Parts of the page that need no MuJoCo and no network."""

import numpy as np
import pytest

from clothlab._validation import HEIGHT, WIDTH
from clothlab.simulation.vision import chamfer_distance

pytestmark = pytest.mark.book

SIZE = (HEIGHT, WIDTH)
LONGEST = 0.3  # [s], in which a robot makes no step


def chamfer_cases():
    """Pairs of masks: scattered, wide shapes, and nearly the whole canvas."""
    rng = np.random.default_rng(0)
    for share in (0.001, 0.1, 0.7):
        yield rng.random((2, *SIZE)) < share
    wide, full = np.zeros((2, *SIZE), bool)
    wide[20:90, 10:120] = True
    full[1:, 2:] = True
    yield wide, np.roll(wide, 20, axis=0)
    yield full, wide
    yield full, np.roll(full, 5, axis=1)


def test_chamfer_distances_are_those_of_python_and_keep_no_robot_waiting(node):
    cases = [*chamfer_cases()]
    questions = [
        {"what": "chamfer", "size": SIZE}
        | {
            name: mask.ravel().astype(int).tolist()
            for name, mask in zip("ab", case, strict=True)
        }
        for case in cases
    ]
    for (a, b), found in zip(cases, node("parts.mjs", questions), strict=True):
        assert found["distance"] == pytest.approx(chamfer_distance(a, b), rel=1e-5)
        assert found["seconds"] < LONGEST
