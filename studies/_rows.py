"""Rows of the results: numbers with a key, put into words only where they are shown."""

from dataclasses import KW_ONLY, dataclass


@dataclass(frozen=True)
class Row:
    """One result."""

    # By which rows of both amounts of recordings are joined, such as
    # "control/target-1/damp0.03-mass0.05"
    key: str
    label: str  # what was measured, in words
    value: float
    unit: str = ""  # behind it, such as " %"
    _: KW_ONLY
    interval: tuple[float, float] | None = None  # 95 %
    at_least: float | None = None  # smallest value that this project aims at
    at_most: float | None = None  # largest value that it aims at
    # Whether it is of the paper's amount of recordings, and there is none of more
    of_paper: bool = False

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
    def figure(self) -> str:
        """The value with its interval."""
        text = f"{self.value:.2f}{self.unit}"
        if self.interval is None:
            return text
        low, high = self.interval
        digits = 0 if self.unit == " %" else 2
        return f"{text} ({low:.{digits}f} to {high:.{digits}f}{self.unit})"
