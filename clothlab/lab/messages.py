"""The panel's message: what a person did wrong, and faults of ours, whose tracebacks are kept."""

import traceback
from collections.abc import Callable

from clothlab.simulation.env import SimulationError

KNOWN_ERRORS = (ValueError, KeyError, OSError, SimulationError)  # what a person can do wrong; the rest is our fault


class Messages:
    """The message that the panel, or a part of it, shows; tracebacks of faults go to `errors`."""

    def __init__(self, errors: list[str] | None = None):
        self.errors = [] if errors is None else errors
        self.say("")

    def say(self, text: str, kind: str = "info") -> None:
        """Show this from now on; the kind is `info`, `mistake` or `fault`."""
        self.shown = {"text": text, "kind": kind}

    def guarded(self, act: Callable[[], object]) -> bool:
        """Call `act`, and answer whether it went well; an error becomes a message."""
        try:
            act()
        except KNOWN_ERRORS as error:
            self.say(f"⚠ {error.args[0] if isinstance(error, KeyError) else error}", "mistake")
        except Exception:
            self.errors.append(traceback.format_exc())
            self.say(f"✗ a fault in the panel: {self.errors[-1].splitlines()[-1]}", "fault")
        else:
            return True
        return False
