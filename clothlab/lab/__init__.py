"""The live lab: `LivePanel` steers a `LiveSession`; `Control` and `PBMap` are small controls for notebooks."""

from clothlab.lab.controls import Control, PBMap
from clothlab.lab.panel import LivePanel
from clothlab.lab.session import LiveSession

__all__ = ["Control", "LivePanel", "LiveSession", "PBMap"]
