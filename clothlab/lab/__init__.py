"""The live lab: `LivePanel` steers a `LiveSession`.

Notebooks have small widgets beside it: `Control`, `PBMap` and `TargetCanvas`.
"""

from clothlab.lab.canvas import TargetCanvas
from clothlab.lab.controls import Control
from clothlab.lab.map import PBMap
from clothlab.lab.panel import LivePanel
from clothlab.lab.session import LiveSession

__all__ = ["Control", "LivePanel", "LiveSession", "PBMap", "TargetCanvas"]
