"""What the panel says: what a person did wrong, and faults of ours, which are kept until somebody looks at them."""

import traceback
from collections.abc import Callable

from clothlab.simulation.env import SimulationError

KNOWN_ERRORS = (ValueError, KeyError, OSError, SimulationError)  # what a person can do wrong; the rest is our fault


class Messages:
    """The message that the panel shows, or a part of it does.

    Args:
        errors: where tracebacks of faults are kept; a list of its own by default.

    Attributes:
        errors: those tracebacks.
        shown: the message and its kind, `{"text": ..., "kind": "info", "mistake" or "fault"}`.
    """

    def __init__(self, errors: list[str] | None = None):
        self.errors = [] if errors is None else errors
        self.say("")

    def say(self, text: str, kind: str = "info") -> None:
        """Show this instead of what was shown."""
        self.shown = {"text": text, "kind": kind}

    def guarded(self, act: Callable[[], object]) -> bool:
        """Call `act`, and answer whether it went well.

        A person's mistake becomes a message; a fault of ours does, too, and its traceback is kept.
        """
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
