"""The method in the page computes what Python computes, for both arms."""

import numpy as np
import pytest
import torch

from clothlab import data
from clothlab.lab._equipment import SETUPS, Equipment
from clothlab.method._rollouts import rollout_of
from clothlab.method.cloth_task import period_mask
from clothlab.method.control import ControlSettings, optimise_commands
from clothlab.method.model import Memory
from course.lab_constants import method_files
from course.npm import packages

pytestmark = pytest.mark.book

ARM = "torque"
SOLVES = 40
PLAN = 1e-4  # [rad]
SETTINGS = ControlSettings()


@pytest.fixture(scope="module")
def equipment():
    return Equipment.of(ARM)


@pytest.fixture(scope="module")
def runs(equipment):
    """Runs that the weights were not trained on."""
    return [
        equipment.trained.to_run(trial) for trial in data.load_trials(SETUPS[ARM].known)
    ]


@pytest.fixture(scope="module")
def ask(node, tmp_path_factory):
    """What the page answers to questions."""
    runtime = packages()["onnxruntime-web"].folder / "dist"
    folder = tmp_path_factory.mktemp("method")
    for name, content in method_files(ARM).items():
        (folder / name).write_bytes(content)

    def asked(questions):
        content = {"folder": str(folder), "runtime": str(runtime)}
        return node("method.mjs", content | {"questions": questions})

    return asked


def moments(equipment, runs):
    """Solves as they come: states of recorded runs, memories before, p, and targets."""
    model = equipment.trained.model
    rng = np.random.default_rng(0)
    biases = list(equipment.trained.biases.values())
    targets = [
        equipment.aim_at(equipment.gallery[name]).z for name in ("target-1", "target-2")
    ]
    for k in range(SOLVES):
        run = runs[k % len(runs)]
        t = int(rng.integers(20, len(run.s) - 10))
        p = torch.as_tensor(biases[rng.integers(len(biases))])
        before = slice(t - 10, t)
        _, memory = model(
            torch.as_tensor(run.s[None, before]),
            torch.as_tensor(run.u[None, before]),
            p,
        )
        yield {
            "s": torch.as_tensor(run.s[t]),
            "u": torch.as_tensor(run.u[t : t + SETTINGS.horizon]),
            "p": p,
            "h": memory.h,
            "c": memory.c,
            "z_ref": torch.as_tensor(targets[k % 2]),
            "mask": torch.as_tensor(period_mask(t)),
        }


def plain(moment):
    return {name: value.flatten().tolist() for name, value in moment.items()}


def solved(equipment, moment):
    """What Python answers."""
    trained = equipment.trained
    policy = trained.controller(equipment.gallery["target-1"], moment["p"])
    policy.loss.z_ref = moment["z_ref"]
    controller = policy.controller
    rollout = rollout_of(trained.model)(trained.model, moment["p"])
    memory = Memory(moment["h"], moment["c"])
    t = int(np.argmax(moment["mask"].numpy()))

    def loss(plans):
        states = rollout(moment["s"], plans, memory)
        return policy.loss(states, plans, SETTINGS.period - 1 - t)

    return optimise_commands(loss, moment["u"], controller.limits, SETTINGS)


def test_recorded_solves(equipment, runs, ask):
    cases = list(moments(equipment, runs))
    expected = [solved(equipment, moment) for moment in cases]
    arm = equipment.trained.arm
    limits = {"lower": arm.command_lower.tolist(), "upper": arm.command_upper.tolist()}
    common = {"what": "solve", "iterations": SETTINGS.iterations, **limits}
    found = ask([common | plain(moment) for moment in cases])
    gaps = [
        np.abs(np.reshape(answer["plan"], plan.shape) - plan.numpy()).max()
        for answer, (plan, _) in zip(found, expected, strict=True)
    ]
    print(f"{ARM}: plans differ by {max(gaps):.1e}")
    assert max(gaps) < PLAN
