"""The live lab in Firefox, by WebDriver BiDi, which Firefox speaks itself."""

import json
import re
import shutil
import subprocess
import time

import pytest
from browser_lab import HARMLESS
from websocket import create_connection

pytestmark = pytest.mark.browser
FIREFOX = next(filter(None, map(shutil.which, ("firefox", "firefox-esr"))), None)


class Firefox:
    """One page in a Firefox without a window.

    Attributes:
        errors: what appeared as an error in its console.
    """

    def __init__(self, profile):
        log, command = profile / "log", [FIREFOX, "--headless", "--no-remote", "--remote-debugging-port=0"]
        with log.open("w") as file:
            self._process = subprocess.Popen([*command, "--profile", str(profile)], stdout=file, stderr=file)
        end = time.monotonic() + 60
        while not (found := re.search(r"listening on (ws://\S+)", log.read_text())):
            assert time.monotonic() < end, log.read_text()
            time.sleep(0.2)
        self._socket = create_connection(f"{found[1]}/session", timeout=60, suppress_origin=True)
        self._number, self.errors = 0, []
        self.ask("session.new", capabilities={"alwaysMatch": {"acceptInsecureCerts": True}})
        self._page = self.ask("browsingContext.getTree")["contexts"][0]["context"]
        self.ask("browsingContext.setViewport", context=self._page, viewport={"width": 1500, "height": 1100})
        self.ask("session.subscribe", events=["log.entryAdded"])

    def ask(self, method, **params):
        """Do something, and return the answer; events that come meanwhile are noted."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while (answer := json.loads(self._socket.recv())).get("id") != self._number:
            if answer.get("method") == "log.entryAdded" and answer["params"]["level"] == "error":
                text = str(answer["params"]["text"])
                self.errors += [] if text.startswith(HARMLESS) else [text]
        if answer["type"] == "error":
            raise RuntimeError(f"{method}: {answer['message']}")
        return answer["result"]

    def open(self, address):
        self.ask("browsingContext.navigate", context=self._page, url=address, wait="complete")

    def evaluate(self, expression):
        """What an expression is in the page: a number, a text, true or false."""
        found = self.ask("script.evaluate", expression=expression, target={"context": self._page}, awaitPromise=True)
        if found["type"] == "exception":
            raise RuntimeError(found["exceptionDetails"]["text"])
        return found["result"].get("value")

    def until(self, expression, seconds=60):
        end = time.monotonic() + seconds
        while not self.evaluate(expression):
            assert time.monotonic() < end, f"not within {seconds} s: {expression}"
            time.sleep(0.2)

    def click(self, selector, text):
        """Press the mouse on the first element whose text begins so."""
        place = (
            f"[...document.querySelectorAll('{selector}')].find((each) => each.textContent.trim().startsWith('{text}'))"
        )
        self.until(f"Boolean({place})")
        middle = "at => `${at.x + at.width / 2} ${at.y + at.height / 2}`"
        x, y = (round(float(each)) for each in self.evaluate(f"({middle})({place}.getBoundingClientRect())").split())
        pointer = [
            {"type": "pointerMove", "x": x, "y": y},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        self.ask(
            "input.performActions", context=self._page, actions=[{"type": "pointer", "id": "mouse", "actions": pointer}]
        )

    def close(self):
        self._socket.close()
        self._process.kill()
        self._process.wait()


@pytest.fixture
def firefox(tmp_path):
    if FIREFOX is None:
        pytest.skip("NO FIREFOX: apt-get install firefox-esr")
    firefox = Firefox(tmp_path)
    yield firefox
    firefox.close()


def test_the_live_lab_moves_and_answers_in_firefox(lab, firefox):
    name = "08_live_lab.ipynb"
    firefox.open(f"http://localhost:{lab.port}/lab/tree/{name}?token=t&reset")
    firefox.until("document.querySelectorAll('.jp-Notebook .jp-Cell').length > 3")
    end = time.monotonic() + 60
    while (lab.kernel(name) or {}).get("execution_state") != "idle":
        assert time.monotonic() < end, lab.log.read_text()
        time.sleep(0.2)
    firefox.until("Boolean(document.querySelector('.jp-Notebook-ExecutionIndicator[data-status=idle]'))")
    focus = "document.querySelector('.jp-Notebook .jp-Cell').dispatchEvent(new FocusEvent('focus'))"
    firefox.evaluate(focus)  # a window that nobody sees has no focus, and the menu then knows no notebook to run
    firefox.click(".lm-MenuBar-itemLabel", "Run")
    firefox.click(".lm-Menu-itemLabel", "Run All Cells")
    number = "+(document.querySelector('[data-frame]')?.dataset.frame ?? 0)"
    firefox.until(f"{number} > 5", 90)
    status = "document.querySelector('.clothlab .status').textContent"
    assert firefox.evaluate(status) in ("▶ running", "▶ late")
    firefox.evaluate("document.querySelector('.clothlab').scrollIntoView()")
    firefox.click(".clothlab button", "pause")
    firefox.until(f"{status} === '❚❚ paused'")
    stood = firefox.evaluate(number)
    firefox.click(".clothlab button", "start")
    firefox.until(f"{number} > {stood + 3}")
    firefox.click(".clothlab button", "projector")
    firefox.until("document.querySelector('.clothlab').classList.contains('projector')")
    lab.stop_kernel(name)
    assert firefox.errors == []
    assert "Traceback" not in lab.log.read_text()
