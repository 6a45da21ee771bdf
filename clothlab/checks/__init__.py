"""Checks of the exercises: `checks.NAME(NAME)` where a function NAME is asked for.

A check takes the reader's function. It prints "correct", or raises CheckFailed with a
sentence that says what is wrong (Unanswered, of a stub with its dots). What it compares
with, it makes itself, of other inputs in each run: it needs neither the notebook's
variables nor `data/`, and `seed=` repeats a run. `checks.if_open(NAME, ours)` is the
reader's function once it is written, and ours until then: so "Run all" gets to the end.
Each notebook's checks stand in the file of its name, after an underscore.
"""

from clothlab.checks._a_map_can_be_stretched import cell_half_life, same_predictions
from clothlab.checks._cloth_simulation import falling_speed
from clothlab.checks._data_and_images import start_bright
from clothlab.checks._how_long_a_step import (
    curvature,
    explicit_step,
    largest_rate,
    stable_step,
)
from clothlab.checks._identifiability import share_held
from clothlab.checks._iterative_learning_control import one_outcome
from clothlab.checks._model_predictive_control import moved_on, my_mask, step_down
from clothlab.checks._online_estimation import bare_step, online
from clothlab.checks._parametric_bias import heavier_twin
from clothlab.checks._predictive_model import closed_loop, update
from clothlab.checks._results import verdict
from clothlab.checks._start_here import infer
from clothlab.checks._stiffness_and_speed import sign_flip_share
from clothlab.checks._the_cloth_has_the_valley_too import together
from clothlab.checks._the_muscle_arm import (
    compliance,
    length_to_send,
    sag,
    two_link_jacobian,
)
from clothlab.checks._variable_stiffness import pair_stiffness
from clothlab.checks.ask import CheckFailed, if_open

__all__ = sorted(name for name, item in globals().items() if callable(item))
