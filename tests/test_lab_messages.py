"""What the panel says, and what it keeps."""

import re

import pytest

from clothlab.lab.messages import KNOWN_ERRORS, Messages


def fail(error):
    def act():
        raise error

    return act


@pytest.mark.parametrize("kind", KNOWN_ERRORS)
def test_a_mistake_is_a_message_without_quotes(kind):
    messages = Messages()
    assert not messages.guarded(fail(kind("unknown arm 'octopus'")))
    assert messages.shown == {"text": "⚠ unknown arm 'octopus'", "kind": "mistake"}
    assert messages.errors == []


def test_a_fault_is_kept_and_raised():
    kept = []
    messages = Messages(kept)
    assert not messages.guarded(fail(ZeroDivisionError("on purpose")))
    assert messages.shown == {"text": "✗ a fault in the panel: ZeroDivisionError: on purpose", "kind": "fault"}
    assert messages.errors is kept
    assert len(kept) == 1
    assert re.match(r"Traceback(.|\n)*on purpose", kept[0])


def test_what_goes_well_leaves_the_message_alone():
    messages = Messages()
    messages.say("saved")
    assert messages.guarded(lambda: None)
    assert messages.shown == {"text": "saved", "kind": "info"}


def test_an_interrupt_is_nobody_s_fault():
    with pytest.raises(KeyboardInterrupt):
        Messages().guarded(fail(KeyboardInterrupt()))
