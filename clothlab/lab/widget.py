"""What the widgets of this package share: faults that a notebook raises in the end, and a picture of themselves."""

import base64
from typing import Any

from clothlab.alt_text import AltText


class Widget:
    """Inherited before the library's widget class."""

    errors: list[str]  # tracebacks of callbacks

    def check(self) -> None:
        """Raise if a callback has failed, so that a notebook that ran through unseen errors does not pass."""
        if self.errors:
            raise RuntimeError(f"{len(self.errors)} callbacks failed; the first:\n{self.errors[0]}")

    def still(self) -> tuple[bytes, AltText]:
        """How it looks now, PNG, and that in words, for pages on which no kernel answers."""
        raise NotImplementedError

    def _repr_mimebundle_(self, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """The library's answer with the picture beside it; JupyterLab shows the widget."""
        bundle = super()._repr_mimebundle_(**options)  # type: ignore[misc]
        data, metadata = bundle if isinstance(bundle, tuple) else (bundle, {})
        picture, words = self.still()
        about = {"alt": words.summary, "details": list(words.details)}
        return {**data, "image/png": base64.b64encode(picture).decode()}, {**metadata, "image/png": about}
