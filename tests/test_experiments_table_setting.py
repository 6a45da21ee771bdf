"""Setting the table: who spreads the cloth, what is kept of an episode, what the record says, where the border lies."""

import numpy as np
import pytest
import torch

from clothlab import artifacts
from clothlab.experiments import EXPERIMENTS, table_setting
from clothlab.experiments._record import converter
from clothlab.experiments.table_setting import Border, Record, Run, Settings, _Notes, as_run, run_border
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import DPMPB
from clothlab.learning.trained import Trained
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import get_cloth
from clothlab.table_scene.perception import SeenSpread
from clothlab.table_scene.servoing import Mover
from clothlab.table_scene.table_env import Placement, Spread, TableEnv
from clothlab.table_scene.task import PHASES, Outcome
from clothlab.table_scene.throwing import OperatorThrow, ThrowSettings, closed_until, judged
from clothlab.trials import Trial

ARM = get_arm("muscle-hand")
TINY = ThrowSettings(steps=4, release=(1.0, 3.0), attempts=2, rest=1, starts=1, iterations=0)
SETTINGS = Settings(models=(0, 1), episodes=4, throw=TINY, swing=12)
GOOD = Spread(1.0, 1.0, 0.0, np.zeros(3))
STANDS = Placement(1.0, 0.01, True)


def recorded(foam, seed, *, spread=True, steps=6):
    """A throw that nobody made."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(ARM.command_lower, ARM.command_upper, (steps, 4))
    u[:, 3] = closed_until(1.5 + 0.3 * seed, steps)
    images = np.zeros((steps, 96, 128), bool)
    images[:, 30 + seed : 60, 40:90] = True
    trial = Trial(images, rng.normal(size=(steps, 12)), u, get_cloth(foam), "muscle-hand", "operator", seed)
    return judged(trial, spread)


@pytest.fixture
def learned(monkeypatch):
    """Untrained weights, and three throws of which two spread the cloth."""
    torch.manual_seed(0)
    model, autoencoder = DPMPB(15, 4).eval().requires_grad_(False), Autoencoder().eval().requires_grad_(False)
    biases = {"hard-1": np.array([0.5, 0.0], np.float32), "soft-1": np.array([-0.5, 0.0], np.float32)}
    found = Trained("table-0", ARM, autoencoder, model, biases, np.zeros(1), "table")
    throws = [recorded("hard-1", 0), recorded("soft-1", 1), recorded("hard-1", 2, spread=False), recorded("hard-1", 3)]
    monkeypatch.setattr(table_setting, "trained", lambda name: found)
    monkeypatch.setattr(artifacts, "load_trials", lambda name: throws)
    table_setting.good_throws.cache_clear()
    yield found
    table_setting.good_throws.cache_clear()


def outcome(spread=GOOD, stands=STANDS, dragged=0.001, failed="", cause=""):
    seen = SeenSpread(1.0, 1.0, 0.0, True, np.zeros(3)) if spread else None
    return Outcome(failed, cause, True, seen, spread, stands, dragged, 100)


def run(method, model, seed, notes=None, **how):
    return as_run(method, model, seed, outcome(**how), notes or _Notes())


@pytest.fixture
def record():
    """Four episodes, of which each method failed in some."""
    bad = Spread(0.4, 0.5, 3.0, np.zeros(3))
    nothing = {"spread": bad, "stands": None, "dragged": None, "failed": "look", "cause": "it is folded"}
    right, wrong = _Notes("hard-1", (0.5, 0.0), (1.0,), (0.9,)), _Notes("soft-1", (-0.5, 0.0), (1.0, 2.0), (0.9, 1.0))
    dynamic = [run("dynamic", k % 2, k, right if k else wrong, **(nothing if k == 3 else {})) for k in range(4)]
    slow = [run("slow", k % 2, k, **(nothing if k > 1 else {})) for k in range(4)]
    slow[0] = run("slow", 0, 0, stands=Placement(9.0, 0.01, True))
    return Record(Settings(models=(0, 1), episodes=4), (*dynamic, *slow), (), ())


def test_rates_are_of_a_method_s_episodes(record):
    assert record.rate("spread") == 0.75
    assert record.rate("spread", "slow") == 0.5
    assert record.rate("placed", "slow", given="spread") == 0.5
    assert record.rate("success", "slow") == 0.25
    assert np.isnan(record.rate("spread", "best recorded"))


def test_a_difference_has_an_interval_around_it(record):
    mean, low, high = record.difference("dynamic", "slow")
    assert mean == 0.25
    assert low <= mean <= high
    assert record.difference("slow", "dynamic")[0] == -0.25


def test_every_failure_has_phase_and_cause(record):
    assert record.failures("dynamic") == {("look", "it is folded"): 1}
    assert record.failures("slow") == {("look", "it is folded"): 2, ("put basket", "not noticed"): 1}
    assert all(phase in PHASES for method in ("dynamic", "slow") for phase, _ in record.failures(method))
    assert sum(record.failures("slow").values()) == 3  # as many as did not succeed


def test_what_the_robot_took_for_spread_is_a_failure_too():
    mistaken = run("slow", 0, 0, spread=Spread(1.0, 1.0, 180.0, np.zeros(3)))
    assert mistaken.seen
    assert not mistaken.spread
    assert Record(SETTINGS, (mistaken,), (), ()).failures("slow") == {("look", "taken for spread"): 1}


def test_records_survive_being_stored(record):
    border = Border("hard-1", 0.3, np.array([[True], [False]]), *[np.array([True, False])] * 3)
    guess = table_setting.Guess("hard-1", 0, 7, "soft-1", np.array([0.5, 0.25]))
    full = Record(record.settings, record.runs, (guess,), (border,))
    again = converter.structure(converter.unstructure(full), Record)
    assert again.settings == full.settings
    assert again.rate("success") == full.rate("success")
    assert again.runs[3].tilt is None
    assert again.runs[0].bias == pytest.approx([-0.5, 0.0])
    assert again.border[0].slow.tolist() == [[True], [False]]


def test_the_best_recorded_throw_is_one_of_this_foam_that_was_seen_to_succeed(learned, monkeypatch):
    mask = recorded("hard-1", 3).images[0]
    monkeypatch.setattr(table_setting, "target", lambda foam, ahead: mask)
    best = table_setting.best_recorded(SETTINGS, learned)
    assert best == pytest.approx(recorded("hard-1", 3).commands[:4], abs=1e-5)
    with pytest.raises(ValueError, match="no recorded throw spread hard-3"):
        table_setting.best_recorded(Settings(models=(0, 1), episodes=4, throw=TINY, foam="hard-3"), learned)


@pytest.mark.parametrize("method", ["dynamic", "descent"])
def test_the_dynamic_methods_swing_estimate_and_let_go(learned, monkeypatch, method):
    monkeypatch.setattr(table_setting, "target", lambda foam, ahead: recorded("hard-1", 3).images[0])
    env = TableEnv("muscle-hand", start_in="hand")
    notes = table_setting.METHODS[method](SETTINGS, learned, Mover(env, samples=1))
    assert env.held == ()
    assert notes.foam in learned.biases
    assert len(notes.expected) == len(notes.before_release) == 1
    env.close()


def test_the_border_is_tried_with_every_margin_and_every_throw():
    settings = Settings(models=(0,), episodes=1, margins=(0.17, 0.30), border_throws=2, choosing=1, judging=2)
    close, away = (run_border(settings, "hard-1", near) for near in (0.15, 0.8))
    assert close.slow.tolist() == [[True], [False]]
    assert close.best_slow.tolist() == [True, True]  # of the better margin
    assert not away.slow.any()
    assert not away.best_slow.any()
    assert close.thrown.shape == (2,)
    assert away.thrown.tolist() == [False, False]  # nobody throws so far
    assert away.best_thrown.tolist() == [False, False]


def test_a_throw_that_worked_is_judged_from_other_starts(monkeypatch):
    tried = []

    class Lucky(OperatorThrow):
        def reset(self, seed=None):
            super().reset(seed)
            tried.extend([] if seed is None else [seed])

    monkeypatch.setattr(table_setting, "OperatorThrow", Lucky)
    first = 0  # of its throws, some work from the first start on a table so near
    settings = Settings(
        models=(0,), episodes=1, margins=(0.02,), border_throws=4, choosing=2, judging=3, first_seed=first
    )
    found = run_border(settings, "hard-3", 0.30)
    worked = np.flatnonzero(found.thrown)
    assert len(worked) > 0
    assert found.best_thrown.shape == (3,)
    assert tried[:4] == [first, first + 1, first + 2, first + 3]
    assert tried[4 : 4 + 2 * len(worked)] == [first + number for number in worked for _ in range(2)]
    assert len(set(tried[-3:])) == 1


@pytest.mark.parametrize(("worked", "best"), [([0, 2, 1], 1), ([2, 2, 2, 0], 1), ([0, 0], 1), ([1], 0)])
def test_of_the_best_the_middle_one_is_taken(worked, best):
    assert table_setting.middle_of_best(np.array([[k > 0, k > 1] for k in worked])) == best


def test_a_foam_is_guessed_from_one_swing(learned):
    guess = table_setting.run_guess(SETTINGS, "hard-3", 0, 5)
    assert (guess.foam, guess.model, guess.seed) == ("hard-3", 0, 5)
    assert guess.nearest in learned.biases
    assert np.isfinite(guess.bias).all()


def test_everything_is_run_and_kept(learned, monkeypatch, tmp_path):
    done = []

    def one(settings, method, model, seed):
        done.append((method, model, seed))
        return run(method, model, seed)

    monkeypatch.setattr(table_setting, "run_one", one)
    guess = lambda settings, foam, model, seed: table_setting.Guess(foam, model, seed, foam, np.zeros(2))  # noqa: E731
    monkeypatch.setattr(table_setting, "run_guess", guess)
    empty = Border("hard-1", 0.3, np.zeros((0, 0), bool), *[np.zeros(0, bool)] * 3)
    monkeypatch.setattr(table_setting, "run_border", lambda settings, foam, near: empty)
    monkeypatch.setattr(table_setting, "run_jobs", lambda function, jobs, **how: [function(*job) for job in jobs])
    first, again = (table_setting.run(SETTINGS, folder=tmp_path) for _ in range(2))
    assert len(done) == len(set(done)) == 16  # once
    assert {model for _, model, _ in done} == {0, 1}
    assert [each.seed for each in first.select("slow")] == [500_000, 500_001, 500_002, 500_003]
    assert first.rate("success") == again.rate("success") == 1
    assert isinstance(again.runs[0], Run)
    assert len(again.guesses) == len({(each.foam, each.model, each.seed) for each in again.guesses}) == 4 * 2 * 5


def test_settings_that_run_nothing_are_refused():
    with pytest.raises(KeyError, match="unknown method 'magic'; choose from dynamic, descent, slow, best recorded"):
        Settings(methods=("magic",))
    with pytest.raises(ValueError, match="episodes must be a multiple of the 5 models, got 7"):
        Settings(episodes=7)


def test_it_is_found_under_its_name():
    assert EXPERIMENTS["table_setting"] is table_setting
