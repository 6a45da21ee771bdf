"""DPMPB without a cloth: a cart of two unknown properties by the four public calls."""

import itertools
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import torch

from clothlab import data
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.estimation import estimate_bias
from clothlab.method.model import DPMPB
from clothlab.method.rollout import EpisodeEnded, rollout
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.weights import Checkpoint

PROPERTIES = list(itertools.product((1.0, 2.0, 4.0), (0.5, 1.0, 2.0)))


class Cart(gymnasium.Env):
    """A mass [kg] with friction [N s/m] on a spring of 1 N/m, pushed by a force [N]; a
    step takes 0.2 s.
    """

    def __init__(self, mass, friction, longest=np.inf):
        self.mass, self.friction, self.longest = mass, friction, longest

    def reset(self, *, seed=None, options=None):
        self.state, self.t = np.zeros(2), 0
        return {"place": self.state.copy()}, {}

    def step(self, action):
        for _ in range(10):
            speed = (
                self.state[1]
                + 0.02
                * (action[0] - self.friction * self.state[1] - self.state[0])
                / self.mass
            )
            self.state = np.array([self.state[0] + 0.02 * speed, speed])
        self.t += 1
        return {"place": self.state.copy()}, 0.0, False, self.t >= self.longest, {}


def pushed(mass, friction, steps=400, seed=0, **options):
    # Plain numbers are taken, too
    pushes = iter(np.repeat(np.random.default_rng(seed).uniform(-4, 4, steps), 3))
    robot = Cart(mass, friction, **options)
    return rollout(
        robot,
        lambda s: next(pushes),
        steps,
        material=f"{mass}, {friction}",
        observe=lambda seen: seen["place"],
    )


@pytest.fixture(scope="module")
def learned():
    runs = [pushed(*each, seed=k) for k, each in enumerate(PROPERTIES)]
    return train_dpmpb(
        runs,
        ModelTraining(epochs=25, batch_size=50, sequence_length=20, stride=3),
        progress=False,
    )


def test_a_run_has_what_was_seen_before_each_command():
    run = pushed(1.0, 0.5, steps=50)
    assert (run.s.shape, run.u.shape, run.material) == ((50, 2), (50, 1), "1.0, 0.5")
    assert np.sign(run.s[1, 1]) == np.sign(run.u[0, 0])


def test_an_episode_that_ends_too_early_says_what_to_do():
    assert len(pushed(1.0, 0.5, steps=20, longest=20)) == 20
    with pytest.raises(
        EpisodeEnded,
        match=r"time limit .* reached after 20 of 30 steps.*max_episode_steps",
    ) as ended:
        pushed(1.0, 0.5, steps=30, longest=20)
    assert len(ended.value.run) == 20, "what was recorded is not lost"


def test_a_robot_that_falls_is_not_one_whose_time_is_up():
    class Falls(gymnasium.Env):
        def reset(self, *, seed=None, options=None):
            return np.zeros(1), {}

        def step(self, action):
            return np.ones(1), 0.0, True, False, {}

    with pytest.raises(
        EpisodeEnded, match="the robot's task was over after 1 of 5 steps"
    ) as ended:
        rollout(Falls(), lambda s: np.zeros(1), 5, material="any")
    assert "max_episode_steps" not in str(ended.value)
    assert len(ended.value.run) == 1


@pytest.mark.slow
def test_p_tells_the_carts_apart(learned):
    model, biases, _ = learned
    found = [
        estimate_bias(model, pushed(*each, steps=100, seed=50 + k), method="newton")[0]
        for k, each in enumerate(PROPERTIES)
    ]
    gaps = np.linalg.norm(
        np.array(found)[:, None] - np.array(list(biases.values())), axis=-1
    )
    assert (gaps.argmin(1) == np.arange(9)).mean() > 0.75


@pytest.mark.slow
@pytest.mark.parametrize("properties", [PROPERTIES[0], PROPERTIES[-1]])
def test_the_controller_brings_the_cart_to_a_place(learned, properties):
    model, biases, _ = learned

    def loss(states, commands, t):
        return (states[:, :, 0] - 0.5).square().mean(1)

    p = biases["{}, {}".format(*properties)]
    controller = Controller(model, loss, p, [-4], [4], ControlSettings(horizon=10))
    run = rollout(
        Cart(*properties),
        controller.act,
        40,
        material="here",
        observe=lambda seen: seen["place"],
    )
    assert abs(run.s[-10:, 0] - 0.5).mean() < 0.1


def test_memory_follows_commands_of_others():
    """Two controllers that can send but one command predict what their memory says."""
    model, predicted = DPMPB(2, 1), []

    def noted(states, commands, t):
        predicted.append(states[0].detach())
        return squares(states, commands, t)

    watching, acting, fresh = (
        Controller(model, noted, [0.1, 0.2], [0.5], [0.5]) for _ in range(3)
    )
    for s in np.eye(2):
        watching.follow(s, acting.act(s))
    acting.follow([0.2, 0.3], [-0.5])
    watching.follow([0.2, 0.3], [-0.5])

    def prediction(controller):
        controller.act([0.0, 1.0])
        return predicted[-1]

    assert torch.allclose(prediction(watching), prediction(acting), atol=1e-6)
    assert not torch.allclose(prediction(fresh), prediction(acting), atol=1e-4)


@pytest.mark.parametrize(
    ("reset", "step", "difference"),
    [
        (
            lambda self, **_: np.zeros(1),
            lambda self, u: (np.zeros(1), 0.0, False, {}),
            "`reset` returns no info",
        ),
        (
            lambda self: np.zeros(1),
            lambda self, u: (np.zeros(1), 0.0, False, {}),
            "`reset`, .*unexpected keyword argument 'seed'",
        ),
        (
            lambda self, **_: (np.zeros(1), {}),
            lambda self, u: (np.zeros(1), 0.0, False, {}),
            "`step` returns 4 values",
        ),
    ],
)
def test_the_older_gym_s_interface_is_named_with_what_to_do(reset, step, difference):
    robot = type("Robot", (), {"reset": reset, "step": step})()
    with pytest.raises(ValueError, match=rf"interface \(.*{difference}\).*: wrap it"):
        rollout(robot, lambda s: np.zeros(1), 5, material="any")


def test_limits_in_degrees_are_noticed():
    model = DPMPB(2, 1)
    model.command_names = ("angle [rad]",)
    model.u_std.fill_(0.5)
    with pytest.warns(UserWarning, match=r"angle \[rad\] reach 180 .*the same unit\?"):
        Controller(model, squares, [0, 0], [-90], [90])


def squares(states, commands, t):
    return states.square().sum((1, 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": [2]}, "a lower limit is above the upper one: .2.., .1.."),
        ({"upper": 1}, "upper is .1. and finite"),
        ({"home": [0, 0]}, "home is .1. and finite"),
        ({"p": [0]}, "p is .2. and finite"),
        (
            {"loss": lambda states, commands, t: states.square().sum()},
            "a loss is .B., one number for each of 1 plans",
        ),
        (
            {"loss": lambda states, commands, t: (0 * states).sum((1, 2)).sqrt()},
            "the gradient of the loss is not finite",
        ),
    ],
)
def test_a_controller_says_what_does_not_fit(change, message):
    arguments = {"loss": squares, "p": [0, 0], "lower": [-1], "upper": [1]} | change
    with pytest.raises(ValueError, match=message):
        Controller(DPMPB(2, 1), **arguments).act([0, 0])


@pytest.mark.slow
def test_the_four_calls_import_nothing_of_cloth():
    code = "import sys; from clothlab.method import control, estimation, rollout, training; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"mujoco", "gymnasium", "cv2", "clothlab.simulation"} & set(loaded)


def test_a_model_comes_back_from_its_file(tmp_path, monkeypatch):
    biases = {
        "light": np.array([0.5, 1.0], np.float32),
        "heavy": np.zeros(2, np.float32),
    }
    model = DPMPB(3, 2).eval()
    trained = Checkpoint(name="toy", model=model, biases=biases)
    trained.save(tmp_path / "weights" / "model-toy.safetensors")
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    read = data.load_model("toy")
    loaded = read.model
    p = read.biases
    assert p.keys() == biases.keys()
    assert np.array_equal(p["light"], biases["light"])
    state = torch.ones(1, 1, 3), torch.ones(1, 1, 2), torch.tensor(p["light"])
    assert torch.allclose(loaded(*state)[0], model(*state)[0], atol=1e-6)
