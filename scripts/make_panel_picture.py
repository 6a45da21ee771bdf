"""`docs/panel.png`: the live lab's panel, with a number at each part.

Notebook 08 says what the numbers are. The panel stands in a page of its own with the
recorded run of the site, so that no kernel is needed, and the numbers are put where the
page has its parts.
"""

import io
import re
import tempfile
from pathlib import Path

import cv2
import numpy as np
from browser_lab import ROOT, launch_options
from PIL import Image
from playwright.sync_api import Locator, Page, sync_playwright

from course.lab_page import write_lab

TARGET = ROOT / "docs" / "panel.png"
WINDOW = {"width": 1300, "height": 1100}  # [pixel]
MOMENT = 60  # [s] of the run, when a controller drives
PATIENCE = 300_000  # [ms], for a busy machine
PAGE = """<!DOCTYPE html><meta charset="utf-8">
<body style="font-family: sans-serif; background: white; margin: 40px">
<div id="clothlab-lab"></div><script src="lab.js"></script>
"""
# As in a notebook: all controls are on, and there is no time to choose
LIKE_A_NOTEBOOK = """
seconds => {
  const place = document.getElementById("clothlab-lab");
  place.model.send({ do: "seek", seconds });
  for (const each of place.querySelectorAll(":disabled")) each.disabled = false;
  place.querySelector("[aria-label^=time]").closest("label").remove();
  place.querySelector("p").remove(); // the way to the live robot
  const notes = [...place.querySelectorAll(".note")];
  notes.find((each) => each.textContent.startsWith("a recording")).remove();
}
"""
IN_FIRST_ROW = 2  # parts
RED = (213, 94, 0)
RADIUS = 15  # [pixel]
FONT = cv2.FONT_HERSHEY_SIMPLEX


def parts(page: Page) -> list[Locator]:
    """What has a number, in the order of the numbers."""
    panel = page.locator(".clothlab")

    def heading(name: str) -> Locator:
        return panel.get_by_role("heading", name=name)

    return [
        panel.get_by_role("combobox", name="driven by"),
        panel.get_by_role("button", name="explore new plans"),
        panel.get_by_role("img", name="the robot"),
        panel.locator(".traces.distance"),
        heading("Target"),
        heading("Material"),
        panel.locator("canvas[aria-label^='map of the parametric bias']"),
        panel.get_by_role("button", name=re.compile("^estimate p online")),
        heading("Your own hand"),
        heading("Recording"),
    ]


def picture_of(page: Page, folder: Path) -> np.ndarray:
    """The panel with the numbers, `[h, w, 3]`, from a page in a folder."""
    page.goto((folder / "index.html").as_uri() + "#recorded-run")
    panel = page.locator(".clothlab")
    panel.locator("[data-frame]").wait_for()
    page.evaluate(LIKE_A_NOTEBOOK, MOMENT)
    page.wait_for_timeout(2000)  # until all is drawn

    # A number stands above its part in the full first row, and else on its left
    file = io.BytesIO(page.screenshot(full_page=True))
    picture = np.array(Image.open(file).convert("RGB"))
    for number, part in enumerate(parts(page), 1):
        box = part.bounding_box()
        assert box, f"part {number} of the panel isn't shown"
        if number <= IN_FIRST_ROW:
            x = round(box["x"]) + RADIUS
            y = round(box["y"]) - RADIUS
        else:
            x = round(box["x"]) - RADIUS
            y = round(box["y"] + min(box["height"] / 2, RADIUS))
        _draw_number(picture, number, x, y)
    return picture


def _draw_number(picture: np.ndarray, number: int, x: int, y: int) -> None:
    """Draw a number on a disc into the picture, in place."""
    cv2.circle(picture, (x, y), RADIUS, RED, -1, cv2.LINE_AA)
    (width, height), _ = cv2.getTextSize(str(number), FONT, 0.6, 2)
    at = (x - width // 2, y + height // 2)
    cv2.putText(picture, str(number), at, FONT, 0.6, (255, 255, 255), 2, cv2.LINE_AA)


def main() -> None:
    """Write the picture."""
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        folder = Path(name)
        write_lab(folder)
        (folder / "index.html").write_text(PAGE, "utf-8")
        browser = play.chromium.launch(**launch_options(), timeout=PATIENCE)
        page = browser.new_page(viewport=WINDOW)
        page.set_default_timeout(PATIENCE)
        picture = picture_of(page, folder)
        browser.close()

    # Few colours: it lies in the repository
    Image.fromarray(picture).quantize(64, kmeans=3).save(TARGET, optimize=True)
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
