"""A widget's picture travels beside the widget, and takes nothing of it away."""

import base64

import pytest

from clothlab.alt_text import AltText
from clothlab.lab import widget


class Widget:
    """What a widget library answers."""

    answer: object = {"text/plain": "Widget()"}

    def _repr_mimebundle_(self, **options):
        return self.answer


class Shown(widget.Widget, Widget):
    def still(self):
        return b"picture", AltText("a dot", ("one dot at 0",))


@pytest.mark.parametrize("answer", [{"text/plain": "W"}, ({"text/plain": "W"}, {"other": {"a": 1}})])
def test_the_picture_is_added_with_its_words(answer, monkeypatch):
    monkeypatch.setattr(Widget, "answer", answer)
    data, metadata = Shown()._repr_mimebundle_(include=None, exclude=None)
    assert data == {"text/plain": "W", "image/png": base64.b64encode(b"picture").decode()}
    assert metadata["image/png"] == {"alt": "a dot", "details": ["one dot at 0"]}
    assert metadata.get("other") == (answer[1]["other"] if isinstance(answer, tuple) else None)


def test_a_widget_says_how_it_looks():
    class Silent(widget.Widget, Widget):
        pass

    with pytest.raises(NotImplementedError):
        Silent()._repr_mimebundle_()
