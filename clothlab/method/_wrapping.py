"""A policy around something else: another policy, or a plain function."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from clothlab.masks import Observation
from clothlab.method.policy import Policy


class Wrapper(Policy):
    """A policy around another one, to which it passes everything on."""

    def __init__(self, policy: Policy | Callable[[Observation], ArrayLike]):
        self.policy = as_policy(policy)

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the policy inside."""
        return self.policy.name

    def reset(self, seed: int = 0) -> None:
        self.policy.reset(seed)

    def set_target(self, mask: ArrayLike) -> None:
        self.policy.set_target(mask)

    def set_bias(self, p: ArrayLike) -> None:
        self.policy.set_bias(p)

    def __call__(self, observation: Observation) -> np.ndarray:
        return self.policy(observation)


class _FunctionPolicy(Policy):
    """A plain function `observation -> u`, or what is called like one, as a policy."""

    def __init__(self, function: Callable[[Observation], ArrayLike]):
        self.function = function
        self.name = getattr(function, "__name__", type(function).__name__)

    def reset(self, seed: int = 0) -> None:
        # An object of another library may be called and reset, too.
        reset = getattr(self.function, "reset", None)
        if callable(reset):
            reset(seed)

    def __call__(self, observation: Observation) -> np.ndarray:
        return np.asarray(self.function(observation))


def as_policy(policy: Policy | Callable[[Observation], ArrayLike]) -> Policy:
    """Return a plain function as a policy, and a policy as it is."""
    if not callable(policy) or isinstance(policy, type):
        raise TypeError(
            "a policy is called with an observation and returns a command, got "
            f"{policy!r}"
        )
    return policy if isinstance(policy, Policy) else _FunctionPolicy(policy)
