"""Where z and the robot's sensors lie in a state."""

from dataclasses import dataclass


@dataclass(frozen=True)
class StateLayout:
    """Where things lie in the state `s = (z, robot state)` of an arm."""

    names: tuple[str, ...]  # what each number of `s` is, with its unit
    z: slice  # the latent image
    robot: slice  # the robot state
    tensions: slice  # the muscle tensions [N]; empty for an arm without muscles

    @property
    def size(self) -> int:
        """D_s."""
        return len(self.names)
