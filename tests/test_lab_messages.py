"""What the panel says, and what it keeps."""

import pytest

from clothlab.lab._messages import KNOWN_ERRORS, Messages


def fail(error):
    raise error


@pytest.mark.parametrize("kind", KNOWN_ERRORS)
def test_a_mistake_is_a_message_without_quotes(kind):
    messages = Messages()
    assert not messages.guarded(lambda: fail(kind("unknown arm 'octopus'")))
    assert messages.shown == {"text": "⚠ unknown arm 'octopus'", "kind": "mistake"}
    assert messages.errors == []


def test_a_fault_is_kept():
    messages = Messages()
    assert not messages.guarded(lambda: fail(ZeroDivisionError("on purpose")))
    assert messages.shown == {
        "text": "✗ a fault in the panel: ZeroDivisionError: on purpose",
        "kind": "fault",
    }
    (kept,) = messages.errors
    assert kept.startswith("Traceback")
