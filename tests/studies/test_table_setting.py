"""Setting the table: how the cloth is spread, columns of an episode, rows of the
results, where the border is.
"""

import numpy as np
import pytest
import torch

from clothlab import data
from clothlab.method.autoencoder import Autoencoder
from clothlab.method.model import DPMPB
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.trials import Trial
from clothlab.weights import ClothCheckpoint
from studies import get, table_setting
from studies.table_scene import task
from studies.table_scene.servoing import RobotDriver
from studies.table_scene.table_env import ClothPose, Placement, TableEnv
from studies.table_scene.task import Outcome
from studies.table_scene.throwing import ThrowSettings, label_spread
from studies.table_setting import middle_of_best

ARM = get_arm("muscle-hand")
EXPERIMENT = get("table_setting")
GOOD = Outcome("", "", True, ClothPose(1.0, 1.0, 0.0, np.zeros(3)), ClothPose(1.0, 1.0049, 0.02, np.zeros(3)),
               Placement(1.234, 0.01, True), 0.001, 100)  # fmt: skip
FOLDED = Outcome(
    "look",
    "it is folded",
    True,
    None,
    ClothPose(0.4, 0.5, 3.0, np.zeros(3)),
    None,
    None,
    90,
)


def recorded(foam, seed, *, spread=True, steps=18):
    """A throw that only has to be of the right sizes."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(ARM.command_lower, ARM.command_upper, (steps, 4))
    u[:, 3] = np.clip(2.5 + 0.3 * seed - np.arange(steps), 0, 1)
    images = np.zeros((steps, 96, 128), bool)
    images[:, 30 + seed : 60, 40:90] = True
    trial = Trial(
        images,
        rng.normal(size=(steps, 12)),
        u,
        get_cloth(foam),
        "muscle-hand",
        "operator",
        seed,
    )
    return label_spread(trial, spread)


@pytest.fixture
def learned(monkeypatch):
    """Untrained weights, and four throws of which three spread the cloth."""
    torch.manual_seed(0)
    model, autoencoder = (
        DPMPB(15, 4).eval().requires_grad_(False),
        Autoencoder().eval().requires_grad_(False),
    )
    biases = {
        "hard-1": np.array([0.5, 0.0], np.float32),
        "soft-1": np.array([-0.5, 0.0], np.float32),
    }
    found = ClothCheckpoint(
        name="table-0",
        arm=ARM,
        autoencoder=autoencoder,
        model=model,
        biases=biases,
        autoencoder_name="table",
    )
    throws = [
        recorded("hard-1", 0),
        recorded("soft-1", 1),
        recorded("hard-1", 2, spread=False),
        recorded("hard-1", 3),
    ]
    monkeypatch.setattr(table_setting, "trained", lambda name: found)
    monkeypatch.setattr(data, "load_trials", lambda name: throws)
    for module in (task, table_setting):
        monkeypatch.setattr(
            module,
            "spread_target",
            lambda foam="hard-1": recorded("hard-1", 3).images[0],
        )
    return found


@pytest.mark.parametrize("outcome", [GOOD, FOLDED], ids=["good", "folded"])
def test_an_episode_is_a_row(learned, monkeypatch, outcome):
    monkeypatch.setattr(table_setting, "run_task", lambda spreader, seed: outcome)
    row = EXPERIMENT.run_one("slow", 0, 500_000)
    assert (row["failed"], row["spread"], row["placed"]) == (
        outcome.failed,
        outcome is GOOD,
        outcome is GOOD,
    )
    assert (row["area"], row["angle"], row["tilt"]) == (
        (1.005, 0.0, 1.23) if outcome is GOOD else (0.5, 3.0, None)
    )
    with pytest.raises(
        KeyError,
        match="unknown method 'magic'; choose from dynamic, slow, best recorded",
    ):
        EXPERIMENT.run_one("magic", 0, 0)


def test_the_best_recorded_throw_is_one_of_this_foam_that_was_seen_to_succeed(learned):
    best = table_setting._commands_of_best(learned, "hard-1")
    assert best == pytest.approx(recorded("hard-1", 3).commands[:16], abs=1e-5)


@pytest.mark.slow
def test_the_dynamic_method_excites_estimates_and_lets_go(learned, monkeypatch):
    tiny = ThrowSettings(steps=4, release=(1.0, 3.0), attempts=2, rest=1)
    monkeypatch.setattr(
        table_setting,
        "excite_and_throw",
        lambda *given: task.excite_and_throw(*given, tiny),
    )
    env = TableEnv("muscle-hand", start_in="hand")
    notes = table_setting._METHODS["dynamic"](learned, RobotDriver(env, samples=1))
    env.close()
    assert env.held == ()
    assert notes["foam"] in learned.biases
    assert len(notes["expected"]) == len(notes["before_release"]) > 0


@pytest.mark.slow
def test_the_border_is_tried_with_every_margin_and_every_throw(monkeypatch):
    for name, value in {
        "MARGINS": (0.17, 0.30),
        "_BORDER_THROWS": 2,
        "_CHOOSING": 1,
        "_JUDGING": 2,
    }.items():
        monkeypatch.setattr(table_setting, name, value)
    close, far = (
        get("table_setting_border").run_one("hard-1", near) for near in (0.15, 0.8)
    )
    assert close["slow"].tolist() == [[True], [False]]
    assert close["best_slow"].tolist() == [True, True]  # of the better margin
    assert not far["slow"].any()
    assert not far["best_slow"].any()
    assert far["thrown"].tolist() == far["best_thrown"].tolist() == [False, False]


@pytest.mark.parametrize(
    ("worked", "best"), [([0, 2, 1], 1), ([2, 2, 2, 0], 1), ([1], 0)]
)
def test_of_the_best_the_middle_one_is_taken(worked, best):
    assert middle_of_best(np.array([[k > 0, k > 1] for k in worked])) == best
