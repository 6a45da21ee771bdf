"""Is the valley in which a plan ends the model's alone, or the cloth's, too?

The paper's descent, but with slopes that are measured: each number of a plan is nudged
up and down, and each nudged plan is thrown in the simulator. No network predicts
anything; the autoencoder alone is left, since the loss is a distance of images in z.
"""

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
import torch
from torch import Tensor

from clothlab import data
from clothlab.method.cloth_task import observe
from clothlab.method.control import ControlSettings, Limits, best_step
from clothlab.simulation.arm import Arm
from clothlab.simulation.env import ClothEnv
from studies._grid import Experiment, over
from studies._runs import HEAVY, LIGHT, trained
from studies.oracle import SearchSettings, SimulatorMPC
from studies.plan_starts import PERIOD, drawn_starts, kept_until

KINDS = ("home", "still", "random", "recorded")  # of starts
# [s.d. of u] of one number of a plan; the next is tried where one leads nowhere. An
# image is made of whole pixels, and smaller nudges would hardly change any.
NUDGES = (0.2, 0.5, 0.1)

_Loss = Callable[[Tensor], Tensor]  # of plans [B, T, D_u], one number for each


def measured_slope(loss: _Loss, plan: Tensor, nudge: float, scale: Tensor) -> Tensor:
    """Slope of a loss at a plan `[T, D_u]` in units of `scale`, by central differences.

    Args:
        loss: of plans `[B, T, D_u]`.
        plan: `[T, D_u]`.
        nudge: of one number, in units of `scale`.
        scale: one unit of each command `[D_u]`.
    """
    single = torch.eye(plan.numel()).reshape(-1, *plan.shape)  # one number in each
    moved = nudge * scale * single
    rise = loss(plan + moved) - loss(plan - moved)
    return (rise / (2 * nudge)).reshape(plan.shape)


def descend(
    loss: _Loss, plan: Tensor, limits: Limits, iterations: int
) -> tuple[Tensor, np.ndarray]:
    """The paper's line search along measured slopes.

    It ends early where no size of nudge shows a way on.

    Returns: the best plan `[T, D_u]`, and its loss at the start and after each
        iteration, `[iterations + 1]`.
    """
    losses = [loss(plan[None]).item()]
    for _ in range(iterations):
        found, lowest = _next(loss, plan, losses[-1], limits)
        if lowest == losses[-1]:  # so it would be in each further iteration
            break
        plan = found
        losses.append(lowest)
    losses += losses[-1:] * (iterations + 1 - len(losses))
    return plan, np.array(losses)


def _next(
    loss: _Loss, plan: Tensor, least: float, limits: Limits
) -> tuple[Tensor, float]:
    """The plan and its loss after one step; both as they were where none leads down."""
    gamma = ControlSettings().step_sizes()[:, None, None, None]
    for nudge in NUDGES:
        slope = measured_slope(loss, plan, nudge, limits.scale)
        steps = gamma * limits.scale * slope / slope.norm().clamp_min(1e-12)
        found, lowest = best_step(loss, plan[None], steps, limits)
        if lowest.item() < least:
            return found[0], lowest.item()
    return plan, least


def _drawn(start: str, arm: Arm, draws: int) -> Tensor:
    """Plans `[draws, 8, D_u]` of a kind; there is one at home."""
    if start == "home":
        plans = np.tile(arm.home_command, (1, PERIOD, 1))
    else:
        plans = drawn_starts(f"{start} {draws}", arm, seed=0)
    return torch.as_tensor(plans, dtype=torch.float32)


def _run_both(
    start: str, target: str, cloth: str, draws: int = 10, iterations: int = 200
) -> dict[str, Any]:
    """Descents by measured slopes from rest, in the simulator and in a model.

    Args:
        start: kind of the starts, one of `KINDS`; there is one plan at home.
        target, cloth: of the task, by name.
        draws: of starts of the other kinds.
        iterations: of each descent at most.
    """
    learned = trained("torque-0")
    mask = data.load_target(target)
    plans = _drawn(start, learned.arm, draws)
    kept = kept_until(iterations)
    by_cloth = []
    by_model = []
    ends = []
    with closing(ClothEnv(learned.arm, cloth)) as env:
        # What a plan comes to, as it is thrown and as the model predicts it
        s = torch.as_tensor(observe(learned.autoencoder, env.reset(seed=0)[0]))
        controller = learned.controller(mask, cloth).controller
        limits = controller.limits
        thrown = _Throws(env, learned, mask, limits)

        def predicted(plans: Tensor) -> Tensor:
            with torch.no_grad():
                return controller.losses(s, plans)

        # From each start twice; and what the model found is thrown
        with closing(thrown):
            for plan in plans:
                _, losses = descend(thrown, plan, limits, iterations)
                by_cloth.append(losses[kept])
                end, losses = descend(predicted, plan, limits, iterations)
                by_model.append(losses[kept])
                ends.append(thrown(end[None]).item())
    return {
        "after": kept,  # iterations
        "simulator": np.round(by_cloth, 4),  # distance [draws, kept]
        "model": np.round(by_model, 4),  # predicted distance [draws, kept]
        "model_thrown": np.round(ends, 4),  # distance of what the model found [draws]
    }


class _Throws:
    """Distance `[B]` [s.d. of z] to a target after plans `[B, 8, D_u]` are thrown."""

    def __init__(self, env: ClothEnv, learned: Any, mask: np.ndarray, limits: Limits):
        self._limits = limits
        self._simulator = SimulatorMPC(
            env, learned.autoencoder, mask, np.empty(0), SearchSettings(), learned.arm
        )

    def __call__(self, plans: Tensor) -> Tensor:
        within = plans.clamp(self._limits.lower, self._limits.upper).double()
        return torch.as_tensor(self._simulator.distances(within.numpy())).float()

    def close(self) -> None:
        """Release the copy's OpenGL context."""
        self._simulator.close()


EXPERIMENTS = (
    Experiment(
        "simulator_descents",
        _run_both,
        over(start=KINDS, target=("target-1", "target-2"), cloth=(LIGHT, HEAVY)),
    ),
)
