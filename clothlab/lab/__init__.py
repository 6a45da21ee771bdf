"""The live lab: `LivePanel` steers a `LiveSession`; notebooks have small widgets:
Control, PBMap and RecordedRun.
"""

from clothlab.lab.controls import Control, PBMap
from clothlab.lab.panel import LivePanel
from clothlab.lab.playback import RecordedRun
from clothlab.lab.session import LiveSession

__all__ = ["Control", "LivePanel", "LiveSession", "PBMap", "RecordedRun"]
