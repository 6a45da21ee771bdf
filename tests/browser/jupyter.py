"""JupyterLab with notebooks of tests, and the kernels behind them."""

import json
import os
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
from playwright.sync_api import BrowserType, ConsoleMessage, Page

ROOT = Path(__file__).resolve().parents[2]
# JupyterLab asks for a translation and a licence page that are not there
HARMLESS = ("Failed to load resource",)
NOTICES = "@jupyterlab/apputils-extension/notification.jupyterlab-settings"
# What a notebook's toolbar has once the page knows that its kernel is idle
IDLE = ".jp-Notebook-ExecutionIndicator[data-status=idle]"
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


def lacks_chromium(chromium: BrowserType) -> bool:
    """Whether neither the system nor Playwright has a browser."""
    own = Path(chromium.executable_path).exists()
    return not own and "executable_path" not in launch_options()


class Lab:
    """A running JupyterLab on a folder."""

    def __init__(self, folder: Path):
        """Start it, with this folder for notebooks, settings and the log."""
        self.folder = folder

        # Or it asks whether to look for news, in front of the panel
        notices = folder / "settings" / NOTICES
        notices.parent.mkdir(parents=True)
        notices.write_text('{"fetchNews": "false", "checkForUpdates": false}')

        # At a port that nobody uses
        with socket.socket() as free:
            free.bind(("localhost", 0))
            self.port = free.getsockname()[1]
        options = [f"--LabApp.user_settings_dir={folder / 'settings'}"]
        options += [f"--port={self.port}", "--ServerApp.token=t", "--no-browser"]
        command = [sys.executable, "-m", "jupyter", "lab", *options, "--allow-root"]
        self.log = folder / "lab.log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                command,
                cwd=folder,
                stdout=log,
                stderr=log,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
            )

    def add(self, name: str, cells: Sequence[str]) -> None:
        """Put a notebook with these cells of code into the folder."""
        made = [nbformat.v4.new_code_cell(source) for source in cells]
        kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
        notebook = nbformat.v4.new_notebook(cells=made, metadata=kernel)
        nbformat.write(notebook, self.folder / name)

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

        # Before the page knows of an idle kernel, "run all" is ignored
        end = time.monotonic() + 60
        while (lab.kernel(name) or {}).get("execution_state") != "idle":
            if time.monotonic() > end:
                raise TimeoutError(f"no kernel starts:\n{lab.log.read_text()}")
            page.wait_for_timeout(200)
        page.wait_for_selector(IDLE, timeout=60_000)

    def _note_message(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self._note(message.text)

    def _note(self, text: str) -> None:
        if not text.startswith(HARMLESS):
            self.errors.append(text)

    def run_all(self) -> None:
        """Choose "Run All Cells", and open a second line to the kernel."""
        for place, words in ((".lm-MenuBar", "Run"), (".lm-Menu", "Run All Cells")):
            exactly = re.compile(f"^{words}$")
            self.page.locator(f"{place}-itemLabel", has_text=exactly).click()
        kernel = self.lab.kernel(self.name) or {}
        file = Path(jupyter_runtime_dir()) / f"kernel-{kernel['id']}.json"
        self.client = BlockingKernelClient(connection_file=str(file))
        self.client.load_connection_file()
        # The kernel would keep the frames that this client never reads
        self.client.start_channels(iopub=False)
        self.client.kernel_info(reply=True, timeout=120)

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

    def until(self, expression: str, seconds: float = 30) -> None:
        """Wait until an expression is true in the kernel.

        A TimeoutError if it stays false.
        """
        end = time.monotonic() + seconds
        while self.evaluate(f"bool({expression})") != "True":
            if time.monotonic() > end:
                raise TimeoutError(f"not within {seconds} s: {expression}")
            time.sleep(0.1)
