"""Checks of notebook 07."""

from collections.abc import Callable

import numpy as np
import torch

from clothlab.checks._check import CheckFailed, array, check, expect
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings

# The paper's example, of a horizon and a period of 4: t, and what counts
_PAPERS_MASKS = [(2, [0, 1, 0, 0]), (3, [1, 0, 0, 0]), (4, [0, 0, 0, 1])]


@check(array("a list of 0 and 1", None))
def my_mask(answer: Callable, rng: np.random.Generator) -> None:
    """Which of the predicted steps t + 1, t + 2, … end a period: 0 and 1 `[T]`.

    Given are t, the horizon and the period, all in control steps: the paper's example,
    then others, in which horizons are longer and shorter than a period.
    """
    # The paper's example
    for t, wanted in _PAPERS_MASKS:
        found = answer(t, 4, 4)
        assert len(found) == 4, (
            f"one number for each of the 4 predicted steps, not {len(found)}"
        )
        otherwise = (
            f"for t = {t} the paper's example has {wanted}, got {_integers(found)}"
        )
        hint = f"{otherwise}; the first number is that of step t + 1, not of step t"
        from_t_on = np.roll(wanted, 1).tolist()
        expect(found, wanted, otherwise, {hint: from_t_on})

    # Any others
    for t, horizon, period in _mask_cases(rng):
        found = answer(t, horizon, period)
        case = f"t = {t}, horizon = {horizon}, period = {period}"
        assert len(found) == horizon, (
            f"{case}: one number for each of the {horizon} predicted steps, "
            f"not {len(found)}"
        )
        settings = ControlSettings(horizon=horizon, period=period)
        wanted = period_mask(t, settings).tolist()
        otherwise = (
            f"{case}: 1 is where the step is a multiple of {period}; "
            f"got {_integers(found)}"
        )
        expect(found, wanted, otherwise)


def _mask_cases(rng: np.random.Generator) -> list[tuple[int, int, int]]:
    """Cases of t, horizon and period."""
    every_step = (int(rng.integers(9)), int(rng.integers(4, 9)), 1)
    shorter = (int(rng.integers(9)), 3, int(rng.integers(8, 12)))
    longer = []
    for period in rng.permutation([2, 3, 5, 6, 7]).tolist():
        t = int(rng.integers(40))
        horizon = int(rng.integers(2 * period, 2 * period + 5))
        longer.append((t, horizon, period))
    return [*reversed(longer), every_step, shorter]


def _integers(found: np.ndarray) -> list[float]:
    return [int(value) if value == int(value) else value for value in found.tolist()]


_ANY_LENGTH_OF_G = "the length of g must not matter, only its direction"


@check(array("one sequence of commands for each γ", None, 8, 2))
def steps_along(answer: Callable, rng: np.random.Generator) -> None:
    """Steps down a gradient, one for each length γ: commands `[C, T, D_u]`.

    Given are a plan `[8, 2]`, its gradient g `[8, 2]`, the lengths `[3]`, and the
    limits of a command `[2]`. Expected is each step as long as its γ, straight down
    along g, then clipped; lengths and limits are tried one after the other.
    """
    u = rng.uniform(-0.2, 0.2, (8, 2))
    g = rng.normal(size=(8, 2))
    gammas = np.array([0.0, rng.uniform(0.01, 0.02), rng.uniform(0.08, 0.12)])
    # Farther from u than the longest step; an answer that clips to -1 and 1 is seen by
    # the longer one below
    lower = np.array([-1.5, -0.4]) + rng.uniform(-0.05, 0.05)
    upper = np.array([0.5, 0.6]) + rng.uniform(-0.05, 0.05)

    def step(gradient: np.ndarray, lengths: np.ndarray) -> np.ndarray:
        return answer(u.copy(), gradient.copy(), lengths.copy(), lower, upper)

    # Lengths and direction
    found = step(g, gammas)
    _expect_straight_steps(found, u, g, gammas)
    truth = u - gammas[:, None, None] * g / np.linalg.norm(g)
    expect(step(5 * g, gammas), truth, _ANY_LENGTH_OF_G)

    # Limits
    far = step(g, np.array([3.0]))[0]
    inside = np.all((far >= lower - 1e-6) & (far <= upper + 1e-6))
    assert inside, (
        "a command left its range: use numpy.clip, with the lower and the upper that "
        "you are given"
    )
    truth = np.clip(u - 3 * g / np.linalg.norm(g), lower, upper)
    otherwise = "only the commands that leave their range are changed: use numpy.clip"
    expect(far, truth, otherwise)


def _expect_straight_steps(
    found: np.ndarray, u: np.ndarray, g: np.ndarray, gammas: np.ndarray
) -> None:
    """Raise CheckFailed unless there are steps `[C, T, D_u]` from u down along g."""
    # How many, and which way
    assert len(found) == 3, (
        f"one sequence of commands for each γ: three, not {len(found)}"
    )
    way = gammas[:, None, None]
    uphill = u + way * g / np.linalg.norm(g)
    assert not np.allclose(found, uphill), "the step goes uphill"

    # How long
    assert not np.allclose(found, u - way * g), _ANY_LENGTH_OF_G
    moved = np.linalg.norm(found - u, axis=(1, 2))
    assert np.allclose(moved, gammas, atol=1e-6), (
        f"a step must be as long as its γ, {gammas}; yours are {moved.round(3)}"
    )

    # All else
    otherwise = (
        "the steps have the right lengths, but another direction than straight down "
        "along g"
    )
    expect(found, u - way * g / np.linalg.norm(g), otherwise)


@check(array("a gradient for each plan", 3, 4, 2))
def plan_gradients(answer: Callable, rng: np.random.Generator) -> None:
    """The gradient of each plan's own loss, `[3, 4, 2]`.

    Given are a loss of plans, `[B, T, D_u]` -> `[B]`, and three plans whose losses
    differ in size.
    """
    loss = _loss_of_plans()
    u = torch.as_tensor(rng.normal(size=(3, 4, 2))).float()
    _fill_randomly(loss, rng)

    def loss_of_one(plan: torch.Tensor) -> torch.Tensor:
        return loss(plan[None])[0]

    truth = torch.func.vmap(torch.func.grad(loss_of_one))(u).numpy()
    first_only = truth * np.eye(3)[0][:, None, None]
    slips = {
        "these are the gradients over the number of plans: add the losses up, and "
        "don't average them": truth / 3,
        "only the first plan has a gradient: add up the losses of all": first_only,
        "this points downhill: return the gradient itself": -truth,
    }
    otherwise = "a plan's gradient is that of its own loss"
    expect(answer(loss, u), truth, otherwise, slips)


def _loss_of_plans() -> torch.nn.Sequential:
    """A small network, `[B, 4, 2]` -> `[B]`, that does not train."""
    network = torch.nn.Sequential(
        torch.nn.Flatten(1),
        torch.nn.Linear(8, 4),
        torch.nn.Softplus(),
        torch.nn.Linear(4, 1),
        torch.nn.Flatten(0),
    )
    return network.requires_grad_(False)


def _fill_randomly(network: torch.nn.Sequential, rng: np.random.Generator) -> None:
    """Random weights, the same with every version of torch."""
    for layer in network:
        if isinstance(layer, torch.nn.Linear):
            layer.weight.copy_(torch.as_tensor(rng.normal(size=layer.weight.shape)))
            layer.bias.copy_(torch.as_tensor(rng.normal(size=layer.bias.shape)))


@check(array("the commands that were sent", None, 2))
def receding_horizon(answer: Callable, rng: np.random.Generator) -> None:
    """The commands `[T, 2]` that a receding horizon sends.

    Given are `solve(observation, plan)`, which returns another plan `[4, 2]`,
    `step(u)`, which sends a command and returns what is observed then, the first
    observation, a first plan, and the number of steps. What each solve saw and began
    with, and what was sent, is recorded.
    """
    robot = _Robot(rng)
    steps = int(rng.integers(4, 7))
    first = rng.normal()
    plan = rng.normal(size=(4, 2))
    found = answer(robot.solve, robot.step, first, plan, steps)
    assert len(robot.plans) == len(found) == len(robot.sent) == steps, (
        f"in each of {steps} steps, solve once and send one command"
    )

    # What was sent
    last_of_plans = [plan[-1] for plan in robot.plans]
    slips = {"a command was sent that is not the first of its plan": last_of_plans}
    first_of_plans = [plan[0] for plan in robot.plans]
    otherwise = "send the first command of each new plan"
    expect(robot.sent, first_of_plans, otherwise, slips)
    expect(found, robot.sent, "return the commands that were sent")

    # What each solve saw
    assert robot.seen[1] != first, (
        "the second solve sees the first observation again: look after each command"
    )
    outcomes = [float(u.sum()) for u in robot.sent[:-1]]
    assert robot.seen[1:] == outcomes, "a solve sees what the command before it led to"

    # What each solve began with
    shift = [np.concatenate([plan[1:], plan[-1:]]) for plan in robot.plans[:-1]]
    otherwise = "each solve starts from the plan before, shifted by one step"
    expect(robot.starts[1:], shift, otherwise)


class _Robot:
    """A solver and a robot that record what they are asked for."""

    def __init__(self, rng: np.random.Generator):
        self._rng = rng
        self.seen: list[object] = []  # observation of each solve
        self.starts: list[np.ndarray] = []  # plan that each began with
        self.plans: list[np.ndarray] = []  # and returned
        self.sent: list[np.ndarray] = []  # command of each step

    def solve(self, observation: object, plan: np.ndarray) -> np.ndarray:
        """Another plan, unlike all before."""
        self.seen.append(observation)
        start = np.array(plan)
        self.starts.append(start)
        self.plans.append(
            start + 10 * len(self.seen) + self._rng.normal(size=start.shape)
        )
        return self.plans[-1].copy()

    def step(self, u: np.ndarray) -> float:
        """Send a command; what is observed then is the sum of its numbers."""
        if np.shape(u) != (2,):
            raise CheckFailed(
                f"a step takes one command, of shape (2,), not {np.shape(u)}"
            )
        self.sent.append(np.array(u))
        return float(np.sum(u))


@check(array("the start of the next solve", 4, 2))
def shifted(answer: Callable, rng: np.random.Generator) -> None:
    """A warm start `[4, 2]`: the plan before, moved by one step, its gap filled.

    Given are the plan `[4, 2]`, all commands that were sent `[T, 2]`, the period in
    control steps, and whether the motion is periodic; after fewer and after more
    commands than a period has.
    """
    period = int(rng.integers(2, 5))
    plan = rng.normal(size=(4, 2))
    others = rng.normal(size=(2 * period, 2))
    cases = (
        (1, False),
        (period + 2, False),
        (2 * period + 1, True),
        (period, True),
        (period - 1, True),
    )
    for count, periodic in cases:
        sent = np.concatenate([others[: count - 1], plan[:1]])
        case = f"after {count} commands, with period={period} and periodic={periodic}"
        found = answer(plan.copy(), sent.copy(), period, periodic)
        otherwise = (
            "all but the last are the plan's commands, moved by one step to the left"
        )
        expect(found[:-1], plan[1:], otherwise)

        # The last one, from a period before where there was one
        gap = f"{case}: the gap is filled by"
        slips = {f"{gap} the command that was sent just now": sent[-1]}
        if periodic and count >= period:
            slips[f"{gap} the plan's last command"] = plan[-1]
            expect(found[-1], sent[-period], f"{gap} sent[{-period}]", slips)
        else:
            expect(found[-1], plan[-1], f"{gap} the plan's last command", slips)
