"""The method in the page computes what Python computes."""

import base64
import json
from typing import NamedTuple

import numpy as np
import pytest
import torch

from clothlab import data
from clothlab._validation import HEIGHT, WIDTH
from clothlab.lab._equipment import SETUPS, Equipment
from clothlab.lab._tracker import BiasTracker, _calibration
from clothlab.method._rollouts import rollout_of
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings, descend
from clothlab.method.data import Run
from clothlab.method.model import Memory
from clothlab.simulation.stiffness import static_posture
from course.lab_constants import method_files
from course.lab_gates import GATES
from course.npm import packages

pytestmark = pytest.mark.book

SOLVES = 40
ESTIMATED = 200  # steps
# Arm, and how far a plan may be off [rad], [N]
ARMS = [(arm, GATES[f"solves {arm}"].bound) for arm in ("torque", "muscle")]
BIAS = GATES["bias torque"].bound
ELLIPSE = 3e-4  # [m], of a centimetre or more
AIM = 1e-4  # [s.d. of z], [pixel]
SETTINGS = ControlSettings()


class Page:
    """An arm, and what the page answers about it."""

    def __init__(self, arm, plan, node, folder):
        self.arm = arm
        self.plan = plan
        self.equipment = Equipment.of(arm)
        self.trained = self.equipment.trained
        trials = data.load_trials(SETUPS[arm].known)
        self.runs = [self.trained.to_run(trial) for trial in trials]
        for name, content in method_files(self.equipment).items():
            (folder / name).write_bytes(content)
        runtime = packages()["onnxruntime-web"].folder / "dist"
        self._given = {"folder": str(folder), "runtime": str(runtime)}
        self._node = node

    def ask(self, what, questions):
        asked = [{"what": what} | question for question in questions]
        return self._node("method.mjs", self._given | {"questions": asked})

    def controller(self, p, driver):
        """Python's, as the page's driver of this name."""
        plans = self.equipment.plans if driver == "control" else None
        earlier = driver == "control: earlier"
        settings = ControlSettings(warm_start="earlier" if earlier else "last")
        mask = self.equipment.gallery["target-1"]
        return self.trained.controller(mask, p, settings, plans)


@pytest.fixture(scope="module", params=ARMS, ids=lambda arm: arm[0])
def page(request, node, tmp_path_factory):
    return Page(*request.param, node, tmp_path_factory.mktemp("method"))


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
        lower, upper = arm.command_lower.tolist(), arm.command_upper.tolist()
        return (
            lists
            | {"iterations": SETTINGS.iterations, "lower": lower, "upper": upper}
            | other
        )


def moments(page):
    rng = np.random.default_rng(0)
    biases = list(page.trained.biases.values())
    aims = [
        page.equipment.aim_at(page.equipment.gallery[name])
        for name in ("target-1", "target-2")
    ]
    for k in range(SOLVES):
        run = page.runs[k % len(page.runs)]
        t = int(rng.integers(20, len(run.s) - 10))
        p = torch.as_tensor(biases[rng.integers(len(biases))])
        before = slice(t - 10, t)
        s = torch.as_tensor(run.s[None, before])
        _, memory = page.trained.model(s, torch.as_tensor(run.u[None, before]), p)
        yield Moment(
            torch.as_tensor(run.s[t]),
            torch.as_tensor(run.u[t : t + SETTINGS.horizon]),
            p,
            *memory,
            torch.as_tensor(aims[k % 2].z),
            torch.as_tensor(period_mask(t)),
        )


def solved(page, moment):
    """The plan that Python finds."""
    policy = page.controller(moment.p, "control: last")
    policy.loss.z_ref = moment.z_ref
    rollout = rollout_of(page.trained.model)(page.trained.model, moment.p)
    t = SETTINGS.period - 1 - int(moment.mask.argmax())

    def loss(plans):
        states = rollout(moment.s, plans, Memory(moment.h, moment.c))
        return policy.loss(states, plans, t)

    plan, _ = descend(loss, moment.u, policy.controller.limits, SETTINGS)
    return plan.numpy()


def test_recorded_solves(page, gate):
    cases = list(moments(page))
    expected = np.array([solved(page, moment) for moment in cases])

    def apart(**other):
        questions = [moment.question(page.trained.arm, **other) for moment in cases]
        found = [answer["plan"] for answer in page.ask("solve", questions)]
        return np.abs(np.reshape(found, expected.shape) - expected).max()

    gate(f"solves {page.arm}", apart())
    # Another p would be noticed, and a solve that goes nowhere
    assert apart(p=[0.0, 0.0]) > page.plan
    assert apart(iterations=0) > page.plan


@pytest.mark.parametrize("driver", ["control", "control: last", "control: earlier"])
def test_a_controller_goes_through_a_run(page, driver):
    """It is shown a recorded run, whatever it commands.

    It solves once for each start: a solve makes more of what rounding made of the last.
    """
    p = next(iter(page.trained.biases.values()))
    states = page.runs[0].s[:20]
    solved = (0, SETTINGS.period) if driver == "control" else (0,)
    skip = [t for t in range(len(states)) if t not in solved]
    policy = page.controller(p, driver)
    controller = policy.controller
    target = policy.loss.z_ref.tolist()
    question = {"driver": driver, "p": p.tolist(), "target": target}
    question |= {"states": states.tolist(), "skip": skip}
    (steps,) = page.ask("control", [question])
    for t, (s, step) in enumerate(zip(states, steps, strict=True)):
        u = controller.act(s, solve=t not in skip)
        assert np.abs(step["command"] - u).max() < 10 * page.plan, t
        assert step["predicted"] == pytest.approx(policy.predicted_distance, abs=1e-2)
        assert step["periodEnded"] == controller.period_ended
        assert step["solves"] == controller.solves


@pytest.mark.parametrize("driver", ["control", "iterative"])
def test_what_was_prepared_is_used_only_where_it_belongs(page, driver):
    p = next(iter(page.trained.biases.values())).tolist()
    target = page.equipment.first_aim().z.tolist()
    states = page.runs[0].s[: 2 * SETTINGS.period + 1].tolist()
    question = {"driver": driver, "p": p, "target": target, "states": states}
    other_p, other_target = {"p": [0.0, 0.0]}, {"target": [0.0] * len(target)}
    prepared = [[], [{}], [other_p], [other_target], [other_p, {}]]
    found = page.ask("control", [question | {"prepared": each} for each in prepared])
    counts = [[step.pop("asked") for step in steps] for steps in found]
    for steps in found[1:]:
        assert steps == found[0]

    # Only the controller with recorded plans ranks them, as each period begins
    begins = [int(t % SETTINGS.period == 0) for t in range(len(states))]
    if driver == "control":
        ranked = np.add(begins, 1).tolist()
        alone = [1] * len(states)
        assert counts == [ranked, alone, ranked, ranked, alone]


def led_to_by_zeros(page, p, s):
    """The z to which commands of 0 lead, which are no plan that was ever tried."""
    model = page.trained.model
    zeros = torch.zeros(1, SETTINGS.period, model.command_size)
    with torch.no_grad():
        states = rollout_of(model)(model, torch.as_tensor(p))(
            torch.as_tensor(s), zeros, model.initial_memory()
        )
    return states[0, -1, page.trained.layout.z]


@pytest.mark.parametrize("aim", ["first", "led to by zeros"])
def test_iterative_learning_goes_through_a_run(page, aim):
    """It is shown a recorded run, whatever it commands."""
    p = next(iter(page.trained.biases.values()))
    states = page.runs[0].s[: 6 * SETTINGS.period]
    exploring = [t < 5 * SETTINGS.period for t in range(len(states))]
    mask = page.equipment.first_aim().known
    policy = page.trained.iterative_controller(mask, p, page.equipment.runs)
    search = policy.controller.search
    if aim == "led to by zeros":
        policy.loss.z_ref = led_to_by_zeros(page, p, states[5 * SETTINGS.period])
    target = policy.loss.z_ref.tolist()
    question = {"driver": "iterative", "p": p.tolist(), "target": target}
    question |= {"states": states.tolist(), "exploring": exploring}
    (steps,) = page.ask("control", [question])
    for s, step, explores in zip(states, steps, exploring, strict=True):
        search.exploring = explores
        u = policy.controller.act(s)
        assert np.abs(step["command"] - u).max() < page.plan
        assert step["predicted"] == pytest.approx(policy.predicted_distance, abs=1e-3)
        assert step["basis"] == search.basis(policy.controller.learned)
        assert step["solves"] == policy.controller.solves


def estimated(page, run, p):
    """p after each step, and the last report, of Python's tracker."""
    setup = page.equipment.setup
    _calibration(setup.weights, setup.known).result()
    tracker = BiasTracker(page.trained, setup.known, p)
    path = [
        tracker.update(s, u, at_rest=True) for s, u in zip(run.s, run.u, strict=True)
    ]
    return np.array(path), tracker.report


def test_estimates_of_recorded_steps(page, gate):
    start = np.zeros(2, np.float32)
    run = page.runs[0]
    # Longer than the window, so that it moves
    whole = Run(np.tile(run.s, (2, 1)), np.tile(run.u, (2, 1)), run.material)
    whole = whole[: ESTIMATED + 22]  # two steps after the last report
    expected, report = estimated(page, whole, start)
    question = {"states": whole.s.tolist(), "commands": whole.u.tolist()}
    found, other = page.ask(
        "estimate", [question | {"p": p} for p in (start.tolist(), [1.0, 0.0])]
    )
    difference = np.abs(np.array(found["path"]) - expected).max()
    gate(f"bias {page.arm}", difference)

    # And how sure it is
    told = found["report"]
    covariance = np.reshape(told["covariance"], (2, 2))
    assert covariance == pytest.approx(report.covariance, rel=1e-2)
    assert told["ratio"] == pytest.approx(report.log_error_ratio, abs=1e-3)
    assert told["unlike"] == report.out_of_distribution
    assert told["outside"] == report.outside_hull
    region = np.array(told["region"])
    assert (region.max(0) + region.min(0)) / 2 == pytest.approx(expected[-1], abs=BIAS)

    # Another p to begin with would be noticed
    assert np.abs(np.array(other["path"]) - expected).max() > BIAS


def test_a_mask_without_a_cloth_is_a_mistake(page):
    (answer,) = page.ask("aim", [{"mask": np.zeros(HEIGHT * WIDTH).tolist()}])
    assert answer == {"refused": "no cloth in the image: the mask is empty"}


def test_aims(page):
    masks = [*data.load_targets().values(), *data.load_targets("drawn").values()]
    aims = [page.equipment.aim_at(mask) for mask in masks]
    found = page.ask(
        "aim", [{"mask": mask.ravel().astype(int).tolist()} for mask in masks]
    )
    for aim, answer in zip(aims, found, strict=True):
        known = np.array(list(answer["known"])) == "1"
        assert (known == aim.known.ravel()).all()
        assert answer["z"] == pytest.approx(aim.z, abs=AIM)
        assert answer["distance"] == pytest.approx(aim.distance, abs=AIM)
        assert answer["overlap"] == pytest.approx(aim.overlap)
    assert any((aim.known != aim.mask).any() for aim in aims)


def test_the_first_aim_and_played_commands_are_pythons(page):
    constants = json.loads(method_files(page.equipment)["constants"])
    first = page.equipment.first_aim()
    mask = np.frombuffer(base64.b64decode(constants["aim"]["mask"]["bytes"]), bool)
    assert (mask == first.mask.ravel()).all()
    (answer,) = page.ask("aim", [{"mask": mask.astype(int).tolist()}])
    for name in ("z", "distance", "overlap"):
        kept = constants["aim"][name]
        if name == "z":
            kept = np.frombuffer(base64.b64decode(kept["floats"]), "<f4")
        assert answer[name] == pytest.approx(kept, abs=AIM)

    # Both who look at nothing move within the limits, and not always the same way
    arm = page.trained.arm
    for kept in constants["commands"].values():
        played = np.frombuffer(base64.b64decode(kept["floats"]), "<f4")
        played = played.reshape(-1, len(arm.command_lower))
        assert (played >= np.float32(arm.command_lower) - 1e-6).all()
        assert (played <= np.float32(arm.command_upper) + 1e-6).all()
        assert (played.std(0) > 0.1 * np.ptp(played, axis=0)).all()


def test_ellipses_between_those_of_the_grid(page):
    arm = page.trained.arm
    if not arm.has_stiffness:
        pytest.skip("this arm has no stiffness")
    rng = np.random.default_rng(0)
    commands = rng.uniform(arm.command_lower, arm.command_upper, (15, 3))
    questions = [{"theta": [*theta], "tension": f} for *theta, f in commands]
    worst = 0.0
    for u, answer in zip(commands, page.ask("ellipse", questions), strict=True):
        # Pushes from all around, which turn with the shoulder
        angles = np.linspace(0, 2 * np.pi, len(answer)) - u[0]
        pushes = np.column_stack([np.cos(angles), np.sin(angles)])
        pushed = np.array([arm.hand(static_posture(arm, u, push)) for push in pushes])
        worst = max(worst, np.abs(answer - (pushed - arm.hand(u[:2]))).max())
    print(f"ellipses: {1e3 * worst:.2f} mm")
    assert worst < ELLIPSE
