"""`make film`: a throw at a drawn target in the page "Throw a cloth", into `docs`.

A target is drawn there with the pointer, and the robot throws for some periods. It
takes Chromium and the files of `make npm`.
"""

import io
import tempfile
from pathlib import Path

from browser_lab import launch_options
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from course.lab_page import ONE_FILE, write_lab, write_one_file, write_robot

FILM = Path(__file__).resolve().parents[1] / "docs" / "throw.gif"
BRUSH = 5  # radius of the pointer on the target [pixel]
# A line over the target, in shares of its width and height: a cloth that is swung up
DRAWN = [
    (0.49, 0.8),
    (0.55, 0.75),
    (0.63, 0.71),
    (0.69, 0.75),
    (0.67, 0.83),
    (0.63, 0.86),
]
PERIODS = 4
STEPS = 8 * PERIODS
VIEW = {"width": 1240, "height": 660}  # [pixel]
WIDTH = 720  # of the film [pixel]
COLOURS = 64
MILLISECONDS = 200  # that a step takes, too
LAST = 2000  # [ms] for the last frame
STEP = """async (count) => {
    const { model } = document.getElementById("clothlab-lab");
    await model.send({ do: "step", id: "" });
    while (!model.get("frame").clock.endsWith(`step ${count}`))
        await new Promise(requestAnimationFrame);
}"""


def picture(page: Page) -> Image.Image:
    """The panel as it is now."""
    seen = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    return seen.resize((WIDTH, round(WIDTH * seen.height / seen.width)), Image.LANCZOS)


def draw(page: Page) -> list[Image.Image]:
    """Draw a target with the pointer; what is seen after each part of the line."""
    panel = page.locator(".clothlab")
    panel.get_by_role("slider", name="brush [pixel]").fill(str(BRUSH))
    panel.get_by_role("button", name="clear", exact=True).click()
    panel.get_by_role("button", name="projector", exact=True).click()
    box = panel.get_by_role("application", name="target").bounding_box()
    assert box is not None
    frames = [picture(page)]
    for k, (x, y) in enumerate(DRAWN):
        page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
        if k == 0:
            page.mouse.down()
        frames.append(picture(page))
    page.mouse.up()
    page.evaluate("document.activeElement.blur()")
    return frames


def film(page: Page) -> list[Image.Image]:
    """Draw a target, and throw at it."""
    frames = draw(page)
    panel = page.locator(".clothlab")
    panel.get_by_text("The autoencoder").first.wait_for()
    for count in range(1, STEPS + 1):
        page.evaluate(STEP, count)
        frames.append(picture(page))
    return frames


def main() -> None:
    """Open the page as one file, and write what is seen there."""
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        write_lab(folder / "scripts")
        write_robot(folder / "scripts")
        write_one_file(folder / ONE_FILE, folder / "scripts")
        browser = playwright.chromium.launch(**launch_options())
        page = browser.new_page(offline=True, viewport=VIEW)
        page.goto((folder / ONE_FILE).as_uri())
        page.wait_for_selector("[data-frame]", timeout=120_000)
        frames = film(page)
        browser.close()

    # Few colours, the same ones in all frames: what stands still takes no room
    palette = frames[-1].quantize(COLOURS, kmeans=2)
    pressed = [
        frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    times = [MILLISECONDS] * (len(frames) - 1) + [LAST]
    pressed[0].save(
        FILM, save_all=True, append_images=pressed[1:], duration=times, loop=0
    )
    print(f"{FILM}: {FILM.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
