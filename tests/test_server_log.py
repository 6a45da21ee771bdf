"""What the browser tests take for a fault of the server."""

from browser_lab import faults_in

# As JupyterLab 4.5 writes them: a task's in full width, a callback's indented
CLOSED = """\
Task exception was never retrieved
future: <Task finished name='Task-9' exception=WebSocketClosedError()>
Traceback (most recent call last):
  File "tornado/websocket.py", line 1087, in wrapper
    raise WebSocketClosedError()
tornado.websocket.WebSocketClosedError
[E 2026-11-24 21:32:03.405 ServerApp] Uncaught exception in zmqstream callback
    Traceback (most recent call last):
      File "zmq/eventloop/zmqstream.py", line 570, in _run_callback
        f = callback(*args, **kwargs)
            ^^^^^^^^^^^^^^^^^^^^^^^^^
      File "tornado/websocket.py", line 364, in write_message
        raise WebSocketClosedError()
    tornado.websocket.WebSocketClosedError
[I 2026-11-24 21:32:03.409 ServerApp] Starting buffering
"""
FAULT = """\
[E 2026-11-24 21:32:03.405 ServerApp] Uncaught exception in zmqstream callback
    Traceback (most recent call last):
      File "clothlab/lab/session.py", line 12, in step
        raise ValueError(text)
    ValueError: no such target
"""


STREAM = """\
Task exception was never retrieved
Traceback (most recent call last):
  File "tornado/websocket.py", line 1085, in wrapper
    await fut
tornado.iostream.StreamClosedError: Stream is closed
"""


def test_a_closed_page_is_no_fault():
    assert faults_in(CLOSED) == []
    assert faults_in(CLOSED + STREAM) == []


def test_a_fault_is_told_from_closed_pages():
    assert faults_in(CLOSED + FAULT + CLOSED) == ["ValueError: no such target"]


def test_a_fault_while_another_is_handled_is_told():
    during = (
        "\n    During handling of the above exception, another exception occurred:\n\n"
    )
    _, traceback = FAULT.split("\n", 1)
    log = CLOSED + during + traceback
    assert faults_in(log) == ["ValueError: no such target"]
