"""The live lab: `LivePanel` steers a `LiveSession`; notebooks have small widgets:
Control, PBMap and RecordedRun.
"""

from clothlab.lab._controls import Control, PBMap
from clothlab.lab._panel import LivePanel
from clothlab.lab._playback import RecordedRun
from clothlab.lab._session import LiveSession

__all__ = ["Control", "LivePanel", "LiveSession", "PBMap", "RecordedRun"]
