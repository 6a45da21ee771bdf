"""The page "Throw a cloth" by itself, and what a visitor does at its panel."""

import re

from playwright.sync_api import expect

from course.lab_page import SOURCES, policy, write_lab, write_robot

LOADING = 120_000  # [ms] that a robot may take, also on a machine that has much to do
# In a worker, random numbers that are the same each time (mulberry32)
WITHOUT_CHANCE = """() => {
    let state = 7;
    Math.random = () => {
        state = (state + 0x6d2b79f5) >>> 0;
        let mixed = Math.imul(state ^ (state >>> 15), state | 1);
        mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
        return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
    };
}"""
# Of a page that was opened, how a trait of its model stands
TRAIT = "name => document.getElementById('clothlab-lab').model.get(name)"
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Throw a cloth</title>
<meta name="viewport" content="width=device-width">
<meta http-equiv="Content-Security-Policy" content="{policy}"><main><h1>Throw a cloth</h1>
{body}</main></html>"""


def write_page(folder):
    """Write the page, with what `throw.md` has of it, and all that belongs to it."""
    write_lab(folder / "_static" / "lab")
    write_robot(folder / "_static" / "lab")
    text = (SOURCES.parent / "throw.md").read_text("utf-8")
    (body,) = re.findall(r"```\{raw\} html\n(.*?)```", text, re.DOTALL)
    page = PAGE.format(policy=policy(), body=body)
    (folder / "throw.html").write_text(page, "utf-8")


class Lab:
    """What a visitor does at the panel, and sees of it."""

    def __init__(self, page):
        self.page = page
        self.panel = page.locator(".clothlab")
        self.status = self.panel.locator(".status")
        self.message = self.panel.get_by_role("alert")
        self.note = page.locator("#clothlab-lab > p").get_by_role("status")

    def press(self, name):
        self.panel.get_by_role("button", name=name, exact=True).click()

    def choose(self, menu, option):
        self.panel.get_by_label(menu, exact=True).select_option(option)

    def move(self, name, value, event="change"):
        """Move a slider, also beyond its end."""
        self.panel.get_by_role("slider", name=name).evaluate(
            """(slider, [value, event]) => {
                slider.min = Math.min(slider.min, value);
                slider.value = value;
                slider.dispatchEvent(new Event(event));
            }""",
            [value, event],
        )

    def tell(self, what, **more):
        """Send what the panel would send."""
        self.page.evaluate(
            "(message) => document.getElementById('clothlab-lab').model.send(message)",
            {"do": what, "id": "", **more},
        )

    def get(self, trait):
        return self.page.evaluate(TRAIT, trait)

    @property
    def distances(self):
        """That to the target at each step, and of the cloth that hangs still."""
        plot = self.get("frame")["traces"][0]
        return plot["lines"][0]["values"], plot["limit"][1]

    def run_until(self, step):
        self.press("start")
        self.wait(f"+get('frame').clock.match(/step (\\d+)/)[1] >= {step}")
        self.press("pause")
        expect(self.status).to_have_text("❚❚ paused")

    def wait(self, condition):
        self.page.wait_for_function(
            f"() => {{ const get = {TRAIT}; return {condition}; }}", timeout=120_000
        )

    def inside(self, expression, argument=None):
        """Ask in the worker, where `session` is."""
        return self.page.workers[0].evaluate(expression, argument)
