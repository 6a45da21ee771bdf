"""What lies in `data/`: trials, weights, targets and results, by their names.

`load("torque-0")` gives all that belongs together. Each file is checked against its
hash before it is read, and fetched before that where the package has no clone. The
argument `data` of these functions is the folder to use instead of the one that
`data_folder` finds. An unknown name is a KeyError that lists the choices; a file that
is missing, damaged or altered is a ValueError that names it, and what brings it back.
"""

from clothlab._store import own_trials
from clothlab.data._reading import (
    load,
    load_autoencoder,
    load_model,
    load_target,
    load_targets,
    load_trials,
)

__all__ = [
    "load",
    "load_autoencoder",
    "load_model",
    "load_target",
    "load_targets",
    "load_trials",
    "own_trials",
]
