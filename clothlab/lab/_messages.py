"""The panel's message: what a person did wrong, and faults of ours.

Tracebacks of faults are kept.
"""

import traceback
from collections.abc import Callable

from clothlab.simulation.env import SimulationError

# What a person can do wrong; the rest is our fault
KNOWN_ERRORS = (ValueError, KeyError, OSError, SimulationError)
# Tracebacks that are kept: a fault in each step would otherwise fill the memory
MOST_ERRORS = 20
_LONGEST_ERROR = 4000  # letters of a traceback, of which the last say most
_LONGEST_TEXT = 300  # letters of a message; some errors repeat what they were given


def keep_error(errors: list[str]) -> None:
    """Add the traceback of the present exception.

    Where there are so many already, one more says nothing.
    """
    if len(errors) < MOST_ERRORS:
        errors.append(traceback.format_exc()[-_LONGEST_ERROR:])


class Messages:
    """The message that the panel, or a part of it, shows.

    Tracebacks of faults go to `errors`.
    """

    def __init__(self, errors: list[str] | None = None):
        self.errors = [] if errors is None else errors
        self.say("")

    def say(self, text: str, kind: str = "info") -> None:
        """Show this from now on; the kind is `info`, `mistake` or `fault`."""
        if len(text) > _LONGEST_TEXT:
            text = f"{text[:_LONGEST_TEXT]} …"
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
            keep_error(self.errors)
            words = traceback.format_exception_only(error)[-1].strip()
            self.say(f"✗ a fault in the panel: {words}", "fault")
        else:
            return True
        return False
