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

import contextlib
import ctypes.util
import importlib
import os
import sys
from typing import Any

from clothlab import _extras

__version__ = "0.5.0"

# The table of contents: where each name is, by subject. Importing the package imports
# none of it, so that the method runs without a simulation, and the simulation without
# Jupyter. `__init__.pyi` says the same to editors and type checkers.
_METHOD: dict[str, dict[str, list[str]]] = {
    # `pip install clothlab`: the method, for any robot
    "The four calls": {
        "method.collecting": ["collect_runs"],
        "method.training": ["train_dpmpb"],
        "method.gauss_newton": ["estimate_bias"],
        "method.control": ["Controller"],
    },
    "Runs": {
        "method.data": ["Run"],
        "method.logs": ["read_runs", "runs_from_dataframe"],
        "method.rollout": ["rollout"],
        "method.policy": ["Policy"],
    },
    "Networks and their training": {
        "method.model": ["PredictiveModel", "DPMPB", "predict"],
        "method.training": ["ModelTraining"],
    },
    "Estimation": {
        "method.estimation": ["BiasEstimator"],
        "method.gauss_newton": ["NewtonEstimator"],
    },
    "Control": {
        "method.control": ["ControlSettings", "GradientSearch"],
        "method.fast_rollout": ["FastDPMPB"],
    },
    "On a robot": {"method.checkpoint": ["Checkpoint"]},
    "The task of the paper": {
        "method.autoencoder": ["AutoencoderTraining", "encode", "decode"],
        "method.cloth_task": [
            "ControlPolicy",
            "EstimatingPolicy",
            "observe",
            "period_mask",
        ],
        "masks": ["iou"],
    },
}
_CLOTH: dict[str, dict[str, list[str]]] = {
    # `pip install clothlab[cloth]`: the robot, the cloth, and what was recorded of them
    "What is stored": {
        "data": [
            "load",
            "load_autoencoder",
            "load_model",
            "load_target",
            "load_targets",
            "load_trials",
        ],
        "trials": ["recorded_plans"],
    },
    "The simulation": {
        "simulation.env": ["ClothEnv", "CONTROL_PERIOD"],
        "simulation.arm": ["MuscleArm"],
        "simulation.cloth": ["CLOTHS", "Cloth", "cloth_name", "get_cloth"],
        "simulation.scene": ["Scene"],
        "simulation.vision": ["chamfer_distance"],
        "policies": ["OperatorPolicy", "RandomPolicy", "ReplayPolicy"],
    },
}
_NOTEBOOKS: dict[str, dict[str, list[str]]] = {
    # `pip install clothlab[notebooks]`
    "Modules that the lessons use": {
        "analysis": ["analysis"],
        "checks": ["checks"],
        "lab": ["lab"],
        "plots": ["plots"],
        "tables": ["tables"],
    }
}
_EXTRAS = {"": _METHOD, "cloth": _CLOTH, "notebooks": _NOTEBOOKS}
_PLACES = {
    name: (f"clothlab.{module}", extra)
    for extra, subjects in _EXTRAS.items()
    for modules in subjects.values()
    for module, names in modules.items()
    for name in names
}
__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    """Import a name of the table of contents when it is first asked for (PEP 562)."""
    if name not in _PLACES:
        raise AttributeError(f"module 'clothlab' has no attribute {name!r}")
    place, extra = _PLACES[name]
    try:
        module = importlib.import_module(place)
    except ModuleNotFoundError as error:
        if not extra or (error.name or "").startswith("clothlab"):
            raise
        raise _extras.lacking(f"clothlab.{name}", error.name, extra) from error

    # The next time it is found without this function.
    found = module if place == f"clothlab.{name}" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """What can be asked for, imported or not."""
    return sorted({*globals(), *_PLACES})


def _choose_opengl() -> None:
    """Pick the OpenGL back end, unless the user already has.

    MuJoCo reads the choice once, when it is first imported. EGL draws with and without
    a display, so it is preferred. It opens the window into OpenGL, whose functions lie
    in a library of their own: where that is missing, importing MuJoCo with EGL chosen
    fails. With no library present, importing MuJoCo works, and the error comes where
    something is drawn, with the names of the packages to install.
    """
    if not sys.platform.startswith("linux") or "MUJOCO_GL" in os.environ:
        return

    # Each back end needs its own library, and any one of those beside it.
    chosen = "disable"
    needed = {"EGL": ("OpenGL", "GL"), "OSMesa": ("OSMesa",)}
    for name, others in needed.items():
        if ctypes.util.find_library(name) and any(
            ctypes.util.find_library(each) for each in others
        ):
            chosen = name.lower()
            break
    os.environ["MUJOCO_GL"] = chosen

    # `import mujoco` may have come first; import sorters put it there.
    already_chosen = sys.modules.get("mujoco.rendering.classic.gl_context")
    if already_chosen is not None:
        importlib.reload(already_chosen)


_choose_opengl()
# Gymnasium is not imported for this alone, which takes long; and without the extra
# `cloth` there is nothing to register.
if "gymnasium" in sys.modules:
    with contextlib.suppress(ModuleNotFoundError):
        importlib.import_module("clothlab.simulation")  # registers `clothlab/Cloth-v0`
