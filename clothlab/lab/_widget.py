"""What the widgets share: their JavaScript, faults, and a picture."""

import base64
from pathlib import Path
from typing import Any

from IPython.display import display

# A saved notebook that is opened again has outputs and no kernel. JupyterLab then says
# "model not found" where a widget was, and asks no other representation of it. So these
# words are an output of their own, which a living widget hides; the delay keeps them
# from showing for the moment before it does.
REOPENED = (
    "<style>\n"
    "@keyframes clothlab-late { from { opacity: 0 } to { opacity: 1 } }\n"
    ".clothlab-reopened { animation: clothlab-late 0s 1s both; "
    "color: #b00020; font-weight: 600 }\n"
    ".jp-OutputArea:has(.clothlab, .clothlab-widget) .clothlab-reopened "
    "{ display: none }\n"
    "</style>\n"
    '<div class="clothlab-reopened">'
    "The controls above need a kernel: run the cells again.</div>"
)


def javascript(*parts: str) -> str:
    """Files of `static/` as one module: such a module can't import its neighbours."""
    folder = Path(__file__).parent / "static"
    return "\n".join((folder / f"{part}.js").read_text("utf-8") for part in parts)


class Widget:
    """Inherited before the library's widget class."""

    errors: list[str]  # tracebacks of callbacks

    def check(self) -> None:
        """Raise if a callback has failed.

        A notebook that ran through unseen errors would pass otherwise.
        """
        if self.errors:
            raise RuntimeError(
                f"{len(self.errors)} callbacks failed; the first:\n{self.errors[0]}"
            )

    def still(self) -> tuple[bytes, str]:
        """How it looks now, PNG, and that in a sentence.

        For pages on which no kernel answers.
        """
        raise NotImplementedError

    def _ipython_display_(self) -> None:
        """Show the widget, and below it what to do where its kernel has gone."""
        data, metadata = self._repr_mimebundle_()
        display(data, metadata=metadata, raw=True)
        display({"text/html": REOPENED, "text/plain": ""}, raw=True)

    def _repr_mimebundle_(
        self, **options: Any
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """The library's answer, and the picture where no widget can be shown."""
        bundle = super()._repr_mimebundle_(**options)  # type: ignore[misc]
        data, metadata = bundle if isinstance(bundle, tuple) else (bundle, {})
        picture, words = self.still()
        png = base64.b64encode(picture).decode()
        return data | {"image/png": png}, metadata | {"image/png": {"alt": words}}
