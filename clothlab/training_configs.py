"""What each set of stored weights is trained on, and how; and the trainings themselves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from clothlab import artifacts
from clothlab._validation import choose
from clothlab.learning.autoencoder import AutoencoderTraining, train_autoencoder
from clothlab.learning.dpmpb import ModelTraining, Sequences, to_sequences, train_dpmpb
from clothlab.learning.trained import Trained
from clothlab.simulation.arm import get_arm
from clothlab.trials import Trial


@dataclass(frozen=True)
class Recipe:
    """Recordings, and settings of the trainings.

    Attributes:
        arm: name of the arm.
        recordings: names of the sets of trials.
        autoencoder: how it is trained on their images; or the name of the recipe whose autoencoder is used.
        model: how the DPMPB is trained on what the autoencoder sees.
    """

    arm: str
    recordings: tuple[str, ...]
    autoencoder: AutoencoderTraining | str
    model: ModelTraining

    def load_trials(self) -> list[Trial]:
        """All trials to learn from.

        Raises:
            KeyError: recordings beyond the paper's amount that are not here; the message says how to make them.
            ValueError: a damaged, altered or missing file.
        """
        return [trial for name in self.recordings for trial in artifacts.load_trials(name)]


# All sequences of the muscle arm fit into one batch, so that there is one step an epoch: larger steps make up for it.
PAPER_MUSCLE = ModelTraining(
    epochs=600, batch_size=1000, sequence_length=20, learning_rate=8e-3, bias_learning_rate=2.4e-2
)
# Twenty times the experience needs fewer rounds of it, and smaller batches learn more from each round.
MORE_SEEN = AutoencoderTraining(epochs=8)
MORE = ModelTraining(epochs=40, batch_size=100)
# Short throws: the model has to know them from the first step to the last, and all windows begin near the first.
THROWS = ModelTraining(epochs=150, batch_size=150, sequence_length=16, stride=1)
RECIPES = {
    "torque-paper": Recipe("torque", ("train",), AutoencoderTraining(), ModelTraining()),
    "muscle-paper": Recipe("muscle", ("muscle-train",), AutoencoderTraining(), PAPER_MUSCLE),
    "torque": Recipe("torque", ("train", "train-more"), MORE_SEEN, MORE),
    "muscle": Recipe("muscle", ("muscle-train", "muscle-train-more"), MORE_SEEN, replace(MORE, sequence_length=20)),
    "table": Recipe(
        "muscle-hand", ("table-throws", "table-random", "table-swings"), AutoencoderTraining(epochs=20), THROWS
    ),
}


def sees_with(name: str) -> str:
    """Name of the autoencoder of a recipe: its own, or that of another one.

    Raises:
        KeyError: unknown recipe; the message lists the choices.
    """
    autoencoder = choose("recipe", name, RECIPES).autoencoder
    return autoencoder if isinstance(autoencoder, str) else name


def recipe_of(learned: Trained) -> Recipe:
    """The recipe by which stored weights were trained, or others of the same arm with the same autoencoder.

    Raises:
        KeyError: an arm and an autoencoder that no recipe has together; the message lists the choices.
    """
    pairs = {f"{recipe.arm} with {sees_with(name)}": recipe for name, recipe in RECIPES.items()}
    return choose("recipe", f"{learned.arm.name} with {learned.autoencoder_name}", pairs)


def train_eyes(name: str, recipe: Recipe | None = None, *, progress: bool = False) -> None:
    """Train the autoencoder of a recipe on all its images, and save it in `data/weights`.

    Args:
        name: of the weights.
        recipe: how; by default the one of that name.
        progress: show a progress bar.

    Raises:
        ValueError: a recipe without an autoencoder of its own.
    """
    torch.set_num_threads(1)
    recipe = recipe or choose("recipe", name, RECIPES)
    if isinstance(recipe.autoencoder, str):
        raise ValueError(f"{name!r} sees with the autoencoder {recipe.autoencoder!r} and has none of its own")
    images = np.concatenate([trial.images for trial in recipe.load_trials()])
    model, losses = train_autoencoder(images, recipe.autoencoder, seed=0, progress=progress)
    artifacts.save_autoencoder(model, losses, name)


def seen_by(name: str, recipe: Recipe | None = None) -> list[Sequences]:
    """All that a recipe's model learns from, as its stored autoencoder sees it.

    Args:
        name: of the weights.
        recipe: how; by default the one of that name.
    """
    autoencoder, _ = artifacts.load_autoencoder(sees_with(name))
    recipe = recipe or choose("recipe", name, RECIPES)
    return [to_sequences(autoencoder, trial) for trial in recipe.load_trials()]


def train_model(
    name: str, runs: Sequence[Sequences], seed: int, recipe: Recipe | None = None, *, progress: bool = False
) -> None:
    """Train the DPMPB of a recipe, and save it as `NAME-SEED` in `data/weights`.

    Args:
        name: of the weights.
        runs: as `seen_by` gives them, so that several trainings share them.
        seed: of the training.
        recipe: how; by default the one of that name.
        progress: show a progress bar.
    """
    torch.set_num_threads(1)
    recipe, eyes = recipe or choose("recipe", name, RECIPES), sees_with(name)
    autoencoder, _ = artifacts.load_autoencoder(eyes)
    model, biases, trace = train_dpmpb(runs, recipe.model, seed=seed, progress=progress)
    learned = Trained(
        f"{name}-{seed}", get_arm(recipe.arm), autoencoder, model, biases, trace.losses, autoencoder_name=eyes
    )
    artifacts.save(learned)
