"""Drawing a scene: one of MuJoCo's renderers for each size of picture."""

import os

import mujoco
import numpy as np

from clothlab._validation import HEIGHT, check_number


class Renderers:
    """Draws pictures of one scene; each size has a renderer of its own.

    A renderer keeps the surface of the cloth that it was made with: `close`, where
    another shape takes its place.
    """

    def __init__(self) -> None:
        self._of_size: dict[tuple[int, int], mujoco.Renderer] = {}

    def get(self, model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
        """The renderer of that size [pixel], made when it is first asked for."""
        _check_process()
        height = check_number("height", height, int)
        width = check_number("width", width, int)
        room = model.vis.global_
        if not (1 <= height <= room.offheight and 1 <= width <= room.offwidth):
            has = f"{room.offwidth}×{room.offheight} pixels"
            raise ValueError(
                f"Scene(picture_size=...) made room for {has}, got {width}×{height}"
            )
        size = (height, width)
        if size not in self._of_size:
            self._of_size[size] = _make_renderer(model, height, width)
        return self._of_size[size]

    def __len__(self) -> int:
        """Return how many sizes there are."""
        return len(self._of_size)

    def close(self) -> None:
        """Release the OpenGL contexts."""
        while self._of_size:
            _, renderer = self._of_size.popitem()
            renderer.close()


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


# The process that drew first. OpenGL does not survive a fork: a child would wait for
# threads that only its parent has.
_drew_first: int | None = None


def _check_process() -> None:
    global _drew_first
    _drew_first = _drew_first or os.getpid()
    if _drew_first != os.getpid():
        raise RuntimeError(
            "this process was forked from one that had drawn, and can't draw: start it "
            'afresh, as with make_vec(..., vector_kwargs={"context": "spawn"})'
        )


def _release_opengl() -> None:
    """Let go of this thread's OpenGL context.

    EGL refuses it to others as long as one thread holds it, and JupyterLab runs cells
    in one thread and calls widgets in another.
    """
    if os.environ.get("MUJOCO_GL") == "egl":
        from mujoco.egl import EGL

        EGL.eglReleaseThread()


def _make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # each back end raises its own kind
        raise RuntimeError(
            "no OpenGL for drawing: install one with `apt-get install libegl1 "
            "libopengl0 libgl1-mesa-dri` and restart Python; `python -m clothlab "
            "doctor` tests it"
        ) from error

    # Shadows and reflections cost a third of the time and only disturb the colour
    # extraction.
    if height <= HEIGHT:
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    return renderer
