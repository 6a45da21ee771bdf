"""Checks of the exercises: `checks.NAME(NAME)` where a function NAME is asked for.

A check takes the reader's function. It prints "correct", or raises CheckFailed with a
sentence that says what is wrong (Unanswered, of a stub with its dots). What it compares
with, it makes itself, of other inputs in each run: it needs neither the notebook's
variables nor `data/`, and `seed=` repeats a run. Each notebook's checks stand in the
file of its name, after an underscore.
"""

from clothlab.checks._check import CheckFailed, Unanswered
from clothlab.checks._cloth_simulation import count_springs, euler_step
from clothlab.checks._data_and_images import (
    bce_loss,
    chamfer_by_hand,
    denoise,
    linear_reconstruction,
)
from clothlab.checks._identifiability import share_held
from clothlab.checks._iterative_learning_control import one_outcome
from clothlab.checks._model_predictive_control import (
    farthest,
    has_slope,
    my_mask,
    together,
    two_targets,
)
from clothlab.checks._online_estimation import (
    curvature,
    gradient_by_nudges,
    momentum_step,
)
from clothlab.checks._parametric_bias import left_out, shares_by_hand
from clothlab.checks._predictive_model import (
    closed_loop,
    influence,
    lstm_step,
    parameter_groups,
)
from clothlab.checks._results import verdict
from clothlab.checks._start_here import best_moment
from clothlab.checks._stiffness_and_speed import sign_flip_share
from clothlab.checks._table_setting import plane_of_most, point_of_pixel
from clothlab.checks._variable_stiffness import (
    compliance,
    length_for_measured_tension,
    pair_stiffness,
)
from clothlab.checks._why_the_plan_fails import beyond_time, optimism, steps_earlier

__all__ = sorted(name for name, item in globals().items() if callable(item))
