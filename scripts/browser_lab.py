"""JupyterLab with the real notebooks, and Chromium to look at it: for the browser tests
and for `make bench`.
"""

import json
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import nbformat
from jupyter_client import BlockingKernelClient
from jupyter_core.paths import jupyter_runtime_dir
from playwright.sync_api import BrowserType, Locator, Page

from course.solutions import small

ROOT = Path(__file__).resolve().parents[1]
# JupyterLab asks for a translation and a licence page that are not there
HARMLESS = ("Failed to load resource",)


def launch_options() -> dict:
    """The system's Chromium for `playwright.chromium.launch`; without one, Playwright
    takes its own.
    """
    path = next(
        filter(
            None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
        ),
        None,
    )
    return {"args": ["--no-sandbox"]} | ({"executable_path": path} if path else {})


def lacks_chromium(chromium: BrowserType) -> str:
    """Why no browser can be started, where neither the system nor Playwright has one;
    empty if one can.
    """
    found = (
        "executable_path" in launch_options() or Path(chromium.executable_path).exists()
    )
    return (
        ""
        if found
        else "NO CHROMIUM: apt-get install chromium, or .venv/bin/playwright install chromium"
    )


def frame(page: Page) -> int:
    """Number of the live lab's frame that the browser shows."""
    return page.eval_on_selector("[data-frame]", "element => +element.dataset.frame")


def slider(page: Page, name: str) -> Locator:
    """The live lab's first slider whose name contains this, to press keys on."""
    return page.get_by_role("slider", name=name).first


class Lab:
    """A running JupyterLab on copies of the notebooks, which it would otherwise save
    over.
    """

    def __init__(self, folder: Path):
        """Start it, with a folder for the copies, the settings and the log."""
        (folder / "notebooks").mkdir()
        for path in (ROOT / "notebooks").glob("*.ipynb"):
            notebook = small(nbformat.read(path, as_version=4))
            nbformat.write(notebook, folder / "notebooks" / path.name)
        with socket.socket() as free:
            free.bind(("localhost", 0))
            self.port = free.getsockname()[1]
        self.log = folder / "lab.log"
        news = (
            folder
            / "settings"
            / "@jupyterlab"
            / "apputils-extension"
            / "notification.jupyterlab-settings"
        )
        news.parent.mkdir(parents=True)
        # Or it asks, in front of the panel
        news.write_text('{"fetchNews": "false", "checkForUpdates": false}')
        options = [
            f"--LabApp.user_settings_dir={folder / 'settings'}",
            f"--port={self.port}",
            "--ServerApp.token=t",
        ]
        options += ["--ServerApp.password=", "--no-browser", "--allow-root"]
        command = [sys.executable, "-m", "jupyter", "lab", *options]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                command, cwd=folder / "notebooks", stdout=log, stderr=log
            )

    def ask(self, path: str, method: str = "GET"):
        """What the server's REST interface answers; None where it has nothing to say."""
        url = f"http://localhost:{self.port}/{path}?token=t"
        with urllib.request.urlopen(
            urllib.request.Request(url, method=method), timeout=10
        ) as answer:
            return json.loads(answer.read() or "null")

    def wait(self) -> None:
        """Wait until it answers; a TimeoutError with the server's log if it does not."""
        for _ in range(120):
            try:
                self.ask("api/status")
                return
            except OSError:
                time.sleep(0.5)
        raise TimeoutError(self.log.read_text())

    def kernel(self, name: str) -> dict | None:
        """The kernel of a notebook, once it has one."""
        return {
            session["path"]: session["kernel"] for session in self.ask("api/sessions")
        }.get(name)

    def stop_kernel(self, name: str) -> None:
        """Stop the kernel of a notebook, which the next page with that notebook would
        otherwise go on with.
        """
        self.ask(f"api/kernels/{self.kernel(name)['id']}", "DELETE")

    def close(self) -> None:
        """Stop server and kernels."""
        self.process.terminate()
        self.process.wait(timeout=20)


class Notebook:
    """One notebook in the browser, and its kernel; `errors` is what appeared as an
    error in the browser's console.
    """

    def __init__(self, lab: Lab, page: Page, name: str):
        """Open it; nothing is run."""
        self.lab, self.page, self.name, self.errors = lab, page, name, []
        page.on(
            "console",
            lambda message: (
                self._note(message.text) if message.type == "error" else None
            ),
        )
        page.on("pageerror", lambda error: self._note(str(error)))
        page.goto(f"http://localhost:{lab.port}/lab/tree/{name}?token=t&reset")
        page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=60_000)
        end = time.monotonic() + 60
        while (lab.kernel(name) or {}).get(
            "execution_state"
        ) != "idle":  # before that, "run all" is ignored
            if time.monotonic() > end:
                raise TimeoutError("the kernel does not start:\n" + lab.log.read_text())
            page.wait_for_timeout(200)
        page.wait_for_timeout(2000)  # and the page has to hear of it, too

    def _note(self, text: str) -> None:
        if not text.startswith(HARMLESS):
            self.errors.append(text)

    def run_all(self) -> None:
        """Choose "Run All Cells"."""
        self.page.locator(".lm-MenuBar-itemLabel", has_text=re.compile("^Run$")).click()
        self.page.locator(
            ".lm-Menu-itemLabel", has_text=re.compile("^Run All Cells$")
        ).click()

    def start_panel(self) -> float:
        """Run all of the live lab: the time from the click to the robot's first picture
        after a step [s].
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
        file = (
            Path(jupyter_runtime_dir())
            / f"kernel-{self.lab.kernel(self.name)['id']}.json"
        )
        self.client = BlockingKernelClient(connection_file=str(file))
        self.client.load_connection_file()
        # The kernel would keep the frames that this client never reads
        self.client.start_channels(iopub=False)
        self.client.kernel_info(reply=True, timeout=60)

    def evaluate(self, expression: str, code: str = "") -> str:
        """What an expression is in the kernel, after some code; a RuntimeError if it
        fails there.
        """
        reply = self.client.execute(
            code, user_expressions={"x": expression}, reply=True, timeout=60
        )
        answer = reply["content"].get("user_expressions", {}).get("x", reply["content"])
        if reply["content"]["status"] != "ok" or answer["status"] != "ok":
            raise RuntimeError(
                str(answer.get("evalue", reply["content"].get("evalue")))
            )
        return answer["data"]["text/plain"]

    def until(self, expression: str, seconds: float = 15) -> None:
        """Wait until an expression is true in the kernel; a TimeoutError if it stays
        false.
        """
        end = time.monotonic() + seconds
        while self.evaluate(f"bool({expression})") != "True":
            if time.monotonic() > end:
                raise TimeoutError(f"not within {seconds} s: {expression}")
            time.sleep(0.1)
