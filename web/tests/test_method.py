"""The method in the page computes what Python computes."""

from typing import NamedTuple

import numpy as np
import pytest
import torch

from clothlab import ControlSettings, NewtonEstimator, Run, data, period_mask, predict
from clothlab.lab import LiveSession
from clothlab.method.cloth_task import control_loss
from clothlab.method.control import Limits, optimise_commands
from clothlab.method.model import Memory
from web.constants import pushed_hand

SOLVES = 40
ESTIMATED = 220  # steps, more than the window
# Arm, and how far a plan may be off [rad], [N]
ARMS = {"torque": 1e-4, "muscle": 1e-2}
BIAS = 1e-3
ELLIPSE = 3e-4  # [m], of a centimetre or more
AIM = 1e-4  # [s.d. of z], [pixel]
SETTINGS = ControlSettings()


class Robot:
    """An arm, and what the page answers about it."""

    def __init__(self, session, node):
        self.session = session
        self.trained = session.trained
        self.model = session.trained.model
        self.plan = ARMS[session.arm.name]
        self.runs = session.runs
        self.p = next(iter(self.trained.biases.values()))
        self._node = node

    def ask(self, what, questions):
        asked = [{"what": what} | question for question in questions]
        return self._node("method.mjs", self.trained.arm.name, {"questions": asked})


@pytest.fixture(scope="module", params=ARMS)
def robot(request, node):
    session = LiveSession(request.param)
    yield Robot(session, node)
    session.close()


class Moment(NamedTuple):
    """What a solve begins with: a state of a recorded run, and the memory before."""

    s: torch.Tensor
    u: torch.Tensor
    p: torch.Tensor
    h: torch.Tensor
    c: torch.Tensor
    z_ref: torch.Tensor
    mask: torch.Tensor

    def question(self, arm, **other):
        lists = {
            name: value.flatten().tolist() for name, value in self._asdict().items()
        }
        limits = {
            "lower": arm.command_lower.tolist(),
            "upper": arm.command_upper.tolist(),
        }
        return lists | limits | {"iterations": SETTINGS.iterations} | other


def moments(robot):
    rng = np.random.default_rng(0)
    biases = list(robot.trained.biases.values())
    names = ("target-1", "target-2")
    gallery = robot.session.gallery
    aims = [robot.session.aim_at(gallery[name]) for name in names]
    for k in range(SOLVES):
        run = robot.runs[k % len(robot.runs)]
        t = int(rng.integers(20, len(run.s) - 10))
        p = torch.as_tensor(biases[rng.integers(len(biases))])
        before = slice(t - 10, t)
        s = torch.as_tensor(run.s[None, before])
        _, memory = robot.model(s, torch.as_tensor(run.u[None, before]), p)
        yield Moment(
            torch.as_tensor(run.s[t]),
            torch.as_tensor(run.u[t : t + SETTINGS.horizon]),
            p,
            *memory,
            torch.as_tensor(aims[k % 2].z),
            torch.as_tensor(period_mask(t)),
        )


def solved(robot, moment):
    """The plan that Python finds."""
    arm = robot.trained.arm
    lower, upper = (
        torch.as_tensor(each, dtype=torch.float32)
        for each in (arm.command_lower, arm.command_upper)
    )
    tensions = robot.trained.layout.tensions

    def loss(plans):
        memory = Memory(moment.h, moment.c)
        states = predict(robot.model, moment.s, plans, moment.p, memory)
        weight = SETTINGS.tension_weight
        return control_loss(states, moment.z_ref, moment.mask, tensions, weight)

    limits = Limits(lower, upper, robot.model.u_std)
    plan, _ = optimise_commands(loss, moment.u, limits, SETTINGS)
    return plan.numpy()


def test_recorded_solves(robot):
    cases = list(moments(robot))
    expected = np.array([solved(robot, moment) for moment in cases])

    def apart(**other):
        questions = [moment.question(robot.trained.arm, **other) for moment in cases]
        found = [answer["plan"] for answer in robot.ask("solve", questions)]
        return np.abs(np.reshape(found, expected.shape) - expected).max()

    difference = apart()
    print(f"plans differ by {difference:.1e}")
    assert difference < robot.plan
    # Another p would be noticed, and a solve that goes nowhere
    assert apart(p=[0.0, 0.0]) > robot.plan
    assert apart(iterations=0) > robot.plan


@pytest.mark.parametrize("driver", ["control", "control: last", "control: earlier"])
def test_a_controller_goes_through_a_run(robot, driver):
    """It is shown a recorded run, whatever it commands.

    It solves once for each start: a solve makes more of what rounding made of the last.
    """
    states = robot.runs[0].s[:20]
    solved = (0, SETTINGS.period) if driver == "control" else (0,)
    skip = [t for t in range(len(states)) if t not in solved]
    plans = robot.session.plans if driver == "control" else None
    earlier = driver == "control: earlier"
    settings = ControlSettings(warm_start="earlier" if earlier else "last")
    aim = robot.session.aim
    policy = robot.trained.controller(aim.known, robot.p, settings, plans)
    question = {"driver": driver, "p": robot.p.tolist(), "target": aim.z.tolist()}
    question |= {"states": states.tolist(), "skip": skip}
    (steps,) = robot.ask("control", [question])
    for t, (s, step) in enumerate(zip(states, steps, strict=True)):
        u = policy.controller.act(s, solve=t not in skip)
        assert np.abs(step["command"] - u).max() < 10 * robot.plan, t
        assert step["predicted"] == pytest.approx(policy.predicted_distance, abs=1e-2)
        assert step["periodEnded"] == policy.controller.period_ended


@pytest.mark.parametrize("driver", ["control", "iterative"])
def test_what_was_prepared_is_used_only_where_it_belongs(robot, driver):
    p = robot.p.tolist()
    target = robot.session.aim.z.tolist()
    states = robot.runs[0].s[: 2 * SETTINGS.period + 1].tolist()
    question = {"driver": driver, "p": p, "target": target, "states": states}
    other_p, other_target = {"p": [0.0, 0.0]}, {"target": [0.0] * len(target)}
    prepared = [[], [{}], [other_p], [other_target], [other_p, {}]]
    found = robot.ask("control", [question | {"prepared": each} for each in prepared])
    counts = [[step.pop("asked") for step in steps] for steps in found]
    for steps in found[1:]:
        assert steps == found[0]

    # Only the controller with recorded plans ranks them, as each period begins
    begins = [int(t % SETTINGS.period == 0) for t in range(len(states))]
    if driver == "control":
        ranked = np.add(begins, 1).tolist()
        alone = [1] * len(states)
        assert counts == [ranked, alone, ranked, ranked, alone]


def test_iterative_learning_goes_through_a_run(robot):
    """It is shown a recorded run, whatever it commands."""
    states = robot.runs[0].s[: 6 * SETTINGS.period]
    aim = robot.session.aim
    policy = robot.trained.iterative_controller(aim.known, robot.p, robot.runs)
    question = {"driver": "iterative", "p": robot.p.tolist(), "target": aim.z.tolist()}
    (steps,) = robot.ask("control", [question | {"states": states.tolist()}])
    for s, step in zip(states, steps, strict=True):
        u = policy.controller.act(s)
        assert np.abs(step["command"] - u).max() < robot.plan
        assert step["predicted"] == pytest.approx(policy.predicted_distance, abs=1e-3)
    assert steps[-1]["basis"] == "5 attempts"


def test_estimates_of_recorded_steps(robot):
    # Longer than the window, so that it moves
    run = robot.runs[0]
    whole = Run(np.tile(run.s, (2, 1)), np.tile(run.u, (2, 1)), run.material)
    whole = whole[:ESTIMATED]
    start = np.zeros(2, np.float32)
    estimator = NewtonEstimator(robot.model, start)
    pairs = zip(whole.s, whole.u, strict=True)
    expected = np.array([estimator.update(s, u) for s, u in pairs])
    question = {"states": whole.s.tolist(), "commands": whole.u.tolist()}
    paths = robot.ask("estimate", [question | {"p": p} for p in ([0, 0], [1, 0])])
    found, other = (np.abs(np.array(path) - expected).max() for path in paths)
    print(f"p differs by {found:.1e}")
    assert found < BIAS

    # Another p to begin with would be noticed
    assert other > BIAS


def test_aims(robot):
    masks = [*data.load_targets().values(), *data.load_targets("drawn").values()]
    aims = [robot.session.aim_at(mask) for mask in masks]
    found = robot.ask(
        "aim", [{"mask": mask.ravel().astype(int).tolist()} for mask in masks]
    )
    for aim, answer in zip(aims, found, strict=True):
        known = np.array(list(answer["known"])) == "1"
        assert (known == aim.known.ravel()).all()
        assert answer["z"] == pytest.approx(aim.z, abs=AIM)
        assert answer["distance"] == pytest.approx(aim.distance, abs=AIM)
        assert answer["overlap"] == pytest.approx(aim.overlap)
    assert any((aim.known != aim.mask).any() for aim in aims)


def test_a_mask_without_a_cloth_is_a_mistake(robot):
    (answer,) = robot.ask("aim", [{"mask": [0] * robot.session.target.size}])
    assert answer == {"refused": "no cloth in the image: the mask is empty"}


def test_ellipses_between_those_of_the_grid(robot):
    arm = robot.trained.arm
    if not arm.has_stiffness:
        pytest.skip("this arm has no stiffness")
    rng = np.random.default_rng(0)
    commands = rng.uniform(arm.command_lower, arm.command_upper, (15, 3))
    questions = [{"theta": [*theta], "tension": f} for *theta, f in commands]
    worst = 0.0
    for (shoulder, elbow, f), answer in zip(
        commands, robot.ask("ellipse", questions), strict=True
    ):
        # Pushes from all around, which turn with the shoulder: angles grow downwards
        pushed = pushed_hand(arm, np.array([0, elbow]), f)
        cos, sin = np.cos(shoulder), -np.sin(shoulder)
        turned = pushed @ np.array([[cos, sin], [-sin, cos]])
        worst = max(worst, np.abs(answer - turned).max())
    print(f"ellipses differ by {1e3 * worst:.2f} mm")
    assert worst < ELLIPSE
