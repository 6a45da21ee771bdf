"""What trainings share: their loop, random numbers of their own, and a GPU if there is
one.
"""

import numpy as np
import pytest
import torch

from clothlab.method.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.method.data import Run
from clothlab.method.training import ModelTraining, train_dpmpb
from studies._optimise import minimise, seeded


def test_a_fit_finds_a_minimum_with_smaller_and_smaller_steps():
    x = torch.tensor([3.0, -2.0], requires_grad=True)
    places, losses = [x.detach().clone()], []
    for loss in minimise(
        [x],
        lambda goal: (x - goal).square().mean(),
        lambda: [torch.ones(1)] * 2,
        300,
        0.1,
    ):
        losses.append(loss)
        places.append(x.detach().clone())
    steps = torch.stack(places).diff(dim=0).norm(dim=1)
    assert torch.allclose(x, torch.ones(2), atol=1e-3)
    assert losses[-1] < 1e-5 < losses[0]
    assert len(losses) == 300
    assert steps[-1] < 1e-4 < steps[0]  # the rate ends at zero


def test_a_mean_loss_counts_each_item_once_and_groups_have_rates_of_their_own():
    fast, slow = (torch.zeros(1, requires_grad=True) for _ in range(2))
    groups = [{"params": [fast], "lr": 1.0}, {"params": [slow]}]
    batches = [torch.tensor([1.0, 1.0, 1.0])]
    (loss,) = minimise(
        groups, lambda x: (x + fast + slow).mean(), lambda: batches, 1, 0.1
    )
    assert loss == 1
    assert (fast.item(), slow.item()) == pytest.approx((-1, -0.1))
    batches.append(torch.tensor([5.0]))
    (loss,) = minimise(
        [slow], lambda x: x.mean() + 0 * slow.sum(), lambda: batches, 1, 0.1
    )
    assert loss == 2


def test_the_same_seed_gives_the_same_numbers_and_the_callers_go_on():
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    drawn = []
    for _ in range(2):
        with seeded(5):
            drawn.append(torch.rand(2))
    assert torch.equal(*drawn)
    assert torch.equal(torch.rand(3), expected)


@pytest.mark.slow
@pytest.mark.skipif(
    not torch.cuda.is_available(),
    reason="TORCH SEES NO GPU: nothing was trained on one",
)
def test_trainings_on_a_gpu_end_where_those_on_a_cpu_do(trial):
    images, rng = np.concatenate([trial.images] * 4), np.random.default_rng(0)
    runs = [
        Run(rng.normal(size=(60, 7)), rng.normal(size=(60, 2)), name) for name in "ab"
    ]
    eyes, model = (
        AutoencoderTraining(epochs=5, batch_size=12),
        ModelTraining(epochs=5, sequence_length=5),
    )
    losses = {}
    for device in (None, "cpu"):  # by default on the GPU
        torch.cuda.reset_peak_memory_stats()
        seeing, first = train_autoencoder(images, eyes, device=device, progress=False)
        predicting, _, found = train_dpmpb(runs, model, device=device, progress=False)
        assert device or torch.cuda.max_memory_allocated()
        assert {
            p.device.type for each in (seeing, predicting) for p in each.parameters()
        } == {"cpu"}
        losses[device] = np.array([first[-1], found[-1]])
    # Other random numbers, the same learning
    assert losses[None] == pytest.approx(losses["cpu"], rel=0.2)
