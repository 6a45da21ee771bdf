"""Firefox without Playwright's own build of it: the one of the system, by WebDriver BiDi."""

import json
import shutil
import subprocess
import time
from contextlib import closing, contextmanager
from itertools import count

from websocket import create_connection  # of websocket-client, with JupyterLab

NAMES = ("firefox-esr", "firefox")
WAITS = 120  # [s] for a start or an answer, at most


def lacks_firefox():
    """Why there is no second engine; empty where there is one."""
    if any(map(shutil.which, NAMES)):
        return ""
    return "NO FIREFOX: apt-get install firefox-esr"


@contextmanager
def firefox(profile):
    """A Firefox without a window, with this empty folder for its settings."""
    name = next(filter(shutil.which, NAMES))
    command = [name, "--headless", "--remote-debugging-port=0", "--profile", profile]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **silent) as process:
        try:
            with closing(Engine(f"{address(profile)}/session")) as engine:
                yield engine
        finally:
            process.terminate()


def address(profile):
    """Where a Firefox that was just started listens, which it writes into its folder."""
    file = profile / "WebDriverBiDiServer.json"
    end = time.monotonic() + WAITS
    while time.monotonic() < end:
        if file.exists() and (text := file.read_text()):
            server = json.loads(text)
            return f"ws://{server['ws_host']}:{server['ws_port']}"
        time.sleep(0.1)
    raise TimeoutError("Firefox does not say where it listens")


class Engine:
    """One page of a browser that speaks WebDriver BiDi."""

    def __init__(self, address):
        self._socket = create_connection(
            address, timeout=WAITS, suppress_origin=True, max_size=None
        )
        self._numbers = count()
        self.said = []  # what went wrong on the page, by its own words
        self._ask("session.new", capabilities={})
        self._ask("session.subscribe", events=["log.entryAdded"])
        tree = self._ask("browsingContext.getTree")
        self._context = tree["contexts"][0]["context"]

    def close(self):
        """Let go of the browser."""
        self._socket.close()

    def _ask(self, method, **params):
        number = next(self._numbers)
        question = {"id": number, "method": method, "params": params}
        self._socket.send(json.dumps(question))
        while True:
            told = json.loads(self._socket.recv())
            if told.get("method") == "log.entryAdded":
                self._hear(told["params"])
            if told.get("id") == number:
                assert told["type"] == "success", told
                return told["result"]

    def _hear(self, entry):
        if entry["level"] in ("error", "warn"):
            self.said.append(entry["text"])

    def visit(self, address):
        """Open a page, and wait until it has loaded."""
        self._ask(
            "browsingContext.navigate",
            context=self._context,
            url=address,
            wait="complete",
        )

    def evaluate(self, expression):
        """The value of an expression in JavaScript, or what it promises."""
        found = self._ask(
            "script.evaluate",
            expression=f"(async () => JSON.stringify(await ({expression})))()",
            target={"context": self._context},
            awaitPromise=True,
        )
        assert found["type"] == "success", found
        return json.loads(found["result"].get("value", "null"))
