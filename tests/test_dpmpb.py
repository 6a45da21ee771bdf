"""Laws of the predictive model with parametric bias, and of training W and p together."""

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import Autoencoder
from clothlab.method.cloth_task import observe
from clothlab.method.data import Run, set_normalisation, windows
from clothlab.method.estimation import NewtonSettings, estimate_bias
from clothlab.method.model import DPMPB, predict
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.trials import to_run

BRIEF = ModelTraining(epochs=8, batch_size=20, sequence_length=10)
GOOD = Run(np.zeros((40, 7)), np.zeros((40, 2)), "a")


@pytest.fixture
def made_up_runs(model):
    """Runs that a model generates itself, each with its own p: data whose p is known."""
    with torch.no_grad():  # random weights hardly listen to p; these do
        model.fc_in[0].weight[:, -2:] *= 10
        model.fc_out[-1].weight *= 5
    generator = torch.Generator().manual_seed(2)
    runs = []
    for name, p in (("a", [0.5, 0.0]), ("b", [-0.5, 0.0])):
        u = torch.randn(1, 80, 2, generator=generator, dtype=torch.float64)
        states = predict(
            model, torch.zeros(7, dtype=torch.float64), u, torch.tensor(p).double()
        )
        runs.append(Run(np.vstack([np.zeros(7), states[0, :-1]]), u[0].numpy(), name))
    return runs


def test_gradient_on_p_equals_finite_differences(model):
    torch.manual_seed(3)
    s, u = (
        torch.randn(1, 6, 7, dtype=torch.float64),
        torch.randn(1, 6, 2, dtype=torch.float64),
    )
    p = torch.tensor([0.3, -0.2], dtype=torch.float64, requires_grad=True)

    def loss(p):
        return model.loss(model(s[:, :-1], u[:, :-1], p)[0], s[:, 1:])

    assert torch.autograd.gradcheck(loss, p)
    assert torch.autograd.grad(loss(p), p)[0].abs().min() > 1e-6


def test_the_smallest_robot_has_one_number_and_one_command():
    model = DPMPB(1, 1, bias_size=0).eval()
    predicted, _ = model(torch.zeros(1, 3, 1), torch.zeros(1, 3, 1), torch.zeros(0))
    assert predicted.shape == (1, 3, 1)


def test_predictions_depend_on_p_and_on_memory_which_begins_with_zeros(model, memory):
    s, u = (
        torch.zeros(7, dtype=torch.float64),
        torch.zeros(1, 4, 2, dtype=torch.float64),
    )
    zero, one = (torch.full((2,), value, dtype=torch.float64) for value in (0.0, 1.0))
    assert not torch.allclose(predict(model, s, u, zero), predict(model, s, u, one))
    assert not torch.allclose(
        predict(model, s, u, zero), predict(model, s, u, zero, memory)
    )
    first = type(memory)(*(part.double() for part in model.initial_memory()))
    assert torch.equal(predict(model, s, u, zero), predict(model, s, u, zero, first))


def test_normalisation_comes_from_all_runs_and_never_divides_by_nothing():
    model = DPMPB(7, 2)
    s = np.arange(140.0).reshape(20, 7)
    s[:, 6] = 5.0  # a sensor that never changes
    runs = [Run(s[:10], np.zeros((10, 2)), "a"), Run(s[10:], np.ones((10, 2)), "b")]
    with pytest.warns(
        UserWarning, match=r"state 6 \(counted from 0\) never changes in these runs"
    ):
        set_normalisation(model, runs)
    assert model.s_mean.numpy() == pytest.approx(s.mean(0))
    assert model.s_std.numpy()[:6] == pytest.approx(s.std(0, ddof=1)[:6])
    assert model.s_std[6] > 0
    assert model.u_mean.tolist() == [0.5, 0.5]


@pytest.mark.slow
@pytest.mark.parametrize("constant", [9.81, 0.0])
def test_a_sensor_and_a_command_that_never_change_are_left_out(made_up_runs, constant):
    runs = []
    for run in made_up_runs:
        s = np.column_stack([run.s, np.full(len(run), constant)])
        u = np.column_stack([run.u, np.full(len(run), constant)])
        runs.append(Run(s, u, run.material))
    with pytest.warns(UserWarning, match="never changes") as warned:
        model, biases, _ = train_dpmpb(runs, BRIEF, progress=False)
    assert [str(each.message)[:9] for each in warned] == ["state 7 (", "command 2"]

    run = runs[0]
    p, _ = estimate_bias(
        model, run, method="newton", settings=NewtonSettings(window=len(run))
    )
    for moved in (1e-4, 1.0, 50.0):
        s, u = run.s.copy(), run.u.copy()
        s[10:, -1] += moved
        u[:, -1] -= moved
        p_moved, _ = estimate_bias(
            model,
            Run(s, u, "x"),
            method="newton",
            settings=NewtonSettings(window=len(run)),
        )
        assert p_moved == pytest.approx(p, abs=0.01)
    start, commands = torch.tensor(run.s[0]), torch.tensor(run.u[None, :5])
    p_trained = torch.tensor(biases[run.material], dtype=torch.float32)
    predicted = predict(model, start, commands, p_trained)
    assert predicted[0, :, -1].tolist() == pytest.approx([constant] * 5)


def test_a_trial_is_no_run(made_up_runs, trial):
    with pytest.raises(ValueError, match=r"learned.to_run\(trial\)"):
        train_dpmpb([*made_up_runs, trial], progress=False)


def test_training_separates_materials_and_is_reproducible(made_up_runs):
    trained, found, losses = train_dpmpb(made_up_runs, BRIEF, progress=False)
    again, found_again, _ = train_dpmpb(made_up_runs, BRIEF, progress=False)
    assert losses[-1] < losses[0]
    assert np.linalg.norm(found["a"] - found["b"]) > 0.01
    assert np.array_equal(found["a"], found_again["a"])
    assert all(
        torch.equal(a, b)
        for a, b in zip(trained.parameters(), again.parameters(), strict=True)
    )
    assert not trained.training


def test_a_p_that_is_known_is_used_as_it_is(made_up_runs):
    known = {"b": [-0.5, 0.25], "a": [0.5, 0.0]}
    _, biases, _ = train_dpmpb(made_up_runs, BRIEF, known=known, progress=False)
    for name, p in known.items():
        assert np.array_equal(biases[name], np.float32(p))
    with pytest.raises(KeyError, match="b"):
        train_dpmpb(made_up_runs, BRIEF, known={"a": [0.0, 0.0]}, progress=False)


def test_stretches_overlap_and_belong_to_their_material():
    runs = [
        Run(np.arange(n)[:, None], 10.0 * np.arange(n)[:, None], name)
        for n, name in ((7, "a"), (5, "b"))
    ]
    s, u, k = windows([*runs, runs[0]], 3, 2)
    assert s[:, :, 0].tolist() == [
        [0, 1, 2, 3],
        [2, 3, 4, 5],
        [0, 1, 2, 3],
        [0, 1, 2, 3],
        [2, 3, 4, 5],
    ]
    assert u[:, :, 0].tolist() == (10 * s[:, :-1, 0]).tolist()
    assert k.tolist() == [0, 0, 1, 0, 0]


def test_states_of_a_trial_are_z_and_robot(trial):
    autoencoder = Autoencoder().eval()
    run = to_run(autoencoder, trial)
    assert run.s.shape == (12, 7)
    assert run.s[:, 3:] == pytest.approx(trial.robot, rel=1e-5)
    assert run.material == "damp0.05-mass0.10"
    assert run[1:3].s.tolist() == run.s[1:3].tolist()
    one = observe(autoencoder, {"image": trial.images[4], "robot": trial.robot[4]})
    assert one == pytest.approx(run.s[4], abs=1e-5)
    assert one.dtype == run.s.dtype == np.float32


@pytest.mark.parametrize(
    ("s", "u", "message"),
    [
        (GOOD.s + np.nan, GOOD.u, r"s of a run of a is nan in step 0"),
        (GOOD.s, GOOD.u[0], r"u of a run of a is \[T, D_u\], got \[2\]"),
        (GOOD.s[:5], GOOD.u, "as many states as commands, at least one, got 5 and 40"),
        (GOOD.s[:0], GOOD.u[:0], "got 0 and 0"),
    ],
)
def test_what_does_not_belong_together_is_no_run(s, u, message):
    with pytest.raises(ValueError, match=message):
        Run(s, u, "a")


def test_numbers_whose_changes_single_precision_loses_come_with_the_cure():
    """A robot that moves by metres, 3,949 km north of where its map begins."""
    t, moved = np.linspace(0, 20, 400), np.zeros((400, 1))
    north, still = 3_948_996 + 2.3 * np.sin(t), np.full(400, 9.81)
    s = np.column_stack([still + 1e-15 * np.sin(t), north])
    with pytest.warns(UserWarning, match=r"number 1 .*: subtract a constant from it"):
        run = Run(s, moved, "a")
    assert len(np.unique(run.s[:, 1])) < 30  # of 400: what is warned of
    run[:100]  # a part of what was rounded before, without a second warning
    assert len(np.unique(Run(s - s[0], moved, "a").s[:, 1])) > 390


def test_runs_that_no_model_can_learn_are_refused():
    with pytest.raises(ValueError, match=r"no runs"):
        train_dpmpb([])
    with pytest.raises(
        ValueError,
        match=r"a window predicts 30 steps, and the shortest run has only 20",
    ):
        train_dpmpb([GOOD, GOOD[:20]])
    with pytest.raises(ValueError, match=r"it is of another robot"):
        train_dpmpb([GOOD, Run(np.zeros((40, 9)), GOOD.u, "b")])
