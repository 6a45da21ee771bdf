"""Checks of notebook 03."""

from collections.abc import Callable

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor
from torch.nn import functional as F

from clothlab.checks._check import apart, array, check, drawn, expect, number
from clothlab.masks import HEIGHT, WIDTH
from clothlab.simulation.vision import chamfer_distance

_PIXELS = HEIGHT * WIDTH


@check(number("a distance in pixels"))
def chamfer_by_hand(answer: Callable, rng: np.random.Generator) -> None:
    """A large and a small rectangle that overlap, for which every usual slip has
    another value; then an L.
    """

    def draw() -> tuple[np.ndarray, np.ndarray]:
        a, b = np.zeros((2, HEIGHT, WIDTH), bool)
        row, column, tall, wide = rng.integers((8, 20, 10, 6), (20, 60, 15, 10))
        a[row : row + tall, column : column + 4] = True
        b[row + tall - 2 : row + tall + 1, column + 2 : column + 2 + wide] = True
        return a, b

    a, b = drawn(
        draw, lambda masks: apart(chamfer_distance(*masks), _chamfer_slips(*masks))
    )
    bent = a | b
    found, other = answer(a, b), answer(bent, b)
    truth, other_truth = chamfer_distance(a, b), chamfer_distance(bent, b)
    otherwise = f"two rectangles are {truth:.4f} pixels apart, not {found:.4f}"
    if found and np.isclose(found / truth, other / other_truth, rtol=1e-4):
        otherwise = (
            f"{found / truth:.4g} times the distance: the unit is the side of one pixel"
        )
    expect(found, truth, otherwise, _chamfer_slips(a, b), rtol=1e-4)
    expect(
        other,
        other_truth,
        "right for two rectangles, wrong for an L and one of its legs",
        rtol=1e-4,
    )
    expect(answer(a, a), 0, "a mask is at distance 0 from itself")


def _chamfer_slips(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """What is easily written in place of the chamfer distance: what the reader is told,
    and the value.
    """
    pixels = np.argwhere(a), np.argwhere(b)
    d = cdist(*pixels)
    city = cdist(*pixels, "cityblock")
    there, back = d.min(axis=1), d.min(axis=0)
    return {
        "that is one direction only, from a to b": there.mean(),
        "both directions, but added: halve it": there.mean() + back.mean(),
        "that is the largest distance (Hausdorff's): take the mean over the pixels": max(
            there.max(), back.max()
        ),
        "a sum over the pixels: take the mean, or large masks would be farther away": (
            there.sum() + back.sum()
        )
        / 2,
        "the mean over all pairs: each pixel counts its nearest partner alone": d.mean(),
        "steps along rows and columns: distances are Euclidean": (
            city.min(axis=1).mean() + city.min(axis=0).mean()
        )
        / 2,
    }


@check(number("the mean over all pixels, which is finite for a logit of 200, too"))
def bce_loss(answer: Callable, rng: np.random.Generator) -> None:
    """Random logits, then large ones, all of them wrong."""

    def draw() -> tuple[Tensor, Tensor]:
        logits = torch.as_tensor(
            rng.normal(0, 3, (4, 1, 6, 8)).clip(-8, 8), dtype=torch.float32
        )
        return logits, torch.as_tensor(
            rng.random((4, 1, 6, 8)) < 0.3, dtype=torch.float32
        )

    logits, images = drawn(
        draw,
        lambda pair: apart(
            F.binary_cross_entropy_with_logits(*pair), _bce_slips(*pair)
        ),
    )
    truth = F.binary_cross_entropy_with_logits(logits, images)
    found = answer(logits, images)
    expect(
        found,
        truth,
        f"for random logits L is {truth:.4f}, not {found:.4f}",
        _bce_slips(logits, images),
    )
    large = float(rng.integers(180, 220))
    found = answer(large * (1 - 2 * images), images)
    message = f"where logits of {large:g} are all wrong, L is {large:g}, not {found:.4g}: nothing may be cut off"
    expect(found, large, message)


def _bce_slips(logits: Tensor, images: Tensor) -> dict[str, float]:
    """What is easily written in place of the binary cross entropy: what the reader is
    told, and the value.
    """
    none, cloth = F.softplus(logits), F.softplus(-logits)
    truth = F.binary_cross_entropy_with_logits(logits, images)
    slips = {
        "a sum: take the mean over all pixels": truth * images.numel(),
        "the two cases have changed places: a large logit makes cloth likely": (
            images * none + (1 - images) * cloth
        ),
        "the sign is wrong: a loss is never negative": -truth,
        "pixels without cloth count, too": images * cloth,
        "each pixel has one of the two terms: choose it by `images`": none + cloth,
    }
    return {message: float(value.mean()) for message, value in slips.items()}


@check(array("the loss of each batch", 4))
def denoise(answer: Callable, rng: np.random.Generator) -> None:
    """Four batches for a small linear network, by plain gradient descent."""
    seed = drawn(
        lambda: int(rng.integers(2**31)),
        lambda seed: apart(_losses(seed), _denoise_slips(seed)),
    )
    slips = _denoise_slips(seed)
    found, truth = answer(*_network_and_batches(seed)), _losses(seed)
    otherwise = "the first loss is wrong: it is the binary cross entropy of network(noisy) and clean"
    if np.isclose(found[0], truth[0]):
        otherwise = "the first loss is right, and those after an update are wrong"
    expect(found, truth, otherwise, slips)


def _denoise_slips(seed: int) -> dict[str, list[float]]:
    """What a training with a usual slip gives: what the reader is told, and the losses."""
    return {
        "gradients of the batch before are still there: zero_grad() comes before backward()": _losses(
            seed, "bs"
        ),
        "the update comes too early: backward() computes the gradient that step() needs": _losses(
            seed, "szb"
        ),
        "the weights do not move: zero_grad(), then loss.backward(), then step()": _losses(
            seed, "zb"
        ),
        "the loss compares with the clean image, not with the noisy one": _losses(
            seed, target=0
        ),
        "the network is given the noisy image, not the clean one": _losses(
            seed, given=1
        ),
        "the noisy image is given, and the clean one is the target": _losses(
            seed, given=1, target=0
        ),
        "take the binary cross entropy, not a squared error": _losses(
            seed, loss=F.mse_loss
        ),
    }


def _losses(
    seed: int,
    order: str = "zbs",
    given: int = 0,
    target: int = 1,
    loss: Callable = F.binary_cross_entropy_with_logits,
) -> list[float]:
    """Losses of a training whose calls come in this order: zero_grad, backward, step."""
    (network, descent, batches), losses = _network_and_batches(seed), []
    for images in batches:
        value = loss(network(images[given]), images[target])
        losses.append(value.item())
        for call in order:
            {"z": descent.zero_grad, "b": value.backward, "s": descent.step}[call]()
    return losses


def _network_and_batches(
    seed: int,
) -> tuple[torch.nn.Module, torch.optim.Optimizer, list[tuple[Tensor, Tensor]]]:
    """The same for the same seed: a small network, its descent and four pairs of
    batches.
    """
    rng = np.random.default_rng(seed)
    with torch.random.fork_rng(devices=[]):
        network = torch.nn.Linear(5, 5)
    with torch.no_grad():
        network.weight.copy_(torch.as_tensor(rng.normal(0.1, 0.1, (5, 5))))
    torch.nn.init.zeros_(network.bias)
    images = torch.as_tensor(rng.integers(0, 2, (4, 2, 8, 5)), dtype=torch.float32)
    return (
        network,
        torch.optim.SGD(network.parameters(), lr=0.5),
        [(noisy, clean) for noisy, clean in images],
    )


@check(array("the reconstructed images", None, _PIXELS))
def linear_reconstruction(answer: Callable, rng: np.random.Generator) -> None:
    """A square at random places, beside the best that so many components can do."""
    corners = rng.integers(20, 40, (120, 2, 1))
    rows, columns = (
        np.abs(np.arange(size) - corners[:, k] - 10) < 12
        for k, size in enumerate((HEIGHT, WIDTH))
    )
    images = (
        (rows[:, :, None] & columns[:, None, :])
        .reshape(120, _PIXELS)
        .astype(np.float32)
    )
    fit, test = images[:80], images[80:]
    alone = answer(fit, test[:5], 3)
    for n in (1, 3):
        linear = answer(fit, test, n)
        assert len(linear) == len(test), (
            f"{len(test)} images must give as many, not {len(linear)}"
        )
        assert not np.isin(linear, (0, 1)).all(), (
            "return real numbers: rounding comes later"
        )
        found, least = ((linear - test) ** 2).mean(), _least_error(fit, test, n)
        message = f"{n} axes through the mean of `train` leave a squared error of {least:.4f}, yours {found:.4f}"
        assert found > 0.95 * least, (
            message + ": have you taken more axes, or fitted them to other images?"
        )
        assert found < 1.05 * least, (
            message + ": are there so many axes, and is the mean added again?"
        )
    assert np.allclose(alone, linear[:5], atol=0.05), (
        "other images change the axes: fit the PCA to `train` alone"
    )


def _least_error(fit: np.ndarray, test: np.ndarray, n: int) -> float:
    """Squared error of `test` `[M, D]` after projection onto n principal axes of `fit`
    `[N, D]`.
    """
    mean = fit.mean(axis=0)
    # N numbers are far fewer than D
    vectors = np.linalg.eigh((fit - mean) @ (fit - mean).T)[1][:, -n:]
    axes = vectors.T @ (fit - mean)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.square(test - mean - (test - mean) @ axes.T @ axes).mean()
