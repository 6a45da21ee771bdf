"""What is kept of a training while it runs; none of it changes what is learned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from clothlab._validation import Checked, setting
from clothlab.method._inputs import check_runs
from clothlab.method._weights import check_suffix
from clothlab.method.data import Run


class Epoch(NamedTuple):
    """What a callback is told after each epoch."""

    number: int  # from 1 on
    loss: float  # mean squared error of what is trained on [s.d.²]
    held_out: float | None  # that of held-out runs, in epochs that look at them
    biases: Mapping[str, np.ndarray]  # p of each material, {name: [D_p]}


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingOptions(Checked):
    """Held-out runs, the best epoch, a callback, and a file to go on from.

    With a `checkpoint`, Ctrl-C loses at most the epoch that it interrupts; the same
    call with `resume=True` then ends with the very numbers of a training that nothing
    interrupted.
    """

    # Runs of trained materials, which are only predicted: their error says when a
    # training learns by heart.
    held_out: Sequence[Run] = ()
    every: int = setting(1, "epoch", at_least=1)  # between two looks at them
    # Return W and p of the look with the lowest error, and not the last ones.
    keep_best: bool = False
    # Called after each epoch; if it returns True, the training ends there.
    callback: Callable[[Epoch], bool | None] | None = None
    # A file for all that a training needs to go on, which is written at its end, at
    # Ctrl-C, and every so many epochs.
    checkpoint: str | Path | None = None
    checkpoint_every: int = setting(10, "epoch", at_least=1)
    resume: bool = False  # go on from that file, if it is there

    def __post_init__(self) -> None:
        super().__post_init__()
        held_out = tuple(check_runs(self.held_out))
        object.__setattr__(self, "held_out", held_out)
        if self.keep_best and not held_out:
            raise ValueError("keep_best needs runs in held_out, by whose error it is")
        if self.callback is not None and not callable(self.callback):
            raise ValueError("a callback is called with an Epoch after each epoch")

        # A file that is to be read again
        if self.checkpoint is None:
            if self.resume:
                raise ValueError("resume needs a checkpoint, the file to go on from")
            return
        path = Path(self.checkpoint)
        check_suffix(path)
        object.__setattr__(self, "checkpoint", path)
