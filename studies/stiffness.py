"""What is variable stiffness good for?

The paper's section "Actual Robot Experiment", on a simulated muscle arm with foams,
whose springs, motors and material values are assumptions. Each period of the control
starts from the best predicted of 200 recorded stretches of commands: with the paper's
warm start alone the arm hardly moves.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from clothlab import data
from clothlab.analysis import empty_distance, nearest_material, target_distance
from clothlab.method.estimation import estimate_bias
from clothlab.simulation.arm import MuscleArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.stiffness import ellipse_area, stiffness_ellipse
from clothlab.trials import Trial, recorded_plans
from studies._grid import Experiment, Tables, over
from studies._rows import Row
from studies._runs import (
    EVALUATION,
    RECORDINGS,
    bias_error,
    estimate_at_random,
    median_best,
    new_trial,
    random_trial,
    trained,
)
from studies.motion import replay

ARM = MuscleArm()
# Of the ellipses [rad]: elbow at 90 degrees, as in the paper
POSTURE = (0.0, -np.pi / 2)
TENSIONS = (10.0, 30.0, 50.0, 70.0)  # of the ellipses [N]
# As stiff at about 30 N
_SPRINGS = {
    "nonlinear": ARM,
    "linear": replace(ARM, spring_linear=5000.0, spring_cubic=0.0),
}
ESTIMATED = ("hard-1", "hard-2", "hard-3")  # from one end of the scale to the other
HELD = ("hard-1", "soft-1")  # each is the wrong one for the other
# The paper's
CORRECT, WRONG, FIXED, RANDOM = PAPERS = (
    "Correct",
    "Wrong",
    "Correct w/o stiffness",
    "Random",
)
# The others also try recorded commands at the start of each period
WARM = "Correct, warm start only"
_CONDITIONS = (CORRECT, WRONG, FIXED, WARM, RANDOM)
# Sign of Correct minus another
QUANTITIES = {"rate below 0.5": 1, "minimum distance": -1, "maximum distance": 1}
_THRESHOLD = 0.5  # of the success rate, the paper's [s.d. of z]
VARIANTS: dict[
    str, dict[str, Any]
] = {  # what the hand's speed may depend on, and the paper does not publish
    "as assumed": {},
    "motor speed 0.05 m/s": {"motor_speed": 0.05},
    "motor speed 0.20 m/s": {"motor_speed": 0.20},
    "hinge damping 0.5 N m s/rad": {"hinge_damping": 0.5},
    "hinge damping 2 N m s/rad": {"hinge_damping": 2.0},
}


def _push(spring: str, f_const: float) -> dict[str, Any]:
    """Stiffness ellipse of the hand at a co-contraction [N]: area [m²] for a push of 1
    N, semi-axes [m].
    """
    displacements = stiffness_ellipse(_SPRINGS[spring], POSTURE, f_const)
    axes = np.linalg.svd(displacements, compute_uv=False) * np.sqrt(
        2 / len(displacements)
    )
    return {"area": ellipse_area(displacements), "semi_axes": axes}


def _estimate_recorded(
    model: int, number: int, weights: str = "muscle"
) -> dict[str, Any]:
    """Estimate p from a recorded trial that the training has not seen, by its number."""
    learned, trial = (
        trained(f"{weights}-{model}"),
        data.load_trials(EVALUATION["muscle"])[number],
    )
    p, _ = estimate_bias(learned.model, learned.to_run(trial))
    return {
        "cloth": trial.cloth.name,
        "policy": trial.policy,
        "nearest": nearest_material(p, learned.biases),
        "distance": bias_error(
            p, trial.cloth.name, learned.biases
        ),  # to the right p [spreads of the trained p]
    }


def _estimate_moved(
    cloth: str, model: int, weights: str = "muscle", steps: int = 150
) -> dict[str, Any]:
    """Estimate p of a foam from 0 while it is moved at random, 30 s."""
    learned = trained(f"{weights}-{model}")
    p, trace = estimate_at_random(
        learned, cloth, steps, 16000 + 100 * model + ESTIMATED.index(cloth)
    )
    first, last = (learned.biases[ESTIMATED[end]] for end in (0, -1))
    # Where the last p lies from hard-1 (0) to hard-3 (1).
    return {
        "trace": trace.round(4),
        "place": float(
            (p - first) @ (last - first) / ((last - first) @ (last - first))
        ),
    }


def _control_one(
    condition: str,
    cloth: str,
    model: int,
    weights: str = "muscle",
    steps: int = 125,
    fixed_tension: float = 10.0,
    speed_steps: int = 100,
) -> dict[str, Any]:
    """Distances to the target, commands and the arm's motion under one of the paper's
    conditions; 25 s.

    The paper's "w/o stiffness" is a `fixed_tension` [N]; the hand's peak speed is
    looked for in the first `speed_steps`, 20 s.
    """
    learned, mask = trained(f"{weights}-{model}"), data.load_target("muscle")
    if condition == RANDOM:
        trial = random_trial(learned.arm.name, cloth, steps, 17000 + model)
    else:
        trial = _controlled(condition, cloth, model, weights, steps, fixed_tension)
    distance = target_distance(learned.autoencoder, trial, mask)
    watched = VARIANTS if condition in (CORRECT, FIXED, WARM) else {}
    return {
        "empty": empty_distance(learned.autoencoder, mask),
        "distance": distance.round(
            4
        ),  # [T] [s.d. of z]; the first is that of the foam hanging still
        "rate": float((distance < _THRESHOLD).mean()),
        # For each of VARIANTS [m/s].
        "peak_hand_speed": [
            float(
                replay(trial[:speed_steps], arm=replace(ARM, **change)).hand_speed.max()
            )
            for change in watched.values()
        ],
        # Of model 0: as sent [T, 3] [rad] [rad] [N], and joint angles ten times a step
        # [10 T, 2] [rad].
        "commands": trial.commands.round(4) if model == 0 else [],
        "theta": replay(trial, samples=10).theta.round(4) if model == 0 else [],
    }


def _controlled(
    condition: str,
    cloth: str,
    model: int,
    weights: str,
    steps: int,
    fixed_tension: float,
) -> Trial:
    learned, mask = trained(f"{weights}-{model}"), data.load_target("muscle")
    other = next(each for each in HELD if each != cloth)
    plans = (
        None
        if condition == WARM
        else recorded_plans(data.load_trials(RECORDINGS["muscle"]), seed=model)
    )
    arm = (
        learned.arm.with_stiffness(fixed_tension) if condition == FIXED else learned.arm
    )
    policy = learned.controller(
        mask, other if condition == WRONG else cloth, plans=plans, arm=arm
    )
    return new_trial(policy, learned.arm, cloth, steps, model)


def with_quantities(table: pd.DataFrame) -> pd.DataFrame:
    """`foam_control` with the paper's three quantities, by `QUANTITIES`."""
    columns = (
        table["rate"],
        table["distance"].map(np.min),
        table["distance"].map(np.max),
    )
    return table.assign(**dict(zip(QUANTITIES, columns, strict=True)))


def gap(table: pd.DataFrame, quantity: str, cloth: str, other: str) -> np.ndarray:
    """A column of `foam_control` under Correct minus that under another condition, for
    each training `[models]`.
    """
    foam = table[table["cloth"] == cloth].pivot(
        index="model", columns="condition", values=quantity
    )
    return (foam[CORRECT] - foam[other]).to_numpy()


def speed_gains(table: pd.DataFrame) -> np.ndarray:
    """Peak hand speed with optimised stiffness over that without, minus one, `[foams,
    models, variants]`.
    """
    speeds = [
        np.stack(table[table["condition"] == name]["peak_hand_speed"])
        for name in (CORRECT, FIXED)
    ]
    return np.divide(*speeds).reshape(len(HELD), -1, len(VARIANTS)) - 1


def estimates(table: pd.DataFrame, model: int) -> dict[str, np.ndarray]:
    """p over time of each foam of `foam_estimation` by one training, from p = 0 on `[T
    + 1, D_p]`, by a label.
    """
    found = table[table["model"] == model].set_index("cloth")["trace"].items()
    return {
        f"estimate of {get_cloth(str(cloth)).label}": np.pad(trace, ((1, 0), (0, 0)))
        for cloth, trace in found
    }


def _push_rows(tables: Tables) -> list[Row]:
    """How much co-contraction changes the stiffness."""
    areas = tables["stiffness_ellipse"].pivot(
        index="spring", columns="f_const", values="area"
    )
    nonlinear, linear = areas.loc["nonlinear"], areas.loc["linear"]
    return [
        Row(
            "stiffness_ellipse",
            "stiffness ellipse: area at 10 N over that at 70 N",
            nonlinear[10] / nonlinear[70],
            paper="changes greatly",
            above=2,
            at_least=5,
            note=f"with linear springs, 30 N over 70 N: {linear[30] / linear[70]:.2f}",
        )
    ]


def _recorded_rows(tables: Tables) -> list[Row]:
    """How often the nearest trained p is that of the foam in the hand."""
    table = tables["foam_recorded"]
    label = "foams, recordings not trained on: the nearest trained p is the right one"
    return [
        Row(
            "foam_recorded",
            label,
            100 * (table["nearest"] == table["cloth"]).mean(),
            " %",
            at_least=80,
        )
    ]


def _moved_rows(tables: Tables) -> list[Row]:
    """Whether a foam that was never trained on lies where it belongs."""
    places = tables["foam_estimation"].query("cloth == 'hard-2'")["place"]
    label = f"hard-2, never trained on, lies between hard-1 and hard-3: trainings of {len(places)}"
    count, most = places.between(0, 1, inclusive="neither").sum(), len(places)
    return [
        Row(
            "foam_estimation",
            label,
            count,
            paper="yes",
            above=most / 2,
            at_least=4 / 5 * most,
        )
    ]


def _control_rows(tables: Tables) -> list[Row]:
    """Distance, and share of near steps under each condition, for each foam."""
    return [
        row
        for cloth, runs in tables["foam_control"].groupby("cloth", sort=False)
        for row in _foam(cloth, runs)
    ]


def _foam(cloth: Any, runs: pd.DataFrame) -> list[Row]:
    by_condition = dict([*runs.groupby("condition", sort=False)])
    correct, random = (
        median_best(by_condition[name]["distance"]) for name in (CORRECT, RANDOM)
    )
    rates = ", ".join(
        f"{name} {by_condition[name]['rate'].mean():.0%}" for name in _CONDITIONS
    )
    return [
        Row(
            f"foam_control/{cloth}/distance",
            f"foam {cloth}: best distance a period, median, Correct over Random",
            correct / random,
            paper="Correct better",
            below=1,
            at_most=0.4,
            note=f"{correct:.2f} / {random:.2f}; steps nearer than {_THRESHOLD}: {rates}",
        )
    ]


_PAPER, _MODELS = {"weights": "muscle-paper"}, range(5)
_ELLIPSES = over(spring=_SPRINGS, f_const=TENSIONS)
_RECORDED = over(model=_MODELS, number=range(8))  # as many as the evaluation has
_MOVED = over(cloth=ESTIMATED, model=_MODELS)
_CONTROLLED = over(condition=_CONDITIONS, cloth=HELD, model=_MODELS)
EXPERIMENTS = (
    Experiment("stiffness_ellipse", _push, _ELLIPSES, seconds=2, rows=_push_rows),
    Experiment(
        "foam_recorded",
        _estimate_recorded,
        _RECORDED,
        seconds=7,
        paper=_PAPER,
        rows=_recorded_rows,
    ),
    Experiment(
        "foam_estimation",
        _estimate_moved,
        _MOVED,
        seconds=4,
        paper=_PAPER,
        rows=_moved_rows,
    ),
    Experiment(
        "foam_control",
        _control_one,
        _CONTROLLED,
        seconds=9,
        paper=_PAPER,
        rows=_control_rows,
    ),
)
