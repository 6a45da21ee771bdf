"""JupyterLab with the real notebooks, and Chromium to look at it."""

import json
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path

import nbformat.v4
from jupyter_client import BlockingKernelClient
from jupyter_core.paths import jupyter_runtime_dir
from playwright.sync_api import BrowserType, ConsoleMessage, Locator, Page
from solutions import small

ROOT = Path(__file__).resolve().parents[1]
# JupyterLab asks for a translation and a licence page that are not there
HARMLESS = ("Failed to load resource",)
NOTICES = "@jupyterlab/apputils-extension/notification.jupyterlab-settings"
# What a notebook's toolbar has from then on
HEARD = ".jp-Notebook-ExecutionIndicator[data-status=idle]"
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")


def launch_options() -> dict:
    """The system's Chromium for `playwright.chromium.launch`.

    Without one, Playwright takes its own.
    """
    options: dict = {"args": ["--no-sandbox"]}
    for name in CHROMIUM:
        if path := shutil.which(name):
            return options | {"executable_path": path}
    return options


def lacks_chromium(chromium: BrowserType) -> str:
    """Why no browser can be started; empty if one can.

    It is where neither the system nor Playwright has one.
    """
    if "executable_path" in launch_options():
        return ""
    if Path(chromium.executable_path).exists():
        return ""
    return (
        "NO CHROMIUM: apt-get install chromium, "
        "or .venv/bin/playwright install chromium"
    )


# How a server says that a page has closed: on a web socket, or on the stream below it.
_CLOSED = re.compile(r"WebSocketClosedError$|\.StreamClosedError: Stream is closed$")


def faults_in(log: str) -> list[str]:
    """How the tracebacks in a server's log end, if not with a closed page.

    A page may close while the server writes to it. That is reported, by more than one
    part of the server, although it is no fault.
    """
    # A traceback may be indented: what belongs to it is indented further
    traceback = re.compile(
        r"^( *)Traceback \(most recent call last\):\n(?:\1 +.*\n)*\1(.*)", re.MULTILINE
    )
    endings = [ending for _, ending in traceback.findall(log)]
    return [ending for ending in endings if not _CLOSED.search(ending)]


def frame(page: Page) -> int:
    """Number of the live lab's frame that the browser shows."""
    return page.eval_on_selector("[data-frame]", "element => +element.dataset.frame")


def slider(page: Page, name: str) -> Locator:
    """The live lab's first slider whose name contains this, to press keys on."""
    return page.get_by_role("slider", name=name).first


class Lab:
    """A running JupyterLab on copies of the notebooks.

    It would otherwise save over them.
    """

    def __init__(self, folder: Path):
        """Start it, with a folder for the copies, the settings and the log."""
        self.notebooks = folder / "notebooks"
        self.notebooks.mkdir()
        for path in (ROOT / "notebooks").glob("*.ipynb"):
            notebook = small(nbformat.read(path, as_version=4))
            nbformat.write(notebook, self.notebooks / path.name)

        # Or it asks whether to look for news, in front of the panel
        settings = folder / "settings"
        notices = settings / NOTICES
        notices.parent.mkdir(parents=True)
        notices.write_text('{"fetchNews": "false", "checkForUpdates": false}')

        # At a port that nobody uses
        with socket.socket() as free:
            free.bind(("localhost", 0))
            self.port = free.getsockname()[1]
        options = [f"--LabApp.user_settings_dir={settings}", f"--port={self.port}"]
        options += ["--ServerApp.token=t", "--ServerApp.password="]
        options += ["--no-browser", "--allow-root"]
        command = [sys.executable, "-m", "jupyter", "lab", *options]
        self.log = folder / "lab.log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                command, cwd=self.notebooks, stdout=log, stderr=log
            )

    def add(self, name: str, cells: Sequence[str], texts: int = 0) -> None:
        """Put a notebook beside the copies: cells of code, then some of empty text."""
        made = [nbformat.v4.new_code_cell(source) for source in cells]
        made += [nbformat.v4.new_markdown_cell("") for _ in range(texts)]
        kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
        notebook = nbformat.v4.new_notebook(cells=made, metadata=kernel)
        nbformat.write(notebook, self.notebooks / name)

    def ask(self, path: str, method: str = "GET"):
        """What the server's REST interface answers; None where that is nothing."""
        url = f"http://localhost:{self.port}/{path}?token=t"
        request = urllib.request.Request(url, method=method)
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.loads(answer.read() or "null")

    def wait(self) -> None:
        """Wait until it answers; a TimeoutError has its log if it does not."""
        for _ in range(360):
            try:
                self.ask("api/status")
                return
            except OSError:
                time.sleep(0.5)
        raise TimeoutError(self.log.read_text())

    def kernel(self, name: str) -> dict | None:
        """The kernel of a notebook, once it has one."""
        for session in self.ask("api/sessions"):
            if session["path"] == name:
                return session["kernel"]
        return None

    def stop_kernel(self, name: str) -> None:
        """Stop the kernel of a notebook.

        The next page with that notebook would otherwise go on with it.
        """
        self.ask(f"api/kernels/{self.kernel(name)['id']}", "DELETE")

    def close(self) -> None:
        """Stop server and kernels."""
        self.process.terminate()
        self.process.wait(timeout=20)


class Notebook:
    """One notebook in the browser, and its kernel.

    `errors` is what appeared as an error in the browser's console.
    """

    def __init__(self, lab: Lab, page: Page, name: str):
        """Open it; nothing is run."""
        self.lab = lab
        self.page = page
        self.name = name
        self.errors: list[str] = []
        page.on("console", self._note_message)
        page.on("pageerror", lambda error: self._note(str(error)))
        page.goto(f"http://localhost:{lab.port}/lab/tree/{name}?token=t&reset")
        page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=60_000)
        self._wait_for_kernel()

    def _wait_for_kernel(self) -> None:
        """Wait until the kernel is idle, and the page has heard of it.

        Before that, "run all" is ignored.
        """
        end = time.monotonic() + 60
        while not self._is_idle():
            if time.monotonic() > end:
                log = self.lab.log.read_text()
                raise TimeoutError(f"the kernel does not start:\n{log}")
            self.page.wait_for_timeout(200)
        self.page.wait_for_selector(HEARD, timeout=60_000)

    def _is_idle(self) -> bool:
        kernel = self.lab.kernel(self.name)
        return kernel is not None and kernel.get("execution_state") == "idle"

    def _note_message(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self._note(message.text)

    def _note(self, text: str) -> None:
        if not text.startswith(HARMLESS):
            self.errors.append(text)

    def run_all(self) -> None:
        """Choose "Run All Cells"."""
        for place, words in ((".lm-MenuBar", "Run"), (".lm-Menu", "Run All Cells")):
            exactly = re.compile(f"^{words}$")
            self.page.locator(f"{place}-itemLabel", has_text=exactly).click()

    def start_panel(self) -> float:
        """Run all of the live lab.

        Returned is the time from the click to the robot's first picture after a step
        [s].
        """
        start = time.monotonic()
        self.run_all()
        self.page.wait_for_function(
            "document.querySelector('[data-frame]')?.textContent.match(/step [1-9]/)",
            timeout=90_000,
        )
        seconds = time.monotonic() - start
        self.page.eval_on_selector(
            "[data-frame]", "element => element.closest('.jp-Cell').scrollIntoView()"
        )
        self.connect()
        self.until("panel.steps > 3", 60)
        return seconds

    def connect(self) -> None:
        """Open a second line to the notebook's kernel."""
        name = f"kernel-{self.lab.kernel(self.name)['id']}.json"
        file = Path(jupyter_runtime_dir()) / name
        self.client = BlockingKernelClient(connection_file=str(file))
        self.client.load_connection_file()
        # The kernel would keep the frames that this client never reads
        self.client.start_channels(iopub=False)
        self.client.kernel_info(reply=True, timeout=60)

    def evaluate(self, expression: str, code: str = "") -> str:
        """What an expression is in the kernel, after some code.

        A RuntimeError if either fails there.
        """
        asked = {"x": expression}
        reply = self.client.execute(
            code, user_expressions=asked, reply=True, timeout=60
        )["content"]
        answer = reply.get("user_expressions", {}).get("x", reply)
        if reply["status"] != "ok" or answer["status"] != "ok":
            raise RuntimeError(str(answer.get("evalue", reply.get("evalue"))))
        return answer["data"]["text/plain"]

    def until(self, expression: str, seconds: float = 15) -> None:
        """Wait until an expression is true in the kernel.

        A TimeoutError if it stays false.
        """
        end = time.monotonic() + seconds
        while self.evaluate(f"bool({expression})") != "True":
            if time.monotonic() > end:
                raise TimeoutError(f"not within {seconds} s: {expression}")
            time.sleep(0.1)
