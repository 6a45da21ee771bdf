"""Training as people expect it: held-out runs, a file to go on from, data on the disk."""

import pickle
import sys
import warnings
from dataclasses import replace
from functools import partial

import large_runs
import numpy as np
import pytest
import torch
from own_network import Gru, Residual, record

from clothlab import ModelTraining, Run, train_dpmpb
from clothlab.method import _on_disk
from clothlab.method._batches import Windows
from clothlab.method._on_disk import is_on_disk
from clothlab.method.data import materials_of, set_normalisation, windows
from clothlab.method.model import DPMPB
from clothlab.method.several import train_several
from clothlab.method.training_options import TrainingOptions

BRIEF = ModelTraining(epochs=6, batch_size=30, sequence_length=12, bias_size=1)
RUNS = [record(stiffness, k, 120) for k, stiffness in enumerate((0.05, 0.4))]
OTHERS = [record(stiffness, k + 9, 80) for k, stiffness in enumerate((0.05, 0.4))]


def taught(settings=BRIEF, runs=RUNS, **options):
    options = {"model": Residual, "device": "cpu", "progress": False} | options
    return train_dpmpb(runs, settings, **options)


def same(one, other):
    """Whether two trainings ended with the same weights, p, and notes, bit for bit."""
    model, biases, trace = one
    again, found, noted = other
    for name, weights in model.state_dict().items():
        if not torch.equal(weights, again.state_dict()[name]):
            return False
    return (
        all(np.array_equal(p, found[name]) for name, p in biases.items())
        and np.array_equal(trace.losses, noted.losses)
        and np.array_equal(trace.held_out, noted.held_out, equal_nan=True)
        and np.array_equal(trace.ahead, noted.ahead)
        and trace.epoch == noted.epoch
    )


@pytest.fixture
def on_disk(tmp_path):
    """The same runs, mapped from files; of the second a stretch in the middle."""
    made = []
    for k, run in enumerate(RUNS):
        for name, array in (("s", run.s), ("u", run.u)):
            np.save(tmp_path / f"{name}{k}.npy", array)
        mapped = (np.load(tmp_path / f"{name}{k}.npy", "r") for name in "su")
        made.append(Run(*mapped, run.material))
    return [made[0], made[1][7:]]


def test_windows_by_their_number_are_the_copies():
    runs = [*RUNS, OTHERS[0], RUNS[1][:17]]
    for length, stride in ((12, 5), (16, 1), (7, 20)):
        copies = windows(runs, length, stride)
        numbered = Windows(runs, materials_of(runs), length, stride)
        assert len(numbered) == len(copies[0])
        index = torch.randperm(len(numbered))
        for copied, gathered in zip(copies, numbered[index], strict=True):
            assert torch.equal(copied[index], gathered)


def test_runs_on_the_disk_stay_there_and_teach_the_same(on_disk, monkeypatch):
    assert all(is_on_disk(run.s) and is_on_disk(run.u) for run in on_disk)
    in_memory = [RUNS[0], RUNS[1][7:]]
    assert not any(is_on_disk(run.s) for run in in_memory)
    numbered = [
        Windows(runs, materials_of(runs), 12, 5)[torch.arange(30)]
        for runs in (in_memory, on_disk)
    ]
    for one, other in zip(*numbered, strict=True):
        assert torch.equal(one, other)

    # Their normalisation comes from blocks, each joined to those before
    monkeypatch.setattr(_on_disk, "_BLOCK", 200)
    models = [DPMPB(2, 1), DPMPB(2, 1)]
    for model, runs in zip(models, (in_memory, on_disk), strict=True):
        set_normalisation(model, runs)
    for name in ("s_mean", "s_std", "u_mean", "u_std"):
        one, other = (getattr(model, name) for model in models)
        assert torch.allclose(one, other, rtol=1e-5, atol=1e-6)
    losses = [taught(runs=runs)[2].losses for runs in (in_memory, on_disk)]
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)


def test_another_process_is_told_where_runs_on_the_disk_lie(on_disk):
    for run in on_disk:
        sent = pickle.dumps(run)
        assert len(sent) < run.s.nbytes / 2
        taken = pickle.loads(sent)
        assert is_on_disk(taken.s)
        assert np.array_equal(taken.s, run.s)
        assert np.array_equal(taken.u, run.u)
        assert taken.material == run.material
    copied = pickle.loads(pickle.dumps(RUNS[0]))
    assert np.array_equal(copied.s, RUNS[0].s)


def test_what_is_mapped_otherwise_is_copied_and_numbers_are_looked_at(tmp_path):
    s = np.zeros((50, 2), np.float32)
    s[:, 0] = np.arange(50)
    np.save(tmp_path / "s.npy", s)
    np.save(tmp_path / "double.npy", s.astype(float))
    changed = np.load(tmp_path / "s.npy", "c")  # of which the file knows nothing
    changed[3] = 7
    for mapped in (changed, np.load(tmp_path / "double.npy", "r")):
        run = Run(mapped, s, "a")
        assert not is_on_disk(run.s)
        assert np.array_equal(run.s, mapped)

    s[40] = np.nan
    np.save(tmp_path / "s.npy", s)
    with pytest.raises(ValueError, match=r"s of a run of a is nan in step 40"):
        Run(np.load(tmp_path / "s.npy", "r"), np.zeros((50, 1)), "a")


def test_a_burn_in_is_not_in_the_loss():
    class Noted(Gru):
        def loss(self, predicted, s):
            seen.append(predicted.shape[1])
            return super().loss(predicted, s)

    seen = []
    taught(replace(BRIEF, epochs=1, burn_in=5), model=Noted)
    assert set(seen) == {7}
    with pytest.raises(
        ValueError, match=r"burn_in must be below the 12 steps of sequence_length"
    ):
        replace(BRIEF, burn_in=12)
    assert len(taught(replace(BRIEF, burn_in=5), options=held())[2].ahead) == 7


def held(**options):
    return TrainingOptions(held_out=OTHERS, **options)


def test_looking_at_held_out_runs_changes_nothing_that_is_learned():
    plain = taught()
    watched = taught(options=held(every=2))
    assert np.array_equal(plain[2].losses, watched[2].losses)
    assert np.array_equal(plain[1]["0.4"], watched[1]["0.4"])
    assert np.isnan(plain[2].held_out).all()
    assert np.isnan(watched[2].held_out[::2]).all()
    assert (watched[2].held_out[1::2] > 0).all()
    assert plain[2].ahead.size == 0


def test_held_out_errors_are_those_of_predictions():
    model, biases, trace = taught(options=held())
    one_step = []
    first = []
    for run in OTHERS:
        p = torch.tensor(biases[run.material])
        s, u, _ = windows([run], 12, 12)
        with torch.no_grad():
            predicted, _ = model(s[:, :-1], u, p)
        squares = ((predicted - s[:, 1:]) / model.s_std).square()
        one_step.append(squares.mean().item())
        first.append(squares[:, 0].mean().item())
    assert trace.held_out[-1] == pytest.approx(np.mean(one_step), rel=1e-4)
    # One step ahead, a prediction has come back from nowhere yet
    assert trace.ahead[0] == pytest.approx(np.mean(first), rel=1e-4)
    assert len(trace.ahead) == 12
    assert trace.epoch == BRIEF.epochs


def test_the_best_epoch_is_kept():
    # Of noise there is nothing to learn, only to learn by heart
    rng = np.random.default_rng(0)
    noise = [
        Run(rng.normal(size=(40, 2)), rng.normal(size=(40, 1)), name)
        for name in ("a", "b", "a", "b")
    ]
    long = replace(BRIEF, epochs=12, learning_rate=0.03)
    options = TrainingOptions(held_out=noise[2:])
    taught_noise = partial(taught, long, noise[:2], model=Gru)
    last = taught_noise(options=options)
    best = taught_noise(options=replace(options, keep_best=True))
    assert np.array_equal(last[2].held_out, best[2].held_out)
    assert best[2].epoch == np.argmin(best[2].held_out) + 1 < 12

    def stop(epoch):
        return epoch.number == best[2].epoch

    stopped = taught_noise(options=replace(options, callback=stop))
    assert len(stopped[2].losses) == best[2].epoch
    for name, weights in stopped[0].state_dict().items():
        assert torch.equal(weights, best[0].state_dict()[name])
    assert np.array_equal(stopped[1]["b"], best[1]["b"])
    assert np.array_equal(stopped[2].ahead, best[2].ahead)


def test_a_callback_hears_of_each_epoch():
    heard = []
    _, biases, trace = taught(options=held(every=3, callback=heard.append))
    assert [each.number for each in heard] == [1, 2, 3, 4, 5, 6]
    assert [each.loss for each in heard] == trace.losses.tolist()
    assert [each.held_out is None for each in heard] == [True, True, False] * 2
    assert np.array_equal(heard[-1].biases["0.4"], biases["0.4"])


@pytest.mark.parametrize("network", [DPMPB, Gru])
def test_a_training_that_was_interrupted_ends_as_if_it_was_not(tmp_path, network):
    path = tmp_path / "kept.safetensors"
    settings = replace(BRIEF, epochs=4)
    whole = taught(settings, model=network, options=held(keep_best=True))

    def interrupt(epoch):
        if epoch.number == 3:
            raise KeyboardInterrupt

    kept = held(keep_best=True, checkpoint=path, resume=True)
    with pytest.raises(KeyboardInterrupt) as error:
        taught(settings, model=network, options=replace(kept, callback=interrupt))
    assert "kept.safetensors holds the training so far" in error.value.__notes__[0]

    # The third epoch was not over, and is gone through again
    numbers = []
    options = replace(kept, callback=lambda epoch: numbers.append(epoch.number))
    torch.rand(7)  # the caller's random numbers don't matter
    assert same(whole, taught(settings, model=network, options=options))
    assert numbers == [3, 4]

    # Once it is over, nothing is left to do
    assert same(whole, taught(settings, model=network, options=options))
    assert numbers == [3, 4]


def test_a_checkpoint_is_written_now_and_then_and_after_an_early_end(tmp_path):
    path = tmp_path / "kept.safetensors"

    def fail(epoch):
        if epoch.number == 5:
            raise RuntimeError("no room on the disk")

    often = TrainingOptions(checkpoint=path, checkpoint_every=2, resume=True)
    with pytest.raises(RuntimeError, match="no room"):
        taught(options=replace(often, callback=fail))
    numbers = []
    ended = taught(
        options=replace(
            often,
            callback=lambda epoch: numbers.append(epoch.number) or epoch.number > 4,
        )
    )
    assert numbers == [5]
    assert same(ended, taught(options=often))
    path.unlink()
    assert np.array_equal(taught()[2].losses[:5], ended[2].losses)


def test_a_file_of_another_training_is_not_gone_on_with(tmp_path):
    path = tmp_path / "kept.safetensors"
    options = TrainingOptions(checkpoint=path)
    taught(options=options)
    with pytest.raises(ValueError, match="exists: resume=True goes on from it"):
        taught(options=options)
    resume = replace(options, resume=True)
    for change, message in (
        ({"settings": replace(BRIEF, epochs=9)}, "with other epochs: 6, here 9"),
        ({"seed": 4}, "with other seed: 0, here 4"),
        ({"model": Gru}, "with other network: Residual, here Gru"),
        ({"runs": [RUNS[0][3:], RUNS[1]]}, "on other runs: their s_mean differs"),
        ({"known": {"0.05": [0], "0.4": [1]}}, "with other known: False, here True"),
    ):
        with pytest.raises(ValueError, match=message):
            taught(**{"options": resume, **change})
    path.write_bytes(b"nonsense")
    with pytest.raises(ValueError, match="damaged or holds no state of a training"):
        taught(options=resume)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"keep_best": True}, "keep_best needs runs in held_out"),
        ({"resume": True}, "resume needs a checkpoint"),
        ({"checkpoint": "a.pt"}, r"ends in .safetensors, got 'a.pt'"),
        ({"callback": 3}, "a callback is called with an Epoch"),
        ({"held_out": RUNS[0]}, "runs are a list of Run, got Run"),
        ({"every": 0}, "every must be at least 1"),
    ],
)
def test_options_say_what_does_not_fit(options, message):
    with pytest.raises(ValueError, match=message):
        TrainingOptions(**options)


def test_held_out_runs_are_of_trained_materials_and_of_the_same_robot():
    for runs, kind, message in (
        (
            [Run(RUNS[0].s, RUNS[0].u, "new")],
            KeyError,
            "of a held-out run 'new'; choose",
        ),
        ([Run(RUNS[0].s, RUNS[0].s, "0.4")], ValueError, "of the same sizes"),
        (
            [OTHERS[0][:9]],
            ValueError,
            "more steps than the 12 of a sequence, and one of ",
        ),
    ):
        with pytest.raises(kind, match=message):
            taught(options=TrainingOptions(held_out=runs))


def test_what_cannot_be_sent_to_other_processes_is_refused():
    with pytest.raises(ValueError, match="write it into a file of its own"):
        train_several(RUNS, [0], BRIEF, model=lambda *sizes: Residual(*sizes))
    with pytest.raises(ValueError, match="workers must be at least 1"):
        train_several(RUNS, [0], BRIEF, workers=0)
    assert train_several(RUNS, [], BRIEF) == []


@pytest.mark.slow
def test_seeds_side_by_side_are_trainings_one_after_the_other(tmp_path, on_disk):
    options = held(checkpoint=tmp_path / "kept.safetensors")
    brief = replace(BRIEF, epochs=2)
    several = train_several(
        on_disk, [3, 5], brief, workers=2, options=options, model=Gru, progress=False
    )
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    for seed, trained in zip((3, 5), several, strict=True):
        alone = taught(brief, runs=on_disk, seed=seed, options=held(), model=Gru)
        assert same(alone, trained)
        assert (tmp_path / f"kept-{seed}.safetensors").exists()
    torch.set_num_threads(threads)


@pytest.mark.slow
@pytest.mark.skipif(
    not torch.cuda.is_available(),
    reason="TORCH SEES NO GPU: nothing was trained on one",
)
@pytest.mark.parametrize("network", [DPMPB, Gru, Residual])
def test_a_gpu_learns_the_same_in_the_same_order(network, tmp_path):
    trained = {
        device: taught(
            model=network,
            device=device,
            options=held(keep_best=True, checkpoint=tmp_path / f"{device}.safetensors"),
        )
        for device in ("cpu", "cuda")
    }
    _, biases, trace = trained["cpu"]
    other, found, noted = trained["cuda"]
    assert noted.losses == pytest.approx(trace.losses, rel=1e-3)
    assert noted.held_out == pytest.approx(trace.held_out, rel=1e-3)
    for name, p in biases.items():
        assert found[name] == pytest.approx(p, abs=1e-3)
    assert {each.device.type for each in other.parameters()} == {"cpu"}


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone says what is mapped")
def test_the_memory_of_a_training_is_measured(tmp_path):
    found = large_runs.measure(4e6, 500, tmp_path)
    assert found["data"] == pytest.approx(0.004, rel=0.01)
    assert found["copies of windows"] > 5 * found["data"]
    assert 0.05 < found["RssAnon"] < found["RSS"] < 4
    assert list(tmp_path.iterdir()) == []


def test_tensorboard_takes_four_lines(tmp_path):
    pytest.importorskip("tensorboard")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        from tensorboard.backend.event_processing.event_accumulator import (
            EventAccumulator,
        )
        from torch.utils.tensorboard import SummaryWriter

    writer = SummaryWriter(str(tmp_path))

    def show(epoch):
        writer.add_scalar("trained", epoch.loss, epoch.number)
        writer.add_scalar("held out", epoch.held_out, epoch.number)

    trace = taught(replace(BRIEF, epochs=2), options=held(callback=show))[2]
    writer.close()
    events = EventAccumulator(str(tmp_path)).Reload()
    shown = [each.value for each in events.Scalars("held out")]
    assert shown == pytest.approx(trace.held_out, rel=1e-6)
