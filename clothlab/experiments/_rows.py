"""Rows of the results: numbers with a key, put into words only where they are written down."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Row:
    """One result.

    Attributes:
        key: by which rows of both amounts of recordings are joined, such as `"control/target-1/damp0.03-mass0.05"`.
        label: what was measured, in words.
        value: the figure.
        unit: behind it, such as `" %"`.
        spread: standard deviation over trainings.
        interval: 95 % interval.
        paper: the paper's figure, or what it says.
        at_least: smallest value that this project aims at.
        at_most: largest value that it aims at.
        note: in brackets behind the figure.
    """

    key: str
    label: str
    value: float
    unit: str = ""
    spread: float | None = None
    interval: tuple[float, float] | None = None
    paper: str = "–"
    at_least: float | None = None
    at_most: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the value is within the aim; None where there is none."""
        if self.at_least is None and self.at_most is None:
            return None
        return (self.at_least is None or self.value >= self.at_least) and (
            self.at_most is None or self.value <= self.at_most
        )

    @property
    def aim(self) -> str:
        """The bounds in words."""
        if self.at_least is not None and self.at_most is not None:
            return f"{self.at_least:.3g} to {self.at_most:.3g}{self.unit}"
        if self.at_least is not None:
            return f"≥ {self.at_least:.2g}{self.unit}"
        return "–" if self.at_most is None else f"≤ {self.at_most:.2g}{self.unit}"

    @property
    def here(self) -> str:
        """The figure in words."""
        text = f"{self.value:.2f}{self.unit}"
        if self.spread is not None:
            text += f" ± {self.spread:.2f}"
        if self.interval is not None:
            text += f" ({self.interval[0]:.2f} to {self.interval[1]:.2f}{self.unit})"
        return f"{text} ({self.note})" if self.note else text
