"""Time step and start of a scene."""

from dataclasses import dataclass

from clothlab._validation import Checked, setting
from clothlab.simulation.trial import CONTROL_PERIOD


@dataclass(frozen=True)
class Scene(Checked):
    """Time step and start of a scene, and how large its pictures for people are."""

    # Notebook 01 measures what halving it changes
    time_step: float = setting(0.002, "s", at_least=1e-5)
    # The cloth hangs still before a trial starts
    settle_time: float = setting(2.0, "s", at_least=0, at_most=60)
    # Height and width, for people
    picture_size: tuple[int, int] = setting((480, 640), "pixel", above=0, at_most=4096)

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.substeps * self.time_step - CONTROL_PERIOD) > 1e-9:
            raise ValueError(
                "Scene.time_step must divide the control period of "
                f"{CONTROL_PERIOD} s: 0.002, for one"
            )

    @property
    def substeps(self) -> int:
        """Time steps in a control period."""
        return round(CONTROL_PERIOD / self.time_step)
