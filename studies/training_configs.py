"""What each set of stored weights is trained on and how, and the trainings."""

from dataclasses import dataclass, replace

import numpy as np

from clothlab import data
from clothlab.method.autoencoder import (
    Autoencoder,
    AutoencoderTraining,
    train_autoencoder,
)
from clothlab.method.data import Run
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.simulation.arm import get_arm
from clothlab.trials import Trial, to_run
from clothlab.weights import ClothCheckpoint


@dataclass(frozen=True)
class TrainingConfig:
    """Recordings, and settings of the trainings."""

    name: str  # of the autoencoder, and with a seed behind it of each DPMPB
    arm: str  # name
    recordings: tuple[str, ...]  # names of the sets of trials
    autoencoder: AutoencoderTraining
    model: ModelTraining
    # Of the autoencoder; DPMPBs count on from it. Another one makes all of it anew.
    first_seed: int = 0

    @property
    def inputs(self) -> tuple[str, ...]:
        """Folders of the recordings, from `data/`."""
        return tuple(f"trials/{name}/" for name in self.recordings)

    def load_trials(self) -> list[Trial]:
        """All trials to learn from.

        Those beyond the paper's amount have to be made first, with `make data`.
        """
        trials: list[Trial] = []
        for name in self.recordings:
            trials += data.load_trials(name)
        return trials

    def train_autoencoder(self) -> tuple[Autoencoder, list[float]]:
        """The autoencoder of all images, and its loss of each epoch [nat per pixel]."""
        images = np.concatenate([trial.images for trial in self.load_trials()])
        return train_autoencoder(
            images, self.autoencoder, seed=self.first_seed, progress=False
        )

    def encoded_runs(self) -> list[Run]:
        """All that the model learns from, as the stored autoencoder encodes it."""
        autoencoder, _ = data.load_autoencoder(self.name)
        return [to_run(autoencoder, trial) for trial in self.load_trials()]

    def train_model(self, seed: int) -> ClothCheckpoint:
        """A DPMPB on top of the stored autoencoder."""
        autoencoder, _ = data.load_autoencoder(self.name)
        model, biases, losses = train_dpmpb(
            self.encoded_runs(), self.model, seed=self.first_seed + seed, progress=False
        )
        return ClothCheckpoint(
            name=f"{self.name}-{seed}",
            arm=get_arm(self.arm),
            autoencoder=autoencoder,
            autoencoder_name=self.name,
            model=model,
            biases=biases,
            losses=losses,
            settings=self.model,
        )


# All sequences of the muscle arm fit into one batch, so that there is one step an
# epoch: larger steps make up for it.
_PAPER_MUSCLE = ModelTraining(
    epochs=600,
    batch_size=1000,
    sequence_length=20,
    learning_rate=8e-3,
    bias_learning_rate=2.4e-2,
)
# Twenty times the recordings need fewer epochs, and smaller batches learn more from
# each.
_FEW_EPOCHS = AutoencoderTraining(epochs=8)
_MORE = ModelTraining(epochs=40, batch_size=100)
_MORE_MUSCLE = replace(_MORE, sequence_length=20)
# Short throws: the model has to know them from the first step to the last, and all
# windows begin near the first.
_THROWS = ModelTraining(epochs=150, batch_size=150, sequence_length=16, stride=1)
_CONFIGS = (
    TrainingConfig(
        "torque-paper", "torque", ("train",), AutoencoderTraining(), ModelTraining()
    ),
    TrainingConfig(
        "muscle-paper",
        "muscle",
        ("muscle-train",),
        AutoencoderTraining(),
        _PAPER_MUSCLE,
    ),
    TrainingConfig("torque", "torque", ("train", "train-more"), _FEW_EPOCHS, _MORE),
    TrainingConfig(
        "muscle",
        "muscle",
        ("muscle-train", "muscle-train-more"),
        _FEW_EPOCHS,
        _MORE_MUSCLE,
    ),
    TrainingConfig(
        "table",
        "muscle-hand",
        ("table-throws", "table-random", "table-swings"),
        AutoencoderTraining(epochs=20),
        _THROWS,
    ),
)
TRAINING_CONFIGS = {config.name: config for config in _CONFIGS}
