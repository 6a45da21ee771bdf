"""Dynamic cloth manipulation with a deep predictive model and parametric bias.

Shape letters, used in every docstring of the package:

| letter | meaning |
| --- | --- |
| `B` | batch: sequences, or candidate command sequences |
| `T` | control steps of 0.2 s |
| `K` | trained materials (cloths) |
| `H, W` | image height and width, 96 and 128 pixels |
| `D_z` | latent image, 3 |
| `D_r` | robot state: 4 for the torque arm, 12 for the muscle arm |
| `D_s` | state `s = (z, robot state)` |
| `D_u` | command: 2 for the torque arm, 3 for the muscle arm |
| `D_p` | parametric bias, 2 |

Units are SI and stand in brackets: `[rad] [N] [s] [m] [kg]`. Commands and states cross
every public boundary in physical units; the networks normalise them inside.
"""

import ctypes.util
import importlib
import os
import sys

import lazy_loader

__version__ = "0.5.0"

# The table of contents stands in `__init__.pyi`: a name is imported when it is first
# asked for, so that the method runs without the simulation.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# The OpenGL back end that the user chose; empty without a choice, also where a process
# above this one has made clothlab's
opengl_named = os.environ.get("MUJOCO_GL", "").lower().strip()
if opengl_named == os.environ.get("CLOTHLAB_OPENGL"):
    opengl_named = ""


def _choose_opengl() -> None:
    """Pick the OpenGL back end, unless the user already has, of those that are there.

    MuJoCo reads the choice once, when it is first imported. EGL draws with and without
    a display, so it is preferred. It opens the window into OpenGL, whose functions lie
    in a library of their own: where that is missing, importing MuJoCo with EGL chosen
    fails. With no library present, importing MuJoCo works, and the error comes where
    something is drawn, with what to do. So it is where a user chose one that is not
    installed.
    """
    # Each back end needs its own library, and any one of those beside it.
    needed = {"EGL": ("OpenGL", "GL"), "OSMesa": ("OSMesa",)}
    if opengl_named:
        needed = {k: each for k, each in needed.items() if k.lower() == opengl_named}
    if not sys.platform.startswith("linux") or not needed:
        return

    chosen = "disable"
    for name, others in needed.items():
        if ctypes.util.find_library(name) and any(
            ctypes.util.find_library(each) for each in others
        ):
            chosen = name.lower()
            break
    if chosen == opengl_named:
        return
    os.environ["MUJOCO_GL"] = os.environ["CLOTHLAB_OPENGL"] = chosen

    # `import mujoco` may have come first; import sorters put it there.
    already_chosen = sys.modules.get("mujoco.rendering.classic.gl_context")
    if already_chosen is not None:
        importlib.reload(already_chosen)


_choose_opengl()
# Gymnasium is not imported for this alone, which takes long.
if "gymnasium" in sys.modules:
    importlib.import_module("clothlab.simulation")  # registers `clothlab/Cloth-v0`
