"""The decks of `make slides` at a projector's 1280×720, in a browser without a network."""

import pytest
from browser_lab import ROOT

pytestmark = pytest.mark.book

DECKS = sorted((ROOT / "build" / "slides").glob("*.slides.html"))
SMALLEST = 0.02 * 720  # [pixel] letters that can be read from the last row
OVER = """() => [...document.querySelectorAll(".slides section")].filter((each) => !each.querySelector("section"))
    .map((each) => {
        const all = each.firstElementChild, box = all.getBoundingClientRect(), letters = all.querySelector("p, li");
        const size = letters ? parseFloat(getComputedStyle(letters).fontSize) * all.style.zoom : 28;
        return [each.innerText.slice(0, 60), all.scrollWidth - all.clientWidth, box.height, size];
    })"""


@pytest.mark.parametrize(
    "deck", DECKS or [None], ids=lambda deck: deck.stem if deck else "not built"
)
def test_no_slide_is_larger_than_the_projector_and_all_can_be_read(deck, visit, page):
    if deck is None:
        pytest.skip(
            "NO DECK IN build/slides: run `make slides` (or `make slides SMALL=1`, which is sooner)"
        )
    page.set_viewport_size({"width": 1280, "height": 720})
    visit(deck)
    page.wait_for_function("document.body.dataset.ready > 5", timeout=60_000)
    page.add_style_tag(
        content=".slides section { display: block !important; visibility: visible !important }"
    )
    slides = page.evaluate(OVER)
    assert len(slides) > 10
    for words, wider, height, letters in slides:
        assert wider <= 1, words
        assert height <= 720 - 2 * 24 + 1, words
        assert letters >= SMALLEST, words
    assert page.evaluate("document.querySelectorAll('mjx-merror').length") == 0
    assert (
        page.evaluate(
            "[...document.images].filter((each) => !each.naturalWidth).length"
        )
        == 0
    )
