"""Gradient-based control: W and p stay, only the commands move (paper, eqs. 5 to 8)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import Checked, check_array, check_number, choose, setting
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.dpmpb import DPMPB, Sequences, observe
from clothlab.learning.fast_rollout import FastDPMPB
from clothlab.policies import Policy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.env import Observation
from clothlab.simulation.vision import check_mask
from clothlab.trials import Trial

Predict = Callable[[Tensor], Tensor]  # commands [B, T, D_u] → predicted states [B, T, D_s]
Loss = Callable[[Tensor], Tensor]  # predicted states, or commands → loss of each sequence [B]


@dataclass(frozen=True)
class ControlSettings(Checked):
    """The constants of the control; the defaults are the paper's."""

    horizon: int = setting(8, "step", at_least=1)  # N_seq
    candidates: int = setting(30, at_least=2)  # N_batch, step sizes tried at once
    largest_step: float = setting(1.0, above=0)  # gamma_max, in standard deviations of u
    smallest_step: float = setting(1e-3, above=0)  # a logarithmic scale needs one; not the paper's
    iterations: int = setting(3, at_least=1)  # N_iter
    period: int = setting(8, "step", at_least=1)  # N_periodic
    tension_weight: float = setting(0.001, "1/N", at_least=0)  # w_loss
    warm_start: str = setting("last")  # command after a plan's end: its "last" (paper), or "periodic": a period ago's


def period_mask(t: int, settings: ControlSettings) -> np.ndarray:
    """The mask m_t `[T]`: 1 where the predicted step t+1, …, t+horizon ends a period, else 0."""
    steps = t + 1 + np.arange(settings.horizon)
    return (steps % settings.period == 0).astype(np.float32)


def step_sizes(settings: ControlSettings) -> Tensor:
    """Values of gamma to try, `[candidates]`: 0, which keeps the loss from rising, and a logarithmic scale."""
    low, high = np.log10([settings.smallest_step, settings.largest_step])
    return torch.cat([torch.zeros(1), torch.logspace(low, high, settings.candidates - 1)])


def control_loss(s: Tensor, z_ref: Tensor, mask: Tensor, tension: slice, tension_weight: float) -> Tensor:
    """h_loss = ‖m ⊗ (z_ref - z)‖₂ + w_loss ‖f‖₂ of each sequence, `[B]` (eq. 8).

    From predicted states `[B, T, D_s]`, z first, the target `[D_z]`, m_t `[T]`, and where the muscle tensions [N] lie
    in s; an arm without tensions leaves the second term out.
    """
    z = s[..., : len(z_ref)]
    loss = torch.linalg.vector_norm(mask[:, None] * (z_ref - z), dim=(1, 2))
    f = s[..., tension]
    if f.shape[-1]:
        loss = loss + tension_weight * torch.linalg.vector_norm(f, dim=(1, 2))
    return loss


def downhill(loss: Loss, u: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Losses `[B]` of plans `[B, T, D_u]`, and their gradients, whose lengths are one, in units of `scale` `[D_u]`."""
    u = u.detach().requires_grad_()
    losses = loss(u)
    (g,) = torch.autograd.grad(losses.sum(), u)
    g = g * scale
    return losses.detach(), g / torch.linalg.vector_norm(g, dim=(1, 2), keepdim=True).clamp_min(1e-12)


@torch.no_grad()
def best_step(loss: Loss, u: Tensor, steps: Tensor, lower: Tensor, upper: Tensor) -> tuple[Tensor, Tensor]:
    """The best of several steps `[K, B, T, D_u]` back from plans `[B, T, D_u]`, and their losses `[B]`."""
    candidates = (u - steps).clamp(lower, upper)
    losses = loss(candidates.flatten(0, 1)).unflatten(0, candidates.shape[:2])
    return candidates[losses.argmin(0), torch.arange(len(u))], losses.amin(0)


def optimise_commands(
    predict: Predict, loss: Loss, u: Tensor, lower: Tensor, upper: Tensor, scale: Tensor, settings: ControlSettings
) -> tuple[Tensor, np.ndarray]:
    """Descend the gradient of the loss on the commands, choosing the best of many step sizes each time (eqs. 5 to 7).

    From `u` `[T, D_u]`, within `lower` to `upper` `[D_u]`; `scale` `[D_u]` is one unit of gamma. Returns the best
    commands `[T, D_u]`, and the loss at the start and after each iteration, `[iterations + 1]`.
    """

    def loss_of(plans: Tensor) -> Tensor:
        return loss(predict(plans))

    gamma = step_sizes(settings)[:, None, None, None] * scale
    plan, trace = u.clamp(lower, upper)[None], []
    for _ in range(settings.iterations):
        start, direction = downhill(loss_of, plan, scale)
        plan, best = best_step(loss_of, plan, gamma * direction, lower, upper)
        trace.append(start.item())
    return plan[0], np.array([*trace, best.item()])


def recorded_plans(trials: Sequence[Trial], horizon: int = 8, count: int = 200, *, seed: int = 0) -> np.ndarray:
    """Stretches of recorded commands, `[count, horizon, D_u]`, drawn at random."""
    check_number("count", count, int, at_least=1)
    if not trials or min(map(len, trials)) < check_number("horizon", horizon, int, at_least=1):
        raise ValueError(f"plans of {horizon} steps need recorded trials that are at least as long")
    windows = np.concatenate([sliding_window_view(trial.commands, horizon, axis=0) for trial in trials])
    chosen = np.random.default_rng(seed).choice(len(windows), count, replace=len(windows) < count)
    return windows[chosen].transpose(0, 2, 1)


class RecordedPlans(NamedTuple):
    """Stretches of recorded commands, and the states that followed."""

    u: np.ndarray  # [N, T, D_u]
    distance: np.ndarray  # of what was seen after the last command to a target [N] [s.d. of z]
    material: np.ndarray  # names [N]


def nearest_plans(runs: Sequence[Sequences], z_ref: ArrayLike, horizon: int = 8, count: int = 150) -> RecordedPlans:
    """The recorded plans, `count` or fewer, after which z was seen nearest to `z_ref`, best first.

    No two plans of one run overlap by more than half.
    """
    z_ref = np.asarray(z_ref, dtype=np.float32)
    from_each = -(-count // max(len(runs), 1))
    found = []
    for run in runs:
        distance = np.linalg.norm(run.s[horizon:, : len(z_ref)] - z_ref, axis=1)
        for _ in range(min(from_each, len(distance) // horizon)):
            start = int(distance.argmin())
            found.append((run.u[start : start + horizon], float(distance[start]), run.material))
            distance[max(0, start - horizon // 2 + 1) : start + horizon // 2] = np.inf
    if not found:
        raise ValueError(f"plans of {horizon} steps need recorded runs that are longer")
    u, distances, materials = zip(*sorted(found, key=lambda plan: plan[1])[:count], strict=True)
    return RecordedPlans(np.stack(u).astype(np.float64), np.array(distances), np.array(materials))


class PlanningPolicy(Policy):
    """Base of policies that predict with a model and aim at an image; `set_target` and `set_bias` come first."""

    def __init__(self, model: DPMPB, autoencoder: Autoencoder, arm: Arm | str):
        self.model, self.autoencoder, self.arm = model, autoencoder, get_arm(arm)
        self.layout = self.arm.layout(autoencoder.latent_size)
        lower, upper = self.arm.command_lower, self.arm.command_upper
        if (model.state_size, model.command_size) != (self.layout.size, len(lower)):
            raise ValueError(
                f"the model has {model.state_size} states and {model.command_size} commands, the {self.arm.name} arm "
                f"has {self.layout.size} and {len(lower)}; load the weights of this arm"
            )
        # A command whose range is a point is fixed: the descent leaves it out (the paper's "w/o stiffness").
        self.scale = model.u_std * torch.as_tensor(upper > lower)
        self.lower, self.upper = (torch.as_tensor(limit, dtype=torch.float32) for limit in (lower, upper))

    @property
    def p(self) -> np.ndarray:
        """Parametric bias in use `[D_p]`."""
        return self._p.numpy().copy()

    def set_bias(self, p: ArrayLike) -> None:
        """Use another parametric bias `[D_p]` from the next solve on."""
        self._p = torch.as_tensor(check_array("p", p, (self.model.bias_size,), np.float32))
        self._predict = FastDPMPB(self.model, self._p)

    def set_target(self, mask: ArrayLike) -> None:
        """Aim at another image `[H, W]` from the next solve on."""
        self.z_ref = torch.as_tensor(encode(self.autoencoder, check_mask(mask)))


class ControlPolicy(PlanningPolicy):
    """Realises a target mask `[H, W]` again and again, once a period, with the p `[D_p]` of the cloth in the hand.

    With `plans` `[N, horizon, D_u]`, such as `recorded_plans`, each period starts from the one that the model likes
    best, where that beats the warm start. The paper has none and leaves open where the first solve starts. `trace` has
    the losses of each solve since the reset, `[iterations + 1]`.
    """

    name = "control"

    def __init__(
        self,
        model: DPMPB,
        autoencoder: Autoencoder,
        arm: Arm | str,
        target: ArrayLike,
        p: ArrayLike,
        settings: ControlSettings | None = None,
        plans: ArrayLike | None = None,
    ):
        super().__init__(model, autoencoder, arm)
        self.settings = settings or ControlSettings()
        self._periodic = choose("warm start", self.settings.warm_start, {"last": False, "periodic": True})
        shape = (self.settings.horizon, len(self.lower))
        plans = np.empty((0, *shape)) if plans is None else check_array("plans", plans, ("N", *shape))
        self._plans = torch.as_tensor(plans, dtype=torch.float32).clamp(self.lower, self.upper)
        self.set_target(target)
        self.set_bias(p)
        self.reset()

    def reset(self, seed: int = 0) -> None:
        """Forget the last run: phase, memory and plan."""
        self.trace: list[np.ndarray] = []
        self._t = 0
        self._memory = self.model.initial_memory()
        self._last: tuple[Tensor, Tensor] | None = None
        home = torch.as_tensor(self.arm.home_command, dtype=torch.float32)
        self._u = home.expand(self.settings.horizon, -1)
        self._sent = self._u[:0]

    def __call__(self, observation: Observation) -> np.ndarray:
        s = self._follow(observation)
        mask = torch.as_tensor(period_mask(self._t, self.settings))

        def predict(u: Tensor) -> Tensor:
            return self._predict(s, u, self._memory)

        def loss(states: Tensor) -> Tensor:
            return control_loss(states, self.z_ref, mask, self.layout.tensions, self.settings.tension_weight)

        start = self._u
        if len(self._plans) and self._t % self.settings.period == 0:
            with torch.no_grad():
                starts = torch.cat([start[None], self._plans])
                start = starts[loss(predict(starts)).argmin()]
        self._u, trace = self.search(predict, loss, start)
        self.trace.append(trace)
        return self._send(s)

    def search(self, predict: Predict, loss: Loss, start: Tensor) -> tuple[Tensor, np.ndarray]:
        """Better commands than `start` `[T, D_u]`, and the trace of their loss; overwrite it to search differently."""
        return optimise_commands(predict, loss, start, self.lower, self.upper, self.scale, self.settings)

    def step_without_solving(self, observation: Observation) -> np.ndarray:
        """Return the next command of the last plan, `[D_u]`, when there is one but no time for a solve."""
        return self._send(self._follow(observation)) if self.trace else self(observation)

    @property
    def foreseen(self) -> np.ndarray | None:
        """The z that the plan leads to at the end of its period `[D_z]`; None where that is out of sight."""
        ends = period_mask(self._t - 1, self.settings)
        if self._last is None or not ends.any():
            return None
        with torch.no_grad():
            states = self._predict(self._last[0], self._u[None, : ends.argmax() + 1], self._memory)
        return states[0, -1, self.layout.z].numpy()

    @property
    def predicted_distance(self) -> float | None:
        """Distance of that z to the target [s.d. of z]."""
        return None if self.foreseen is None else float(np.linalg.norm(self.z_ref.numpy() - self.foreseen))

    @property
    def period_ended(self) -> bool:
        """Whether the last command was the last of its period."""
        return self._last is not None and self._t % self.settings.period == 0

    def _follow(self, observation: Observation) -> Tensor:
        """Encode the state; memory follows what was observed, not what was predicted; the plan moves on."""
        if self._last is not None:
            self._memory = self._predict.follow(*self._last, self._memory)
            self._sent = torch.cat([self._sent, self._u[:1]])[-self.settings.period :]
            repeats = self._periodic and len(self._sent) == self.settings.period
            self._u = torch.cat([self._u[1:], self._sent[:1] if repeats else self._u[-1:]])
        return torch.as_tensor(observe(self.autoencoder, observation))

    def _send(self, s: Tensor) -> np.ndarray:
        self._last = (s, self._u[0])
        self._t += 1
        return self._u[0].double().numpy()
