"""Drawing a scene, and from where people look at it."""

import contextlib
import importlib
import os
import sys

import mujoco
import numpy as np

import clothlab
from clothlab._validation import HEIGHT, check_number
from clothlab.simulation.arm import JOINTS, SHOULDER_POSITION, Arm
from clothlab.simulation.cloth import Cloth

# MuJoCo's word that no OpenGL is there; asked a second time, it ends Python
_refusals: list[Exception] = []


def make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """Make a renderer for pictures of one size [pixel].

    It keeps the surface of the cloth that the model has now. A RuntimeError says what
    to do where there is no OpenGL.
    """
    # The model says how large a picture may be.
    model.vis.global_.offheight = check_number("height", height, int, at_least=1)
    model.vis.global_.offwidth = check_number("width", width, int, at_least=1)
    _load_triton_before_mesa()
    if _refusals:
        raise RuntimeError(_remedy()) from _refusals[0]
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # each back end raises its own kind
        if "platform library has not been loaded" in str(error):
            _refusals.append(error)
        raise RuntimeError(_remedy()) from error

    # Shadows and reflections cost a third of the time and only disturb the colour
    # extraction.
    if height <= HEIGHT:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return renderer


def _load_triton_before_mesa() -> None:
    """Keep two versions of LLVM apart, of which each would call functions of the other.

    Triton, which a PyTorch with CUDA brings and imports with its first optimiser, holds
    one. Mesa, which draws without a GPU, loads another one for all to see. Python ends
    in a segmentation fault where Triton finds that one there.
    """
    # Most have none, and one that cannot be imported is torch's affair
    with contextlib.suppress(Exception):
        importlib.import_module("triton")


def _remedy() -> str:
    """What brings OpenGL to this machine."""
    named = clothlab.opengl_named
    if named:
        return (
            f"MUJOCO_GL={named} is set, and does not draw here: unset it and restart "
            "Python, and clothlab chooses what draws"
        )
    if not sys.platform.startswith("linux"):
        return "no OpenGL for drawing: start Python where there is a display"
    return (
        "no OpenGL for drawing: install one with `apt-get install libegl1 libopengl0 "
        "libgl1-mesa-dri` and restart Python; `python -m clothlab doctor` tests it"
    )


def draw(
    renderer: mujoco.Renderer,
    data: mujoco.MjData,
    view: str | mujoco.MjvCamera,
    depth: bool = False,
) -> np.ndarray:
    """A picture `[height, width, 3]` uint8; depth `[height, width]` float32 [m]."""
    renderer.update_scene(data, view)
    if depth:
        renderer.enable_depth_rendering()
    try:
        return renderer.render()
    finally:
        renderer.disable_depth_rendering()
        _release_opengl()


def _release_opengl() -> None:
    """Let go of this thread's OpenGL context.

    EGL refuses it to others as long as one thread holds it, and JupyterLab runs cells
    in one thread and calls widgets in another.
    """
    if os.environ.get("MUJOCO_GL") == "egl":
        from mujoco.egl import EGL

        EGL.eglReleaseThread()


def onlooker(arm: Arm) -> str | mujoco.MjvCamera:
    """A view for people that shows robot and cloth.

    It is the arm's own camera, unless that stands too near to see both. A camera at the
    robot's head sees what the robot needs, and half of the robot. Then this view is
    from beside and behind it, where the front of the cloth shows, too.
    """
    reach = len(JOINTS) * arm.link_length + Cloth("").length
    from_shoulder = np.subtract(arm.camera.position, SHOULDER_POSITION)
    if np.linalg.norm(from_shoulder) > reach:
        return "camera"

    view = mujoco.MjvCamera()
    view.lookat[:] = np.add(SHOULDER_POSITION, [arm.link_length, 0.0, -0.1])
    view.distance = 2 * reach
    view.azimuth = -50.0  # [degree] from the x axis
    view.elevation = -18.0  # [degree]
    return view
