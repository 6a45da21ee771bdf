"""Control towards an image of the cloth: the paper's loss, plans from recordings, and the policy (paper, eq. 8)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike
from torch import Tensor

from clothlab._validation import check_array, check_each, check_number, settings_or_default
from clothlab.learning.autoencoder import Autoencoder, encode
from clothlab.learning.cloth_state import observe
from clothlab.learning.control import Controller, ControlSettings, Planner, whole
from clothlab.learning.dpmpb import DPMPB, Sequences, check_model, check_runs
from clothlab.policies import Policy
from clothlab.simulation.arm import Arm, get_arm
from clothlab.simulation.env import Observation
from clothlab.simulation.vision import check_mask
from clothlab.trials import Trial

TENSION_WEIGHT = 0.001  # w_loss [1/N]


def period_mask(t: int, settings: ControlSettings) -> np.ndarray:
    """The mask m_t `[T]`: 1 where the predicted step t+1, …, t+horizon ends a period, else 0."""
    settings = settings_or_default(settings, ControlSettings)
    steps = check_number("t", t, int, at_least=-1) + 1 + np.arange(settings.horizon)
    return (steps % settings.period == 0).astype(np.float32)


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


def recorded_plans(trials: Sequence[Trial], horizon: int = 8, count: int = 200, *, seed: int = 0) -> np.ndarray:
    """Stretches of recorded commands, `[count, horizon, D_u]`, drawn at random."""
    check_number("count", count, int, at_least=1)
    trials = check_each("trials", trials, Trial)
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
    runs = check_runs(runs)
    z_ref = check_array("z_ref", z_ref, ("D_z",), np.float32)
    if runs and len(z_ref) > runs[0].s.shape[1]:
        raise ValueError(f"z_ref has {len(z_ref)} numbers, more than the {runs[0].s.shape[1]} of a state")
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


class PlanningPolicy(Planner, Policy):
    """Base of policies that predict with a model and aim at an image; `set_target` and `set_bias` come first."""

    def __init__(self, model: DPMPB, autoencoder: Autoencoder, arm: Arm | str):
        check_model(model)
        self.autoencoder, self.arm = autoencoder, get_arm(arm)
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
    """A `Controller` that realises a target mask `[H, W]` again and again, once a period, with the p `[D_p]` in use."""

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
        PlanningPolicy.__init__(self, model, autoencoder, arm)
        self.tension_weight, home = TENSION_WEIGHT, self.arm.home_command
        Controller.__init__(self, model, self._loss, p, self.lower, self.upper, settings, home=home, plans=plans)
        self.set_target(target)

    def __call__(self, observation: Observation) -> np.ndarray:
        return self.act(observe(self.autoencoder, observation))

    def step_without_solving(self, observation: Observation) -> np.ndarray:
        """Return the next command of the last plan, `[D_u]`, when there is one but no time for a solve."""
        return self.act(observe(self.autoencoder, observation), solve=False)

    def _loss(self, states: Tensor, t: int) -> Tensor:
        mask = torch.as_tensor(period_mask(t, self.settings))
        return control_loss(states, self.z_ref, mask, self.layout.tensions, self.tension_weight)

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
