"""Time step and start of a scene."""

from dataclasses import dataclass

from clothlab._validation import check_number
from clothlab.simulation.trial import CONTROL_PERIOD


@dataclass(frozen=True)
class Scene:
    """Time step and start of a scene, and how large its pictures for people are."""

    # Notebook 01 measures what halving it changes
    time_step: float = 0.002  # [s]
    # The cloth hangs still before a trial starts
    settle_time: float = 2.0  # [s]
    # Height and width, for people
    picture_size: tuple[int, int] = (480, 640)  # [pixel]

    def __post_init__(self) -> None:
        check_number("Scene.time_step", self.time_step, above=0)
        if abs(self.substeps * self.time_step - CONTROL_PERIOD) > 1e-9:
            raise ValueError(
                "Scene.time_step must divide the control period of "
                f"{CONTROL_PERIOD} s: 0.002, for one"
            )

    @property
    def substeps(self) -> int:
        """Time steps in a control period."""
        return round(CONTROL_PERIOD / self.time_step)
