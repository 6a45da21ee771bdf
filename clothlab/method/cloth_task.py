"""Control towards an image of the cloth: its state, the paper's loss, and the policy
(paper, eq. 8).
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_number, settings_or_default
from clothlab.masks import Observation, check_mask
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import TRACED, Controller, ControlSettings, Planner, whole
from clothlab.method.estimation import Estimator
from clothlab.method.model import DPMPB, check_model
from clothlab.method.policy import Policy, Wrapper


def observe(autoencoder: Autoencoder, observation: Observation) -> np.ndarray:
    """State s = (z, robot state) of one observation, `[D_s]`: physics in float64
    becomes learning in float32.
    """
    return np.concatenate(
        [encode(autoencoder, observation["image"]), observation["robot"]]
    ).astype(np.float32)


TENSION_WEIGHT = 0.001  # w_loss [1/N]


def period_mask(t: int, settings: ControlSettings) -> np.ndarray:
    """The mask m_t `[T]`: 1 where the predicted step t+1, …, t+horizon ends a period,
    else 0.
    """
    settings = settings_or_default(settings, ControlSettings)
    steps = check_number("t", t, int, at_least=-1) + 1 + np.arange(settings.horizon)
    return (steps % settings.period == 0).astype(np.float32)


def control_loss(
    s: Tensor, z_ref: Tensor, mask: Tensor, tension: slice, tension_weight: float
) -> Tensor:
    """h_loss = ‖m ⊗ (z_ref - z)‖₂ + w_loss ‖f‖₂ of each sequence, `[B]` (eq. 8).

    From predicted states `[B, T, D_s]`, z first, the target `[D_z]`, m_t `[T]`, and
    where the muscle tensions [N] lie in s; an arm without tensions leaves the second
    term out.
    """
    z = s[..., : len(z_ref)]
    loss = torch.linalg.vector_norm(mask[:, None] * (z_ref - z), dim=(1, 2))
    f = s[..., tension]
    if f.shape[-1]:
        loss = loss + tension_weight * torch.linalg.vector_norm(f, dim=(1, 2))
    return loss


class PlanningPolicy(Planner, Policy):
    """Base of policies that predict with a model and aim at an image; `set_target` and
    `set_bias` come first.
    """

    def __init__(self, model: DPMPB, autoencoder: Autoencoder, arm: Any):
        check_model(model)
        self.autoencoder, self.arm = autoencoder, arm
        self.layout = self.arm.layout(autoencoder.latent_size)
        lower, upper = self.arm.command_lower, self.arm.command_upper
        if (model.state_size, model.command_size) != (self.layout.size, len(lower)):
            raise ValueError(
                f"the model has {model.state_size} states and {model.command_size} commands, the {self.arm.name} arm "
                f"has {self.layout.size} and {len(lower)}; load the weights of this arm"
            )
        Planner.__init__(self, model, lower, upper)

    @whole
    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next solve on."""
        self.z_ref = torch.as_tensor(encode(self.autoencoder, check_mask(mask)))


class ControlPolicy(PlanningPolicy, Controller):
    """A `Controller` that realises a target mask `[H, W]` again and again, once a
    period, with the p `[D_p]` in use.
    """

    name = "control"

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Any,
        target: ArrayLike,
        p: ArrayLike,
        settings: ControlSettings | None = None,
        plans: ArrayLike | None = None,
    ):
        PlanningPolicy.__init__(self, model, autoencoder, arm)
        self.tension_weight, home = TENSION_WEIGHT, self.arm.home_command
        Controller.__init__(
            self,
            model,
            self._loss,
            p,
            self.lower,
            self.upper,
            settings,
            home=home,
            plans=plans,
        )
        self.set_target(target)

    def __call__(self, observation: Observation) -> np.ndarray:
        return self.act(observe(self.autoencoder, observation))

    def step_without_solving(self, observation: Observation) -> np.ndarray:
        """Return the next command of the last plan, `[D_u]`, when there is one but no
        time for a solve.
        """
        return self.act(observe(self.autoencoder, observation), solve=False)

    def _loss(self, states: Tensor, t: int) -> Tensor:
        mask = torch.as_tensor(period_mask(t, self.settings))
        return control_loss(
            states, self.z_ref, mask, self.layout.tensions, self.tension_weight
        )

    @property
    def foreseen(self) -> np.ndarray | None:
        """The z that the plan leads to at the end of its period `[D_z]`; None where
        that is out of sight.
        """
        ends = period_mask(self._t - 1, self.settings)
        if self._last is None or not ends.any():
            return None
        with torch.no_grad():
            states = self._predict(
                self._last[0], self._u[None, : ends.argmax() + 1], self._memory
            )
        return states[0, -1, self.layout.z].numpy()

    @property
    def predicted_distance(self) -> float | None:
        """Distance of that z to the target [s.d. of z]."""
        return (
            None
            if self.foreseen is None
            else float(np.linalg.norm(self.z_ref.numpy() - self.foreseen))
        )

    @property
    def period_ended(self) -> bool:
        """Whether the last command was the last of its period."""
        return self._last is not None and self._t % self.settings.period == 0


class EstimatingPolicy(Wrapper):
    """Any policy, while p is estimated from what it does and given to it; `trace` has p
    after each step.
    """

    def __init__(self, policy: Policy, estimator: Estimator, autoencoder: Autoencoder):
        self.estimator, self.autoencoder = estimator, autoencoder
        super().__init__(policy)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and begin with the p that the estimator started from."""
        super().reset(seed)
        self.estimator.reset()
        self.set_bias(self.estimator.p)
        self.trace: list[np.ndarray] = []

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.policy(observation)
        p = self.estimator.update(observe(self.autoencoder, observation), u)
        self.trace = [*self.trace, p][-TRACED:]
        self.set_bias(p)
        return u
