"""What is written beside a checkpoint, for who is given the file and nothing else."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from clothlab.method.checkpoint import Checkpoint

# The last line of a card; what people write stands below it.
_END = "<!-- What stands below this line stays when the card is written again. -->"


def model_card(checkpoint: "Checkpoint") -> str:
    """A page of Markdown: what it is, what it was trained on, where it may be trusted.

    Nothing in it is measured here: who saved the file adds how well it does.
    """
    sections = [
        _what_it_is(checkpoint),
        _numbers("State s, as it goes in and comes out", "s", checkpoint),
        _numbers("Command u", "u", checkpoint),
        _materials(checkpoint),
        _limits(checkpoint),
        _how_to_use(checkpoint),
        _END,
    ]
    return "\n\n".join(sections) + "\n"


def with_own_words(card: str, page: Path, *, overwrite: bool) -> str:
    """The card, and what people have written below the one that lies there.

    A ValueError for a page that is no card, unless it may be overwritten.
    """
    if not page.exists():
        return card
    _, end, own = page.read_text("utf-8").partition(_END)
    if not end and not overwrite:
        raise ValueError(
            f"{page} exists and is no model card: move it, or pass overwrite=True"
        )
    return card + own.removeprefix("\n")


def _what_it_is(checkpoint: "Checkpoint") -> str:
    """Title and facts; what nobody told is said to be unknown."""
    # What is known of the training.
    model = checkpoint.model
    losses = checkpoint.losses
    step = "unknown" if checkpoint.step is None else f"{checkpoint.step:g} s"
    fit = "unknown"
    if len(losses):
        fit = f"{losses[-1]:.4g} s.d.² after {len(losses)} epochs, on the training data"
    parameters = sum(each.numel() for each in model.parameters())

    # A list of it.
    return "\n".join(
        [
            f"# {checkpoint.name}",
            "",
            "Predicts the next state of a robot from its state, a command and a "
            "parametric bias p, which says what it handles.",
            "",
            f"- Network: {type(model).__name__}, {parameters:,} weights",
            f"- Control step: {step}",
            f"- Squared error of one step: {fit}",
            f"- Settings of the training: {checkpoint.settings or 'unknown'}",
            f"- Made by clothlab {checkpoint.version or 'of a version unknown'}",
        ]
    )


def _numbers(title: str, letter: str, checkpoint: "Checkpoint") -> str:
    """A table of states or commands: names, where they lay in training."""
    # What is known of each number.
    model = checkpoint.model
    of_states = letter == "s"
    names = checkpoint.state_names if of_states else checkpoint.command_names
    mean = getattr(model, f"{letter}_mean").tolist()
    deviation = getattr(model, f"{letter}_std").tolist()
    ranges = checkpoint.ranges

    # A row for each.
    lines = [
        f"## {title}",
        "",
        "| | name | mean | s.d. | lowest | highest |",
        "| --- | --- | --: | --: | --: | --: |",
    ]
    for k in range(len(mean)):
        reach = ["", ""]
        if ranges is not None:
            reach = [f"{each:.4g}" for each in getattr(ranges, letter)[:, k]]
        name = names[k] if names else ""
        cells = [k, name, f"{mean[k]:.4g}", f"{deviation[k]:.4g}", *reach]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def _materials(checkpoint: "Checkpoint") -> str:
    """A table of what it was trained with."""
    lines = ["## Trained materials", "", "| name | p | steps |", "| --- | --- | --: |"]
    for name, p in checkpoint.biases.items():
        numbers = ", ".join(f"{each:.3f}" for each in np.asarray(p))
        lines.append(f"| {name} | {numbers} | {checkpoint.steps.get(name, '')} |")
    return "\n".join(lines)


def _limits(checkpoint: "Checkpoint") -> str:
    """Where not to trust it."""
    known = checkpoint.ranges is not None
    watch = (
        "`RangeWatch` warns there" if known else "the file does not say where it was"
    )
    return "\n".join(
        [
            "## Limits",
            "",
            f"- Outside the ranges of its training it answers, and is wrong: {watch}.",
            "- At another control step than its own, predictions and p mean nothing.",
            "- p has no units and no order of its own: it is compared with the p "
            "above, and with no other training's.",
            "- It was not made to keep anybody safe. Limits and an emergency stop "
            "belong below it.",
        ]
    )


def _how_to_use(checkpoint: "Checkpoint") -> str:
    network = type(checkpoint.model).__name__
    given = "" if network == "DPMPB" else f", network={network}"
    return "\n".join(
        [
            "## How to load it",
            "",
            "```python",
            "from clothlab import Checkpoint",
            "",
            f'checkpoint = Checkpoint.load("{checkpoint.name}.safetensors"{given})',
            "```",
        ]
    )
