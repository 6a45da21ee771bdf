"""Gradient-based control: W and p stay, only the commands move (paper, eqs. 5 to 8)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from torch import Tensor

from clothlab.arm import Arm
from clothlab.autoencoder import Autoencoder, encode
from clothlab.dpmpb import DPMPB, FrozenDPMPB, observe
from clothlab.estimation import BiasEstimator
from clothlab.trials import Trial
from clothlab.vision import check_mask

__all__ = [
    "ControlPolicy",
    "ControlSettings",
    "EstimatingPolicy",
    "control_loss",
    "optimise_commands",
    "period_mask",
    "recorded_plans",
    "shift_left",
    "step_sizes",
]


@dataclass(frozen=True)
class ControlSettings:
    """The constants of the control; the defaults are the paper's."""

    horizon: int = field(default=8, metadata={"unit": "step"})  # N_seq
    candidates: int = field(default=30, metadata={"unit": "-"})  # N_batch, step sizes tried at once
    largest_step: float = field(default=1.0, metadata={"unit": "-"})  # gamma_max, in standard deviations of u
    smallest_step: float = field(default=1e-3, metadata={"unit": "-"})  # a logarithmic scale needs one; not the paper's
    iterations: int = field(default=3, metadata={"unit": "-"})  # N_iter
    period: int = field(default=8, metadata={"unit": "step"})  # N_periodic
    tension_weight: float = field(default=0.001, metadata={"unit": "1/N"})  # w_loss


def period_mask(t: int, settings: ControlSettings) -> np.ndarray:
    """The mask m_t `[T]`: 1 where the predicted step t+1, …, t+horizon ends a period, else 0.

    It shifts left by one each step, as in the paper's example (0,1,0,0) → (1,0,0,0) → (0,0,0,1).
    """
    steps = t + 1 + np.arange(settings.horizon)
    return (steps % settings.period == 0).astype(np.float32)


def step_sizes(settings: ControlSettings) -> Tensor:
    """Values of gamma to try, `[candidates]`.

    0, which keeps the loss from rising, and the rest on a logarithmic scale.
    """
    low, high = np.log10([settings.smallest_step, settings.largest_step])
    return torch.cat([torch.zeros(1), torch.logspace(low, high, settings.candidates - 1)])


def control_loss(s: Tensor, z_ref: Tensor, mask: Tensor, tension: slice, tension_weight: float) -> Tensor:
    """h_loss = ‖m ⊗ (z_ref - z)‖₂ + w_loss ‖f‖₂ (eq. 8).

    Args:
        s: predicted states `[B, T, D_s]`, z first.
        z_ref: target `[D_z]`.
        mask: m_t `[T]`.
        tension: where the muscle tensions [N] lie in s; an arm without tensions leaves the second term out.
        tension_weight: w_loss.

    Returns:
        Loss of each sequence, `[B]`.
    """
    z = s[..., : len(z_ref)]
    loss = torch.linalg.vector_norm(mask[:, None] * (z_ref - z), dim=(1, 2))
    f = s[..., tension]
    if f.shape[-1]:
        loss = loss + tension_weight * torch.linalg.vector_norm(f, dim=(1, 2))
    return loss


def optimise_commands(predict, loss, u, lower, upper, scale, settings) -> tuple[Tensor, np.ndarray]:
    """Descend the gradient of the loss on the commands, choosing the best of many step sizes each time (eqs. 5 to 7).

    Args:
        predict: commands `[B, T, D_u]` → predicted states `[B, T, D_s]`.
        loss: predicted states → loss of each sequence `[B]`.
        u: where to start `[T, D_u]`.
        lower: smallest command `[D_u]`.
        upper: largest command `[D_u]`.
        scale: what one unit of gamma is for each command `[D_u]`.
        settings: step sizes, iterations.

    Returns:
        The best commands `[T, D_u]`, inside the range; and the loss at the start and after each iteration,
        `[iterations + 1]`.
    """
    gamma = step_sizes(settings)[:, None, None] * scale
    u = u.clamp(lower, upper)
    trace = []
    for _ in range(settings.iterations):
        u.requires_grad_()
        start = loss(predict(u[None]))
        (g,) = torch.autograd.grad(start.sum(), u)
        with torch.no_grad():
            g = g * scale  # the gradient with respect to u in units of `scale`
            direction = g / torch.linalg.vector_norm(g).clamp_min(1e-12)
            candidates = (u - gamma * direction).clamp(lower, upper)
            losses = loss(predict(candidates))
            best = losses.argmin()
            trace.append(start.item())
        u = candidates[best].clone()
    return u.detach(), np.array([*trace, losses[best].item()])


def shift_left(u: Tensor) -> Tensor:
    """The warm start: last solution `[T, D_u]` one step on, its last command twice."""
    return torch.cat([u[1:], u[-1:]])


def recorded_plans(trials: Sequence[Trial], horizon: int = 8, count: int = 200, *, seed: int = 0) -> np.ndarray:
    """Stretches of the commands that somebody has sent before, `[count, horizon, D_u]`, drawn at random."""
    windows = np.concatenate([sliding_window_view(trial.commands, horizon, axis=0) for trial in trials])
    chosen = np.random.default_rng(seed).choice(len(windows), count, replace=len(windows) < count)
    return windows[chosen].transpose(0, 2, 1)


class ControlPolicy:
    """Realises a target image again and again, once a period; a policy for `rollout`.

    Attributes:
        p: parametric bias in use `[D_p]`; assign to change it.
        trace: losses of each solve, a list of `[iterations + 1]`.
    """

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm,
        target: np.ndarray,
        p: np.ndarray,
        settings: ControlSettings | None = None,
        plans: np.ndarray | None = None,
    ):
        """Prepare.

        Args:
            model: trained network.
            autoencoder: the one that the model was trained with.
            arm: gives the range of the commands and says which states are tensions.
            target: mask `[H, W]` of the cloth to realise.
            p: parametric bias of the cloth in the hand `[D_p]`.
            settings: the paper's constants.
            plans: command sequences `[N, horizon, D_u]`, such as `recorded_plans`. Each period then starts from the one
                that the model likes best, where that beats the warm start. The paper has none and leaves open where
                the first solve starts.

        Raises:
            ValueError: a target of another size or without a cloth; a model of other sizes than the arm's; plans of
                another shape.
        """
        self.settings = settings or ControlSettings()
        self.model, self.autoencoder, self.arm = model, autoencoder, arm
        sizes = (model.state_size - autoencoder.latent_size, model.command_size)
        if sizes != (len(arm.state_names), len(arm.command_names)):
            raise ValueError(
                f"the model has {sizes[0]} robot states and {sizes[1]} commands, the {arm.name} arm has "
                f"{len(arm.state_names)} and {len(arm.command_names)}; load the weights of this arm"
            )
        self.z_ref = torch.as_tensor(encode(autoencoder, check_mask(target)))
        # A command whose range is a point is fixed: the descent leaves it out (the paper's "w/o stiffness").
        self.scale = model.u_std * torch.as_tensor(arm.command_upper > arm.command_lower)
        self.lower = torch.as_tensor(arm.command_lower, dtype=torch.float32)
        self.upper = torch.as_tensor(arm.command_upper, dtype=torch.float32)
        offset, part = autoencoder.latent_size, arm.tension_slice
        self._tension = slice(part.start + offset, part.stop + offset)
        self._plans = torch.empty(0, self.settings.horizon, len(self.lower))
        if plans is not None:
            if plans.shape[1:] != self._plans.shape[1:]:
                raise ValueError(f"plans are [N, {self._plans.shape[1]}, {self._plans.shape[2]}], got {plans.shape}")
            self._plans = torch.as_tensor(plans, dtype=torch.float32).clamp(self.lower, self.upper)
        self.trace: list[np.ndarray] = []
        self._t = 0
        self._memory = model.initial_memory()
        self._last: tuple[Tensor, Tensor] | None = None
        home = torch.as_tensor(arm.home_command, dtype=torch.float32)
        self._u = home.expand(self.settings.horizon, -1)
        self.p = p

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.numpy().copy()

    @p.setter
    def p(self, p: np.ndarray) -> None:
        self._p = torch.as_tensor(np.asarray(p), dtype=torch.float32)
        self._frozen = FrozenDPMPB(self.model, self._p)

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the command `[D_u]`."""
        s = self._follow(observation)
        mask = torch.as_tensor(period_mask(self._t, self.settings))

        def predict(u: Tensor) -> Tensor:
            return self._frozen(s, u, self._memory)

        def loss(states: Tensor) -> Tensor:
            return control_loss(states, self.z_ref, mask, self._tension, self.settings.tension_weight)

        start = self._u
        if len(self._plans) and self._t % self.settings.period == 0:
            with torch.no_grad():
                starts = torch.cat([start[None], self._plans])
                start = starts[loss(predict(starts)).argmin()]
        self._u, trace = self.search(predict, loss, start)
        self.trace.append(trace)
        return self._send(s)

    def search(self, predict, loss, start: Tensor) -> tuple[Tensor, np.ndarray]:
        """Look for better commands than `start`; overwrite it to look in another way.

        Args:
            predict: commands `[B, T, D_u]` → predicted states `[B, T, D_s]`.
            loss: predicted states → loss of each sequence `[B]`.
            start: where to start `[T, D_u]`.

        Returns:
            Commands `[T, D_u]` inside the range, and the trace of their loss.
        """
        return optimise_commands(predict, loss, start, self.lower, self.upper, self.scale, self.settings)

    def coast(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the next command of the last plan, `[D_u]`, without a solve: for when the time for one has run out."""
        return self._send(self._follow(observation))

    def _follow(self, observation: dict[str, np.ndarray]) -> Tensor:
        """Encode the state; the recurrent state follows what was observed, not what was predicted."""
        if self._last is not None:
            with torch.no_grad():
                _, self._memory = self.model(*(x[None, None] for x in self._last), self._p, self._memory)
            self._u = shift_left(self._u)
        return torch.as_tensor(observe(self.autoencoder, observation))

    def _send(self, s: Tensor) -> np.ndarray:
        self._last = (s, self._u[0])
        self._t += 1
        return self._u[0].double().numpy()


class EstimatingPolicy:
    """Any policy, while p is estimated from what it does; a controller is told each new estimate.

    Attributes:
        trace: the estimate after each step, a list of `[D_p]`.
    """

    def __init__(self, policy, estimator: BiasEstimator, autoencoder: Autoencoder):
        """Join a policy and an estimator.

        Args:
            policy: chooses the commands; a `ControlPolicy` has its p replaced after each step.
            estimator: starts from a p and improves it.
            autoencoder: the one that the estimator's model was trained with.
        """
        self.policy, self.estimator, self.autoencoder = policy, estimator, autoencoder
        self.trace: list[np.ndarray] = []

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the command `[D_u]`."""
        u = self.policy(observation)
        p = self.estimator.update(observe(self.autoencoder, observation), u)
        self.trace.append(p)
        if isinstance(self.policy, ControlPolicy):
            self.policy.p = p
        return u
