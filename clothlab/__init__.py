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

__version__ = "0.4.0"


def _choose_opengl() -> None:
    """Pick the OpenGL back end, which MuJoCo reads once, when it is first imported,
    unless the user already has.

    EGL draws with and without a display, so it is preferred. It opens the window into
    OpenGL, whose functions lie in a library of their own: where that is missing,
    importing MuJoCo with EGL chosen fails. With no library present, importing MuJoCo
    works, and the error comes where something is drawn, with the names of the packages
    to install.
    """
    if sys.platform.startswith("linux") and "MUJOCO_GL" not in os.environ:
        # Any of these beside it
        needed = {"EGL": ("OpenGL", "GL"), "OSMesa": ("OSMesa",)}
        has = ctypes.util.find_library
        found = (
            name
            for name, others in needed.items()
            if has(name) and any(map(has, others))
        )
        os.environ["MUJOCO_GL"] = next(found, "disable").lower()
        already_chosen = sys.modules.get("mujoco.rendering.classic.gl_context")
        if (
            already_chosen is not None
        ):  # `import mujoco` came first; import sorters put it there
            importlib.reload(already_chosen)


_choose_opengl()
if "gymnasium" in sys.modules:  # it is not imported for this alone: that takes long
    importlib.import_module("clothlab.simulation")  # registers `clothlab/Cloth-v0`
