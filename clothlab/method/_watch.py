"""What goes on beside a training: notes of each epoch, held-out runs, a file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor
from torch.optim import Adam
from torch.optim.lr_scheduler import CosineAnnealingLR

from clothlab.method._batches import Windows
from clothlab.method._training_file import (
    TrainingState,
    of_optimiser,
    random_numbers,
    set_optimiser,
    set_random_numbers,
)
from clothlab.method._weights import above, below
from clothlab.method.model import PredictiveModel, predict
from clothlab.method.training_options import Epoch, TrainingOptions

_AT_ONCE = 500  # held-out windows that are predicted together


@dataclass(frozen=True, eq=False)
class TrainingTrace:
    """What happened in a training."""

    losses: np.ndarray  # mean squared error of each epoch [epochs] [s.d.²]
    # p of each material before the first epoch and after each,
    # {name: [epochs + 1, D_p]}.
    biases: dict[str, np.ndarray]
    # That error of held-out runs [epochs]; NaN in epochs that did not look at them.
    held_out: np.ndarray
    # Of what is returned, how far predictions that come back as states are from
    # held-out runs, so many steps ahead [sequence_length - burn_in] [s.d.²]; empty
    # without such runs.
    ahead: np.ndarray
    epoch: int  # whose W and p are returned, from 1 on


class HeldOut:
    """Runs of trained materials that are only predicted.

    Args:
        windows: of these runs.
        burn_in: first steps, which only fill the memory.
    """

    def __init__(self, windows: Windows, burn_in: int):
        self._windows = windows
        self._burn_in = burn_in

    @torch.no_grad()
    def error(self, model: PredictiveModel, p: Tensor) -> float:
        """The loss, each next state from the true ones, with p `[K, D_p]`."""
        first = self._burn_in
        total = 0.0
        for index in self._parts():
            s, u, k = self._windows[index]
            predicted, _ = model(s[:, :-1], u, p[k])
            loss = model.loss(predicted[:, first:], s[:, 1 + first :])
            total += float(loss) * len(index)
        return total / len(self._windows)

    @torch.no_grad()
    def errors_ahead(self, model: PredictiveModel, p: Tensor) -> np.ndarray:
        """Squared errors of predictions that come back as states, by steps ahead."""
        first = self._burn_in
        total: Any = 0.0
        for index in self._parts():
            s, u, k = self._windows[index]
            memory = None
            if first:
                _, memory = model(s[:, :first], u[:, :first], p[k])
            predicted = predict(model, s[:, first], u[:, first:], p[k], memory)
            gaps = (predicted - s[:, 1 + first :]) / model.s_std
            total += gaps.square().mean(-1).sum(0).double().cpu().numpy()
        return total / len(self._windows)

    def _parts(self) -> Sequence[Tensor]:
        return torch.arange(len(self._windows)).split(_AT_ONCE)


class Watch:
    """Beside a training from its first epoch to its last, as a context around it.

    Args:
        model: being trained.
        p: of each material, being trained with it, `[K, D_p]`.
        materials: their names.
        held_out: runs to look at, if there are any.
        options: what to do.
        training: what says which training this is, plain data.
    """

    def __init__(
        self,
        model: PredictiveModel,
        p: Tensor,
        materials: Sequence[str],
        held_out: HeldOut | None,
        options: TrainingOptions,
        training: Mapping[str, Any],
    ):
        self._model = model
        self._p = p
        self._materials = materials
        self._held_out = held_out
        self._options = options
        self._training = training
        self._path: Path | None = None
        if options.checkpoint is not None:
            self._path = Path(options.checkpoint)

        # Noted so far, and the best epoch: its number, its error, and its weights
        self._losses: list[float] = []
        self._biases = [self._p_now()]
        self._errors: list[float | None] = []
        self._best = 0
        self._lowest = math.inf
        self._best_weights: dict[str, Tensor] = {}

        # What Ctrl-C writes: the state after the last epoch as a whole
        self._optimiser: tuple[Adam, CosineAnnealingLR] | None = None
        self._kept: TrainingState | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write the file where the training ends, or at Ctrl-C."""
        if error is None or isinstance(error, KeyboardInterrupt):
            self._save()
        if isinstance(error, KeyboardInterrupt) and self._kept is not None:
            error.add_note(f"{self._path} holds the training so far: resume=True")

    def begin(self, optimizer: Adam, schedule: CosineAnnealingLR) -> int:
        """Set all back to what the file holds: how many epochs are done."""
        self._optimiser = (optimizer, schedule)
        if self._path is None or not self._path.exists():
            return 0
        if not self._options.resume:
            raise ValueError(
                f"{self._path} exists: resume=True goes on from it, or choose another "
                "file"
            )
        state = TrainingState.load(self._path, self._training)
        self._check_normalisation(state)
        self._restore(state)
        set_optimiser(optimizer, schedule, state)
        set_random_numbers(self._p.device, state.tensors)
        over = state.said["over"]
        return self._training["epochs"] if over else len(self._losses)

    def note(self, loss: float) -> bool:
        """Note an epoch: whether the training should end here."""
        self._losses.append(loss)
        self._biases.append(self._p_now())
        number = len(self._losses)
        self._errors.append(self._look(number))
        self._note_best(number)

        # The callback, which may end it
        biases = dict(zip(self._materials, self._biases[-1], strict=True))
        epoch = Epoch(number, loss, self._errors[-1], biases)
        callback = self._options.callback
        over = bool(callback is not None and callback(epoch))

        # The file, from time to time
        if self._path is not None:
            self._kept = self._state(over)
            if number % self._options.checkpoint_every == 0:
                self._save()
        return over

    def finish(self) -> TrainingTrace:
        """Leave the best W and p in place, if they are wanted; what happened."""
        number = len(self._losses)
        if self._options.keep_best and self._best:
            number = self._best
            self._model.load_state_dict(self._best_weights)
        path = np.stack(self._biases)
        p = torch.as_tensor(path[number]).to(self._p.device)
        ahead = np.empty(0)
        if self._held_out is not None:
            ahead = self._held_out.errors_ahead(self._model.eval(), p)

        # What was not looked at has no error
        errors = [np.nan if each is None else each for each in self._errors]
        return TrainingTrace(
            losses=np.array(self._losses),
            biases={name: path[:, k] for k, name in enumerate(self._materials)},
            held_out=np.array(errors, np.float64),
            ahead=ahead,
            epoch=number,
        )

    def _p_now(self) -> np.ndarray:
        return self._p.detach().cpu().numpy().copy()

    def _look(self, number: int) -> float | None:
        """The error of held-out runs, in an epoch that looks at them."""
        if self._held_out is None or number % self._options.every:
            return None
        error = self._held_out.error(self._model.eval(), self._p.detach())
        self._model.train()
        return error

    def _note_best(self, number: int) -> None:
        error = self._errors[-1]
        if error is None or not self._options.keep_best:
            return
        if error < self._lowest:
            self._best = number
            self._lowest = error
            self._best_weights = _copied(self._model)

    def _save(self) -> None:
        if self._path is not None and self._kept is not None:
            self._kept.save(self._path, self._training)

    def _state(self, over: bool) -> TrainingState:
        """All as it is now."""
        assert self._optimiser is not None
        state = of_optimiser(*self._optimiser)
        tensors = {
            **state.tensors,
            **random_numbers(self._p.device),
            **above("model.", _copied(self._model)),
            **above("best.", self._best_weights),
            "p": torch.as_tensor(np.stack(self._biases)),
            "losses": torch.tensor(self._losses, dtype=torch.float64),
        }
        said = {
            **state.said,
            "held_out": list(self._errors),
            "best": self._best,
            "lowest": self._lowest if self._best else None,
            "over": over,
        }
        return TrainingState(tensors, said)

    def _restore(self, state: TrainingState) -> None:
        """Weights, p, and notes as they were."""
        self._model.load_state_dict(below("model.", state.tensors))
        self._best_weights = below("best.", state.tensors)
        self._biases = list(state.tensors["p"].numpy())
        with torch.no_grad():
            self._p.copy_(torch.as_tensor(self._biases[-1]))
        self._losses = state.tensors["losses"].tolist()
        self._errors = list(state.said["held_out"])
        self._best = state.said["best"]
        if self._best:
            self._lowest = state.said["lowest"]
        self._kept = state

    def _check_normalisation(self, state: TrainingState) -> None:
        """A ValueError if these runs are not those that the training began with."""
        for name in ("s_mean", "s_std", "u_mean", "u_std"):
            now = getattr(self._model, name).cpu()
            if not torch.equal(now, state.tensors[f"model.{name}"]):
                raise ValueError(
                    f"{self._path} is of a training on other runs: their {name} "
                    "differs; go on with those, or choose another file"
                )


def _copied(model: PredictiveModel) -> dict[str, Tensor]:
    """A copy of all weights, on the processor."""
    weights = model.state_dict()
    return {name: each.detach().cpu().clone() for name, each in weights.items()}
