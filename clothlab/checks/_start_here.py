"""Checks of notebook 00."""

from collections.abc import Callable

import numpy as np

from clothlab.checks._check import apart, array, check, drawn, expect, number


@check(number("a shift in pixels"))
def shift_for_iou(answer: Callable, rng: np.random.Generator) -> None:
    """How far a rectangle is shifted when its IoU with itself is a given share.

    Given are its width [pixel], along which it is shifted, and the share.
    """
    for _ in range(5):
        width, share = drawn(
            lambda: (rng.uniform(8, 60), rng.uniform(0.1, 0.9)),
            lambda pair: apart(_shift(*pair), _wrong_shifts(*pair), 0.02),
        )
        shift = _shift(width, share)
        otherwise = (
            f"shifted by {shift:.2f} pixels, a rectangle of {width:.2f} has IoU "
            f"{share:.2f}: draw both, and say what lies in both and what in either"
        )
        expect(answer(width, share), shift, otherwise, _wrong_shifts(width, share))


def _shift(width: float, share: float) -> float:
    """Where (width - shift) / (width + shift) is the share."""
    return width * (1 - share) / (1 + share)


def _wrong_shifts(width: float, share: float) -> dict[str, float]:
    """What usual slips give, by what is said of each."""
    shift = _shift(width, share)
    return {
        "IoU divides by what either covers, not by one of the rectangles": width
        * (1 - share),
        "what lies in both counts once in what either covers": width * (1 - 2 * share),
        "that is a share of the width: multiply by the width": shift / width,
        "that is how much still overlaps, not the shift": width - shift,
    }


@check(array("one overlap for each pair of images", None))
def overlap(answer: Callable, rng: np.random.Generator) -> None:
    """The IoU `[T]` of images with their targets, bool `[T, H, W]` each.

    Given are five rectangles with one target each, which overlap in part; then one
    image that is its own target, and one beside its target.
    """

    def draw() -> tuple[np.ndarray, np.ndarray]:
        return _rectangles(rng), _rectangles(rng)

    def clear(pair: tuple[np.ndarray, np.ndarray]) -> bool:
        truth, slips = _overlaps(*pair)
        return truth.min() > 0.05 and apart(truth, slips)

    # Rectangles that overlap in part
    images, targets = drawn(draw, clear)
    truth, slips = _overlaps(images, targets)
    found = answer(images, targets)
    assert len(found) == len(truth), (
        f"of {len(truth)} images come {len(truth)} overlaps, not {len(found)}: "
        "sum over height and width"
    )
    otherwise = (
        f"two rectangles have IoU {truth[0]:.3f}, not {found[0]:.3f}: draw both, and "
        "say what lies in both and what in either"
    )
    expect(found, truth, otherwise, slips)

    # All, and nothing
    beside = np.stack([images[0], ~images[0]])
    found = answer(np.stack([images[0], images[0]]), beside)
    expect(found[:1], [1.0], "an image and itself have IoU 1")
    expect(found[1:], [0.0], "images that nowhere overlap have IoU 0")


def _rectangles(rng: np.random.Generator) -> np.ndarray:
    """Five masks `[5, 24, 32]`, each with one rectangle."""
    masks = np.zeros((5, 24, 32), bool)
    for mask in masks:
        top, left, tall, wide = rng.integers((3, 3, 8, 8), (9, 12, 14, 18))
        mask[top : top + tall, left : left + wide] = True
    return masks


def _overlaps(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The IoU [T], and what usual slips give, by what is said of each."""
    size_a = a.sum(axis=(1, 2))
    size_b = b.sum(axis=(1, 2))
    both = (a & b).sum(axis=(1, 2))
    either = (a | b).sum(axis=(1, 2))
    whole = np.full(len(a), both.sum() / either.sum())
    return both / either, {
        "divide by what has cloth in either image, not by the target": both / size_b,
        "divide by what has cloth in either image, not by the camera's": both / size_a,
        "what lies in both counts once in what either covers": both / (size_a + size_b),
        "twice the overlap over the sum is Dice's measure, another one": 2
        * both
        / (size_a + size_b),
        "that is how many pixels lie in both: divide by those in either": both,
        "that is the share of all pixels of an image": both / a[0].size,
        "a share of all images together: sum over height and width alone": whole,
        "one over it: both go above, either below": either / both,
    }
