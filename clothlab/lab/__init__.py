"""The live lab: `LivePanel` steers a `LiveSession`.

Notebooks have small widgets beside it: Control and PBMap. All else in this folder is
the inside of these four.
"""

from clothlab.lab._controls import Control
from clothlab.lab._map import PBMap
from clothlab.lab._panel import LivePanel
from clothlab.lab._session import LiveSession

__all__ = ["Control", "LivePanel", "LiveSession", "PBMap"]
