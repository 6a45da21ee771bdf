"""Control towards an image of the cloth: its state, the paper's loss, and a policy.

Source: the paper's section on control, eq. 8.
"""

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.estimation import Estimator
from clothlab.method.model import DPMPB, numbers
from clothlab.method.rollout import Policy

# {"image": cloth mask [H, W], "robot": robot state [D_r]}
Observation = dict[str, np.ndarray]


class Arm(Protocol):
    """What a policy has to know of a robot; `clothlab.simulation.arm` has two."""

    @property
    def name(self) -> str:
        """The arm's name, for messages."""

    @property
    def command_lower(self) -> np.ndarray:
        """Smallest commands `[D_u]`."""

    @property
    def command_upper(self) -> np.ndarray:
        """Largest commands `[D_u]`; a command with equal limits is held."""

    @property
    def home_command(self) -> np.ndarray:
        """The command at rest `[D_u]`, which the first plan repeats."""

    def layout(self, latent_size: int) -> Any:
        """Where parts of a state lie: its `size` D_s, and slices `z` and `tensions`."""


def observe(autoencoder: Autoencoder, observation: Observation) -> np.ndarray:
    """State s = (z, robot state) of one observation, `[D_s]`, float32."""
    z = encode(autoencoder, observation["image"])
    return np.concatenate([z, observation["robot"]]).astype(np.float32)


def period_mask(t: int, settings: ControlSettings = ControlSettings()) -> np.ndarray:
    """The mask m_t `[T]`: 1 where a predicted step ends a period, else 0.

    The predicted steps are t + 1, …, t + horizon. Periods end at the multiples of
    `settings.period`.
    """
    steps = t + 1 + np.arange(settings.horizon)
    return (steps % settings.period == 0).astype(np.float32)


def control_loss(
    s: Tensor, z_ref: Tensor, mask: Tensor, tensions: slice, tension_weight: float
) -> Tensor:
    """The loss of each sequence, `[B]` (eq. 8).

        h_loss = ‖m ⊗ (z_ref - z)‖₂ + w_loss ‖f‖₂

    Args:
        s: predicted states, z first, `[B, T, D_s]`.
        z_ref: the target, `[D_z]`.
        mask: m, which steps count, `[T]`.
        tensions: where the muscle tensions f [N] lie in s; an arm without muscles has
            an empty slice, and no second term.
        tension_weight: w_loss [1/N].
    """
    z = s[..., : len(z_ref)]
    loss = torch.linalg.vector_norm(mask[:, None] * (z_ref - z), dim=(1, 2))
    f = s[..., tensions]
    if f.shape[-1]:
        loss = loss + tension_weight * torch.linalg.vector_norm(f, dim=(1, 2))
    return loss


class ControlPolicy(Policy):
    """Realises a target image again and again, once a period.

    It looks through the autoencoder, and leaves the rest to its `controller`.

    Args:
        model: trained on the z of this autoencoder.
        autoencoder: makes z of an image.
        arm: the arm whose commands these are, perhaps with narrower limits.
        target: mask `[H, W]`.
        p: parametric bias of the cloth, `[D_p]`.
        settings: the constants of the control.
        plans: recorded ones from which a period may start, `[N, T, D_u]`.

    Raises:
        ValueError: the model belongs to another arm, or something doesn't fit it.
    """

    name = "control"
    controller: Controller

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm,
        target: ArrayLike,
        p: ArrayLike,
        settings: ControlSettings = ControlSettings(),
        *,
        plans: ArrayLike | None = None,
    ):
        self._set_task(model, autoencoder, arm, target)
        self.controller = Controller(
            model,
            self.loss,
            p,
            arm.command_lower,
            arm.command_upper,
            settings,
            home=arm.home_command,
            plans=plans,
        )

    def _set_task(
        self, model: DPMPB, autoencoder: Autoencoder, arm: Arm, target: ArrayLike
    ) -> None:
        """Keep what the loss needs: the arm's layout of states, and z of the target."""
        self.autoencoder = autoencoder
        self.arm = arm
        self.layout = arm.layout(autoencoder.latent_size)
        sizes = (self.layout.size, len(arm.command_lower))
        if (model.state_size, model.command_size) != sizes:
            raise ValueError(
                f"the model has {model.state_size} states and {model.command_size} "
                f"commands, the {arm.name} arm has {sizes[0]} and {sizes[1]}: load the "
                "weights of this arm"
            )
        self.z_ref = self._latent(target)

    def _latent(self, mask: ArrayLike) -> Tensor:
        """What an image `[H, W]` is compared by, `[D_z]`."""
        if not np.any(mask):
            raise ValueError("no cloth in the image: the mask is empty")
        return numbers("z", encode(self.autoencoder, mask), (self.layout.z.stop,))

    def loss(self, states: Tensor, commands: Tensor, t: int) -> Tensor:
        """Loss `[B]` of predicted states `[B, T, D_s]` from control step t on."""
        settings = self.controller.settings
        mask = torch.as_tensor(period_mask(t, settings))
        weight = settings.tension_weight
        return control_loss(states, self.z_ref, mask, self.layout.tensions, weight)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and what was learned in it."""
        self.controller.reset()

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next solve on."""
        self.z_ref = self._latent(mask)

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next solve on."""
        self.controller.set_bias(p)

    def __call__(self, observation: Observation, *, solve: bool = True) -> np.ndarray:
        """The next command `[D_u]`; without a solve that of the last plan."""
        s = observe(self.autoencoder, observation)
        return self.controller.act(s, solve=solve)

    @property
    def predicted_z(self) -> np.ndarray | None:
        """The z to which the plan leads at the end of its period, `[D_z]`.

        None before the first command, and where the end lies beyond the horizon.
        """
        controller = self.controller
        # After a period's first command (t = 1), its end is 8 steps from the state that
        # the plan began in; after its last (t = 8), it is one.
        steps = -controller.t % controller.settings.period + 1
        states = controller.predicted()
        if states is None or steps > len(states):
            return None
        return states[steps - 1, self.layout.z].numpy()

    @property
    def predicted_distance(self) -> float | None:
        """Distance to the target that is expected of the plan [s.d. of z], or None."""
        z = self.predicted_z
        return None if z is None else float(np.linalg.norm(self.z_ref.numpy() - z))


class EstimatingPolicy(Policy):
    """Any policy, while p is estimated from what it does and given to it.

    `trace` has p `[D_p]` after each step.
    """

    def __init__(self, policy: Policy, estimator: Estimator, autoencoder: Autoencoder):
        self.policy = policy
        self.name = policy.name
        self.estimator = estimator
        self.autoencoder = autoencoder
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and begin with the p that the estimator started from."""
        self.policy.reset(seed)
        self.estimator.reset()
        self.policy.set_bias(self.estimator.p)
        self.trace: list[np.ndarray] = []

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]`."""
        self.policy.set_target(mask)

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]`, until the next estimate."""
        self.policy.set_bias(p)

    def __call__(self, observation: Observation) -> np.ndarray:
        """The command of the policy, from which p is then estimated."""
        u = self.policy(observation)
        p = self.estimator.update(observe(self.autoencoder, observation), u)
        self.trace.append(p)
        self.policy.set_bias(p)
        return u
