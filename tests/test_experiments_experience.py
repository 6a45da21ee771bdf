"""How much experience: the right amount is learned from, once, and what was learned is measured."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from clothlab import artifacts, experiments
from clothlab.experiments import experience, perception
from clothlab.experiments.experience import Control, Record, Run, Seen, Settings
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.dpmpb import DPMPB, TrainingTrace
from clothlab.policies import RandomPolicy
from clothlab.trials import save_trial

TINY = Settings(
    arms=("torque",),
    amounts=(1.0, 0.5),
    models=(3,),
    autoencoder_updates=4,
    model_updates=3,
    seen_steps=6,
    estimation_steps=12,
    methods=("paper's control",),
    control_steps=16,
)
ONE_CLOTH = replace(experience.ARMS["torque"], cloths=("damp0.07-mass0.05",))


@pytest.fixture(scope="module")
def cut():
    """Loads the first steps of some of the recorded trials; of those beyond the paper's amount there are none."""
    names = ("train", "evaluation", "muscle-train", "muscle-evaluation")
    whole = {name: artifacts.load_trials(name)[2::5] for name in names}
    return lambda name, first=None: [trial[: 64 if "train" in name else 14] for trial in whole[name][:first]]


@pytest.fixture
def short(cut, monkeypatch):
    monkeypatch.setattr(artifacts, "load_trials", cut)
    return cut


@pytest.fixture(scope="module")
def kept(cut, tmp_path_factory):
    """A folder with a tiny run, and its record."""
    folder = tmp_path_factory.mktemp("kept") / "experience"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(artifacts, "load_trials", cut)
        patch.setitem(experience.ARMS, "torque", ONE_CLOTH)
        return folder, experience.run(TINY, folder=folder)


@pytest.fixture
def counted(monkeypatch, short):
    """Trainings that learn nothing, measurements that measure nothing: what was called, in its order."""
    calls = []

    def autoencoder(images, settings, *, seed, progress):
        calls.append(("autoencoder", len(images), settings.epochs, settings.batch_size))
        torch.manual_seed(len(images))
        return Autoencoder().eval(), [0.0]

    def model(runs, settings, *, seed, progress):
        calls.append(("model", sum(map(len, runs)), settings.epochs, settings.sequence_length))
        biases = {run.material: np.arange(2.0) + k for k, run in enumerate(runs)}
        network = DPMPB(runs[0].s.shape[1], runs[0].u.shape[1])
        return network, biases, TrainingTrace(np.zeros(1), {})

    def look(settings, autoencoder):
        chamfer = (perception.Chamfer("target", 0.25, np.zeros(1), np.zeros(1)),)
        return perception.Record(settings, 0.5, 0.5, 0.0, chamfer)

    def measured(settings, seen, learned, seed, updates):
        calls.append(("measured", seen.steps, seed))
        return Run(seen.arm, seen.amount, seed, updates, 0.0, np.zeros(2), None, 1.0, 0.0, ())

    monkeypatch.setattr(experience, "train_autoencoder", autoencoder)
    monkeypatch.setattr(experience, "train_dpmpb", model)
    monkeypatch.setattr(experience, "_measured", measured)
    monkeypatch.setattr(perception, "look", look)
    return calls


def kinds(calls):
    return [call[0] for call in calls]


def test_every_amount_is_trained_on_and_measured(kept, short):
    _, record = kept
    paper = short("train")
    assert record.steps("torque") == {0.5: 32 * len(paper), 1.0: 64 * len(paper)}
    assert [(run.amount, run.model) for run in record.runs] == [(0.5, 3), (1.0, 3)]
    assert record.seen[0].recordings != record.seen[1].recordings
    for seen, run in zip(record.seen, record.runs, strict=True):
        assert seen.updates == 4
        assert run.updates == 3
        assert 0 <= seen.iou <= 1
        assert -1 <= seen.correlation <= 1
        assert run.prediction > 0
        assert run.r2.shape == (2,)
        assert (run.r2 <= 1).all()
        assert run.nearest in np.arange(5) / 4  # of four cloths
        (control,) = run.control
        assert control.best == control.last > 0  # one period is left of two
        assert control.random > 0


def test_the_record_survives_the_round_trip(kept, tmp_path):
    _, record = kept
    experiments.save("experience", record, data=tmp_path)
    read = experiments.load("experience", data=tmp_path)
    assert read.settings == TINY
    assert read.runs[1].control == record.runs[1].control
    assert {name: arms["torque"].tolist() for name, arms in read.curves().items()} == {
        name: arms["torque"].tolist() for name, arms in record.curves().items()
    }


def test_what_is_measured_is_what_the_kept_weights_do(kept, short):
    folder, record = kept
    learned = artifacts.load("torque-x0_5-3", data=folder)
    assert learned.autoencoder_name == "torque-x0_5"
    assert experience._prediction(learned) == pytest.approx(record.runs[0].prediction)
    biases = {name: p + 1 for name, p in learned.biases.items()}
    assert experience._prediction(replace(learned, biases=biases)) != pytest.approx(record.runs[0].prediction)


def test_a_second_run_trains_and_measures_nothing(kept, counted):
    folder, record = kept
    again = experience.run(TINY, folder=folder)
    assert counted == []
    assert again.runs[1].prediction == record.runs[1].prediction
    assert again.seen == record.seen


def test_only_what_a_setting_touches_is_done_again(counted, tmp_path):
    experience.run(TINY, folder=tmp_path / "before")
    assert sorted(kinds(counted)) == ["autoencoder"] * 2 + ["measured"] * 2 + ["model"] * 2
    for k, (change, again) in enumerate(
        (
            ({"amounts": (1.0,)}, []),
            ({"seen_steps": 7}, []),
            ({"control_steps": 24}, ["measured"] * 2),
            ({"models": (3, 4)}, ["model", "measured"] * 2),
            ({"model_updates": 5}, ["model", "measured"] * 2),
            ({"autoencoder_updates": 8}, ["autoencoder"] * 2),  # the same z, as it happens here: the models are good
        )
    ):
        counted.clear()
        experience.run(replace(TINY, **change), folder=shutil.copytree(tmp_path / "before", tmp_path / str(k)))
        assert sorted(kinds(counted)) == sorted(again), change


def test_other_recordings_are_learned_from_anew(counted, short, monkeypatch, tmp_path):
    experience.run(TINY, folder=tmp_path)
    counted.clear()
    monkeypatch.setattr(artifacts, "load_trials", lambda name, first=None: [trial[1:] for trial in short(name)])
    experience.run(replace(TINY, amounts=(1.0,)), folder=tmp_path)
    assert kinds(counted) == ["autoencoder", "model", "measured"]


def test_an_interrupted_run_goes_on_where_it_stopped(counted, monkeypatch, tmp_path):
    train, left = experience.train_dpmpb, iter([True])

    def interrupted(*args, **options):
        if not next(left, False):
            raise KeyboardInterrupt
        return train(*args, **options)

    monkeypatch.setattr(experience, "train_dpmpb", interrupted)
    with pytest.raises(KeyboardInterrupt):
        experience.run(TINY, folder=tmp_path)
    counted.clear()
    monkeypatch.setattr(experience, "train_dpmpb", train)
    experience.run(TINY, folder=tmp_path)
    assert kinds(counted) == ["model", "measured"]


@pytest.mark.parametrize(("arm", "length", "sequences"), [("torque", 30, (7, 1)), ("muscle", 20, (9, 3))])
def test_whatever_the_amount_the_updates_are_the_same(counted, short, tmp_path, arm, length, sequences):
    settings = replace(TINY, arms=(arm,), autoencoder_updates=240, model_updates=17)
    record = experience.run(settings, folder=tmp_path)
    trials = len(short(experience.ARMS[arm].trials))
    for amount, count in zip((1.0, 0.5), sequences, strict=True):
        images = round(64 * amount) * trials
        assert trials * count <= 300  # one batch: an update is an epoch
        assert ("autoencoder", images, 240 // (images // 64), 64) in counted
        assert ("model", images, 17, length) in counted
    assert {run.updates for run in record.runs} == {17}
    assert {seen.updates for seen in record.seen} == {240}


def test_more_is_whole_repeats_and_less_is_the_first_part(tmp_path, monkeypatch, trial):
    monkeypatch.setenv("CLOTHLAB_DATA", str(tmp_path))
    for k, name in enumerate(("train/a", "train/b", "train-more/00_a", "train-more/00_b", "train-more/01_a")):
        save_trial(replace(trial, seed=k, policy=name[-1]), tmp_path / "trials" / f"{name}.npz")
    seeds = lambda amount: [each.seed for each in experience.learned_from("torque", amount)]  # noqa: E731
    assert (seeds(1.0), seeds(2.0)) == ([0, 1], [0, 1, 2, 3])
    half = experience.learned_from("torque", 0.25)
    assert [each.seed for each in half] == [0, 1]
    assert all(np.array_equal(each.commands, trial.commands[:3]) for each in half)
    with pytest.raises(FileNotFoundError, match=r"2 repeats of train in data/trials/train-more, 4 trials, and 3 of"):
        seeds(3.0)
    (tmp_path / "trials" / "train-more" / "00_b.npz").unlink()
    with pytest.raises(FileNotFoundError, match="record them with `make data`"):  # as many, but no whole repeat
        seeds(2.0)


def test_missing_recordings_are_noticed_before_anything_is_trained(counted, short, monkeypatch, tmp_path):
    def load(name, first=None):
        if name.endswith("-more"):
            raise KeyError("unknown trials")
        return short(name)

    monkeypatch.setattr(artifacts, "load_trials", load)
    with pytest.raises(FileNotFoundError, match=r"2 times the paper's recordings need 1 repeats .* `make data`"):
        experience.run(replace(TINY, amounts=(1.0, 2.0)), folder=tmp_path)
    assert counted == []


@pytest.mark.parametrize("what", ["images", "robot", "commands", "cloth", "order"])
def test_a_fingerprint_knows_what_was_recorded(trial, muscle_trial, what):
    recorded = [trial, trial[:5]]
    other = {
        "images": lambda: [replace(trial, images=~trial.images), trial[:5]],
        "robot": lambda: [replace(trial, robot=trial.robot + 1e-9), trial[:5]],
        "commands": lambda: [replace(trial, commands=trial.commands[::-1]), trial[:5]],
        "cloth": lambda: [replace(trial, cloth=muscle_trial.cloth), trial[:5]],
        "order": lambda: recorded[::-1],
    }[what]()
    assert experience.fingerprint(recorded) == experience.fingerprint([trial[:], trial[:5]])
    assert experience.fingerprint(recorded) != experience.fingerprint(other)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"arms": ("leg",)}, KeyError, "unknown arm 'leg'; choose from torque, muscle"),
        ({"methods": ("magic",)}, KeyError, "unknown method of control 'magic'; choose from paper's control"),
        ({"amounts": (2.5,)}, ValueError, "parts of the paper's recordings or whole repeats, got 2.5"),
        ({"amounts": (0.0,)}, ValueError, "Settings.amounts must be above 0"),
        ({"amounts": ()}, ValueError, "Settings.amounts needs an entry at least"),
        ({"models": ()}, ValueError, "Settings.models needs an entry at least"),
        ({"model_updates": 0}, ValueError, "Settings.model_updates must be at least 1"),
        ({"control_steps": 15}, ValueError, "Settings.control_steps must be at least 16"),
    ],
)
def test_settings_that_cannot_be_are_refused(change, error, message):
    with pytest.raises(error, match=message):
        Settings(**change)


def test_another_method_joins_in_one_line(kept, monkeypatch):
    folder, _ = kept
    seen = []

    def practice(learned, target, cloth):
        seen.append((learned.name, target.any(), cloth))
        return RandomPolicy(learned.arm)

    monkeypatch.setitem(experience.METHODS, "practice", practice)
    monkeypatch.setitem(experience.ARMS, "torque", ONE_CLOTH)
    settings = replace(TINY, methods=("practice",), random_seed=0)
    learned = artifacts.load("torque-x1-3", data=folder)
    (control,) = experience._controlled(settings, learned, 5)
    assert seen == [("torque-x1-3", True, "damp0.07-mass0.05")]
    assert control.ratio == pytest.approx(1)  # the same random commands as beside it


def test_methods_differ_in_their_starts(kept, square):
    folder, _ = kept
    learned = artifacts.load("torque-x1-3", data=folder)
    starts = [method(learned, square, "damp0.07-mass0.05")._plans for method in experience.METHODS.values()]
    assert [len(each) for each in starts[:2]] == [0, 200]


def test_foams_have_no_materials_to_read_off(kept, monkeypatch, tmp_path):
    folder, record = kept
    monkeypatch.setattr(experience, "_estimated", lambda *_: (0.5, 0.25))
    monkeypatch.setattr(experience, "_prediction", lambda _: 0.125)
    monkeypatch.setattr(experience, "_controlled", lambda *_: record.runs[0].control)
    learned = artifacts.load("torque-x1-3", data=folder)
    foams = replace(learned, biases=dict(zip(("soft-1", "hard-1"), learned.biases.values(), strict=False)))
    run = experience._measured(TINY, record.seen[1], foams, 3, 9)
    assert (run.r2.tolist(), run.ratio_r2) == ([], None)
    assert (run.nearest, run.distance, run.prediction, run.updates) == (0.5, 0.25, 0.125, 9)
    experiments.save("experience", replace(record, runs=(run,)), data=tmp_path)
    (read,) = experiments.load("experience", data=tmp_path).runs
    assert (read.r2.tolist(), read.ratio_r2) == ([], None)


def test_curves_leave_out_what_has_no_meaning_for_an_arm():
    def run(arm, amount, model):
        pair = np.array([0.5, 0.25 * amount]) if arm == "torque" else np.empty(0)
        control = (
            Control("m", "a", 1.0, 0.5 * amount, 1.0),
            Control("m", "b", 1.0, 0.5, 2.0),
            Control("n", "a", 1, 1, 1),
        )
        return Run(arm, amount, model, 9, 10 * amount + model, pair, 0.9 if len(pair) else None, 1.0, 0.1, control)

    settings = Settings(amounts=(1.0, 2.0), models=(0, 1))
    object.__setattr__(settings, "methods", ("m",))
    seen = tuple(Seen(arm, a, 100 * a, "", 9, 0.8, 0.7) for arm in settings.arms for a in settings.amounts)
    runs = tuple(run(arm, a, k) for arm in settings.arms for a in settings.amounts for k in settings.models)
    curves = Record(settings, seen, runs).curves()
    assert curves["prediction error [s.d.²]"]["muscle"].tolist() == [[10, 11], [20, 21]]
    assert curves["R² of log C_mass"]["torque"].tolist() == [[0.25, 0.25], [0.5, 0.5]]
    assert set(curves["R² of log C_mass"]) == set(curves["R² of log (C_damp / C_mass)"]) == {"torque"}
    (control,) = (arms for name, arms in curves.items() if name.endswith("\nm"))
    assert control["muscle"].tolist() == [[0.375, 0.375], [0.625, 0.625]]
    assert curves["IoU of reconstructions"]["torque"].shape == (2, 1)
