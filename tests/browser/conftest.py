"""JupyterLab with the real notebooks, and Chromium to look at it."""

import json
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from jupyter_client import BlockingKernelClient
from jupyter_core.paths import jupyter_runtime_dir

ROOT = Path(__file__).parents[2]
SCREENSHOTS = ROOT / "build" / "screenshots"
HARMLESS = ("Failed to load resource",)  # JupyterLab asks for a translation and a licence page that are not there


@pytest.fixture(scope="session")
def browser_type_launch_args(browser_type_launch_args):
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.fail("no Chromium found: apt-get install chromium")
    return browser_type_launch_args | {"executable_path": chromium, "args": ["--no-sandbox"]}


@pytest.fixture(scope="session")
def browser_context_args(browser_context_args):
    return browser_context_args | {"viewport": {"width": 1500, "height": 1900}}


class Lab:
    """A running JupyterLab on copies of the notebooks, which it would otherwise save over."""

    def __init__(self, folder: Path):
        shutil.copytree(ROOT / "notebooks", folder / "notebooks")
        with socket.socket() as free:
            free.bind(("localhost", 0))
            self.port = free.getsockname()[1]
        self.log = folder / "lab.log"
        news = folder / "settings" / "@jupyterlab" / "apputils-extension" / "notification.jupyterlab-settings"
        news.parent.mkdir(parents=True)
        news.write_text('{"fetchNews": "false", "checkForUpdates": false}')  # or it asks, in front of the panel
        options = [
            f"--LabApp.user_settings_dir={folder / 'settings'}",
            "--no-browser",
            "--allow-root",
            f"--port={self.port}",
            "--ServerApp.token=t",
            "--ServerApp.password=",
        ]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "jupyter", "lab", *options], cwd=folder / "notebooks", stdout=log, stderr=log
            )

    def get(self, path: str):
        with urllib.request.urlopen(f"http://localhost:{self.port}/{path}?token=t", timeout=5) as answer:
            return json.load(answer)

    def wait(self) -> None:
        for _ in range(120):
            try:
                self.get("api/status")
                return
            except OSError:
                time.sleep(0.5)
        raise TimeoutError(self.log.read_text())

    def kernel(self, name: str) -> dict | None:
        """The kernel of a notebook, once it has one."""
        sessions = {session["path"]: session["kernel"] for session in self.get("api/sessions")}
        return sessions.get(name)


@pytest.fixture(scope="session")
def lab(tmp_path_factory):
    lab = Lab(tmp_path_factory.mktemp("lab"))
    lab.wait()
    yield lab
    lab.process.terminate()
    lab.process.wait(timeout=20)


class Notebook:
    """One notebook in the browser, and its kernel."""

    def __init__(self, lab: Lab, page, name: str):
        self.lab, self.page, self.name, self.errors = lab, page, name, []
        page.on("console", lambda message: self._note(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self._note(str(error)))
        page.goto(f"http://localhost:{lab.port}/lab/tree/{name}?token=t&reset")
        page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=60_000)
        end = time.monotonic() + 60
        while (lab.kernel(name) or {}).get("execution_state") != "idle":  # before that, "run all" is ignored
            assert time.monotonic() < end, "the kernel does not start"
            page.wait_for_timeout(200)
        page.wait_for_timeout(2000)  # and the page has to hear of it, too

    def _note(self, text: str) -> None:
        if not text.startswith(HARMLESS):
            self.errors.append(text)

    def run_all(self) -> None:
        self.page.locator(".lm-MenuBar-itemLabel", has_text=re.compile("^Run$")).click()
        self.page.locator(".lm-Menu-itemLabel", has_text=re.compile("^Run All Cells$")).click()

    def connect(self) -> None:
        file = Path(jupyter_runtime_dir()) / f"kernel-{self.lab.kernel(self.name)['id']}.json"
        self.client = BlockingKernelClient(connection_file=str(file))
        self.client.load_connection_file()
        self.client.start_channels()
        self.client.wait_for_ready(timeout=30)

    def evaluate(self, expression: str, code: str = "") -> str:
        """What an expression is in the kernel; an error there is raised here."""
        reply = self.client.execute_interactive(
            code, user_expressions={"x": expression}, timeout=30, output_hook=lambda message: None
        )
        answer = reply["content"].get("user_expressions", {}).get("x", reply["content"])
        if reply["content"]["status"] != "ok" or answer["status"] != "ok":
            raise RuntimeError(str(answer.get("evalue", reply["content"].get("evalue"))))
        return answer["data"]["text/plain"]

    def until(self, expression: str, seconds: float = 15) -> None:
        """Wait until an expression is true in the kernel."""
        end = time.monotonic() + seconds
        while self.evaluate(f"bool({expression})") != "True":
            assert time.monotonic() < end, f"not within {seconds} s: {expression}"
            time.sleep(0.1)

    def screenshot(self, name: str) -> None:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=SCREENSHOTS / f"{name}.png")


@pytest.fixture
def open_notebook(lab, page):
    return lambda name: Notebook(lab, page, name)
