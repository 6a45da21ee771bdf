"""What a panel says: what a person did wrong, and faults of ours."""

import traceback
from collections.abc import Callable

from clothlab.simulation.env import SimulationError

# What a person can do wrong; the rest is our fault
KNOWN_ERRORS = (ValueError, KeyError, OSError, SimulationError)


class Messages:
    """The message that a panel shows; tracebacks of faults go to `errors`."""

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.say("")

    def say(self, text: str, kind: str = "info") -> None:
        """Show this from now on; the kind is `info`, `mistake` or `fault`."""
        self.shown = {"text": text, "kind": kind}

    def guarded(self, act: Callable[[], object]) -> bool:
        """Call `act`, and answer whether it went well; an error becomes a message."""
        try:
            act()
        except KNOWN_ERRORS as error:
            # A KeyError would put its text into quotation marks
            words = error.args[0] if isinstance(error, KeyError) else error
            self.say(f"⚠ {words}", "mistake")
        except Exception as error:
            self.errors.append(traceback.format_exc())
            words = traceback.format_exception_only(error)[-1].strip()
            self.say(f"✗ a fault in the panel: {words}", "fault")
        else:
            return True
        return False
