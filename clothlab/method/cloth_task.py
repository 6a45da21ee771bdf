"""Control towards an image of the cloth: its state, the paper's loss, and a policy.

Source: the paper's section on control, eq. 8.
"""

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_mask, check_number, settings_or_default
from clothlab.masks import Observation
from clothlab.method._arm import ControlledArm
from clothlab.method._inputs import check_sizes
from clothlab.method.autoencoder import Autoencoder, encode
from clothlab.method.control import Controller, ControlSettings, GradientSearch, Search
from clothlab.method.estimation import Estimator
from clothlab.method.model import DPMPB
from clothlab.method.rollout import Policy


def observe(autoencoder: Autoencoder, observation: Observation) -> np.ndarray:
    """State s = (z, robot state) of one observation, `[D_s]`.

    Here physics in float64 becomes learning in float32.
    """
    z = encode(autoencoder, observation["image"])
    return np.concatenate([z, observation["robot"]]).astype(np.float32)


def period_mask(t: int, settings: ControlSettings | None = None) -> np.ndarray:
    """The mask m_t `[T]`: 1 where a predicted step ends a period, else 0.

    The predicted steps are t + 1, …, t + horizon. Periods end at the multiples of
    `settings.period`.
    """
    settings = settings_or_default(settings, ControlSettings)
    t = check_number("t", t, int, at_least=-1)
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


class ImageLoss:
    """What the cloth's controller wants: to look like a target image once a period.

    Args:
        autoencoder: by whose z images are compared.
        target: mask `[H, W]`.
        tensions: where the muscle tensions lie in the state, perhaps nowhere.
        settings: with the horizon, the period and w_loss.
    """

    def __init__(
        self,
        autoencoder: Autoencoder,
        target: ArrayLike,
        tensions: slice,
        settings: ControlSettings,
    ):
        self._autoencoder = autoencoder
        self._tensions = tensions
        self._settings = settings
        self.z_ref = self.latent(target)

    def latent(self, mask: ArrayLike) -> Tensor:
        """What an image `[H, W]` is compared by, `[D_z]`."""
        return torch.as_tensor(encode(self._autoencoder, check_mask(mask)))

    def __call__(self, states: Tensor, commands: Tensor, t: int) -> Tensor:
        """Loss `[B]` of predicted states `[B, T, D_s]` from control step t on."""
        mask = torch.as_tensor(period_mask(t, self._settings))
        weight = self._settings.tension_weight
        return control_loss(states, self.z_ref, mask, self._tensions, weight)


class ControlPolicy(Policy):
    """Realises a target image again and again, once a period.

    It looks through the autoencoder, and leaves the rest to its `controller`, whose
    loss is an `ImageLoss`.

    Args:
        model: trained on the z of this autoencoder.
        autoencoder: makes z of an image.
        arm: the arm whose commands these are, perhaps with narrower limits.
        target: mask `[H, W]`.
        p: parametric bias of the cloth, `[D_p]`.
        settings: the constants of the control.
        search: how commands are looked for; by default the paper's `GradientSearch()`.
    """

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: ControlledArm,
        target: ArrayLike,
        p: ArrayLike,
        settings: ControlSettings | None = None,
        *,
        search: Search | None = None,
    ):
        settings = settings_or_default(settings, ControlSettings)
        search = GradientSearch() if search is None else search
        self.name = search.name

        # The eyes and the arm, and whether the model belongs to them.
        self.autoencoder = autoencoder
        self.arm = arm
        self.layout = arm.layout(autoencoder.latent_size)
        check_sizes(model, arm, self.layout)

        # What is wanted, and the controller that wants it.
        self.loss = ImageLoss(autoencoder, target, self.layout.tensions, settings)
        self.controller = Controller(
            model,
            self.loss,
            p,
            arm.command_lower,
            arm.command_upper,
            settings,
            home=arm.home_command,
            search=search,
        )

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and what was learned in it."""
        self.controller.reset(seed)

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next solve on."""
        z_ref = self.loss.latent(mask)
        with self.controller.between_steps():
            self.loss.z_ref = z_ref

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next solve on."""
        self.controller.set_bias(p)

    def __call__(self, observation: Observation, *, solve: bool = True) -> np.ndarray:
        """The next command `[D_u]`; without a solve that of the last plan."""
        s = observe(self.autoencoder, observation)
        return self.controller.act(s, solve=solve)

    @property
    def foreseen(self) -> np.ndarray | None:
        """The z to which the plan leads at the end of its period, `[D_z]`.

        None before the first command, and where the end lies beyond the horizon.
        """
        steps = self.controller.steps_left + 1
        if steps > self.controller.settings.horizon:
            return None
        states = self.controller.foresee(steps)
        return None if states is None else states[-1, self.layout.z].numpy()

    @property
    def predicted_distance(self) -> float | None:
        """Distance to the target that is expected of the plan [s.d. of z].

        A search that learns says itself what it expects. Otherwise it is that of the z
        which is foreseen. None where there is neither.
        """
        learned = self.controller.learned
        if learned is not None:
            return learned.expected_for(self.loss.z_ref)
        z = self.foreseen
        if z is None:
            return None
        return float(np.linalg.norm(self.loss.z_ref.numpy() - z))

    @property
    def predicted_distances(self) -> list[float]:
        """What a search that learns expected of each period's plan [s.d. of z].

        Empty for a search that learns nothing.
        """
        learned = self.controller.learned
        return [] if learned is None else list(learned.expected)


class EstimatingPolicy(Policy):
    """Any policy, while p is estimated from what it does and given to it.

    `trace` has p `[D_p]` after each step, of the last `ControlSettings.traced`.
    """

    def __init__(self, policy: Policy, estimator: Estimator, autoencoder: Autoencoder):
        self.policy = policy
        self.name = policy.name
        self.estimator = estimator
        self.autoencoder = autoencoder
        self.trace: list[np.ndarray] = []
        self.policy.set_bias(estimator.p)

    def reset(self, seed: int = 0) -> None:
        """Forget the last run, and begin with the p that the estimator started from."""
        self.policy.reset(seed)
        self.estimator.reset()
        self.policy.set_bias(self.estimator.p)
        self.trace = []

    def set_target(self, mask: ArrayLike) -> None:
        """Let the policy aim at another image `[H, W]` from now on."""
        self.policy.set_target(mask)

    def __call__(self, observation: Observation) -> np.ndarray:
        u = self.policy(observation)
        s = observe(self.autoencoder, observation)
        p = self.estimator.update(s, u)
        self.trace = [*self.trace, p][-ControlSettings.traced :]
        self.policy.set_bias(p)
        return u
