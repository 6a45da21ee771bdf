"""The paper's section "Simulation Experiment": every figure, computed from `data/` with fresh simulation.

Seeds: model k is the DPMPB trained with seed k; commands of estimation use 6000 + 100 k, random commands under control
7000 + k, the chamfer run 5000. None occurs in the training data.
"""

from functools import partial

import numpy as np
import reporting
from reporting import row, run_jobs

from clothlab import artifacts
from clothlab.analysis import (
    MaterialReadout,
    best_per_period,
    chamfer_against_z,
    nearest_material,
    principal_axes,
    spread,
    target_distance,
)
from clothlab.autoencoder import decode, encode, iou
from clothlab.cloth import CLOTHS, Cloth, cloth_name
from clothlab.control import ControlPolicy, EstimatingPolicy
from clothlab.dpmpb import to_sequences
from clothlab.env import ClothEnv
from clothlab.estimation import BiasEstimator, estimate_bias
from clothlab.trials import rollout

MODELS = range(5)
ESTIMATION_MODELS, ESTIMATION_STEPS = range(3), 200  # 40 s
CONTROL_STEPS = 250  # 50 s
TARGETS = ("target-1", "target-2")
CONTROL_CLOTHS = (cloth_name(0.03, 0.05), cloth_name(0.07, 0.15))
INTEGRATED_CLOTH, INTEGRATED_START = cloth_name(0.03, 0.10), cloth_name(0.07, 0.15)
BETWEEN = [  # geometric means of neighbouring trained values
    Cloth("between-light", damping=(0.03 * 0.05) ** 0.5, mass=(0.05 * 0.10) ** 0.5),
    Cloth("between-heavy", damping=(0.05 * 0.07) ** 0.5, mass=(0.10 * 0.15) ** 0.5),
]


autoencoder = partial(reporting.load_autoencoder, "torque")
dpmpb = partial(reporting.load_dpmpb, "torque")
random_trial = partial(reporting.random_trial, "torque")


def estimation_run(cloth: Cloth, number: int, k: int) -> dict:
    """Estimate p of a cloth from 0 while it is moved at random."""
    model, biases = dpmpb(k)
    trial = random_trial(cloth, ESTIMATION_STEPS, 6000 + 100 * k + number)
    p, trace = estimate_bias(model, to_sequences(autoencoder(), trial))
    row = {"cloth": cloth.name, "model": k, "trace": trace.round(4).tolist(), "nearest": nearest_material(p, biases)}
    if cloth.name in biases:
        row["distance"] = float(np.linalg.norm(p - biases[cloth.name])) / spread(biases)
    else:
        damping, mass = MaterialReadout.fit(biases, CLOTHS)(p)
        row |= {"damping": damping, "mass": mass, "error": [damping / cloth.damping - 1, mass / cloth.mass - 1]}
    return row


def control_run(target: str, cloth: str, k: int) -> dict:
    """Control with the right p, and random commands, on the same cloth and target."""
    model, biases = dpmpb(k)
    mask = artifacts.load_target(target)
    env = ClothEnv("torque", cloth)
    policy = ControlPolicy(model, autoencoder(), env.arm, mask, biases[cloth])
    control = rollout(env, policy, CONTROL_STEPS, seed=k, name="control")
    env.close()
    distances = {
        "control": target_distance(autoencoder(), control, mask),
        "random": target_distance(autoencoder(), random_trial(cloth, CONTROL_STEPS, 7000 + k), mask),
    }
    row = {"target": target, "cloth": cloth, "model": k, "start": float(distances["control"][0])}
    for name, distance in distances.items():
        row[name] = distance.round(4).tolist()
        row[f"{name}_best"] = best_per_period(distance).round(4).tolist()
    return row


def integrated_run(k: int) -> dict:
    """Estimate and control at once, from a wrong p."""
    model, biases = dpmpb(k)
    mask = artifacts.load_target("target-1")
    env = ClothEnv("torque", INTEGRATED_CLOTH)
    start, goal = biases[INTEGRATED_START], biases[INTEGRATED_CLOTH]
    controller = ControlPolicy(model, autoencoder(), env.arm, mask, start)
    policy = EstimatingPolicy(controller, BiasEstimator(model, start), autoencoder())
    trial = rollout(env, policy, CONTROL_STEPS, seed=k, name="integrated")
    env.close()
    ratio = np.linalg.norm(policy.trace[-1] - goal) / np.linalg.norm(start - goal)
    distance = target_distance(autoencoder(), trial, mask)
    return {
        "model": k,
        "trace": np.round(policy.trace, 4).tolist(),
        "distance": distance.round(4).tolist(),
        "ratio": float(ratio),
    }


def autoencoder_results() -> dict:
    """IoU on evaluation trials, and the correlation with the chamfer distance."""
    images = np.concatenate([trial.images for trial in artifacts.load_trials("evaluation")])
    overlap = iou(decode(autoencoder(), encode(autoencoder(), images)) > 0.5, images)
    visible = images.any(axis=(1, 2))
    trial = random_trial(cloth_name(0.05, 0.10), 450, 5000)
    results = {"iou": float(overlap.mean()), "iou_visible": float(overlap[visible].mean())}
    results["iou_deviation"] = float(overlap.std())
    for target in TARGETS:
        log_chamfer, z_distance = chamfer_against_z(autoencoder(), trial, artifacts.load_target(target))
        results[f"chamfer_{target}"] = {
            "correlation": float(np.corrcoef(log_chamfer, z_distance)[0, 1]),
            "log_chamfer": log_chamfer.round(4).tolist(),
            "z_distance": z_distance.round(4).tolist(),
        }
    return results


def bias_results() -> dict:
    """How well the trained p explains the materials, for each of the five trainings."""
    rows = []
    for k in MODELS:
        _, biases = dpmpb(k)
        readout = MaterialReadout.fit(biases, CLOTHS)
        rows.append(
            {
                "model": k,
                "r2": readout.r2.tolist(),
                "ratio_r2": readout.ratio_r2,
                "pca_share": principal_axes(biases).explained_variance_ratio_.tolist(),
            }
        )
    return {"rows": rows}


def compute(workers: int) -> dict:
    """Run everything, several at once."""
    cloths = [*CLOTHS.values(), *BETWEEN]
    jobs = [(estimation_run, (cloth, number, k)) for k in ESTIMATION_MODELS for number, cloth in enumerate(cloths)]
    jobs += [(control_run, (target, cloth, k)) for target in TARGETS for cloth in CONTROL_CLOTHS for k in MODELS]
    jobs += [(integrated_run, (k,)) for k in MODELS]
    by_kind = run_jobs(jobs, workers)
    estimated = by_kind["estimation_run"]
    return {
        "autoencoder": autoencoder_results(),
        "bias": bias_results(),
        "estimation": [row for row in estimated if "distance" in row],
        "between": [row for row in estimated if "error" in row],
        "control": by_kind["control_run"],
        "integrated": by_kind["integrated_run"],
    }


def table(results: dict) -> list[dict]:
    """The rows of the results table: what, the paper's figure, ours, the bound, and whether ours is within it."""
    rows = []

    def add(*arguments, **options):
        rows.append(row(*arguments, **options))

    ae, estimation = results["autoencoder"], results["estimation"]
    add("autoencoder: mean IoU on evaluation trials", "–", ae["iou"], 0.80)
    add(
        "correlation of z distance and log chamfer distance, Target-2",
        "0.811",
        ae["chamfer_target-2"]["correlation"],
        0.81,
    )
    r2 = np.array([row["r2"] for row in results["bias"]["rows"]])
    for n, name in enumerate(("C_damp", "C_mass")):
        add(
            f"p explains log {name}, leave one cloth out: R²",
            "–",
            r2[:, n].mean(),
            0.9,
            spread=f" ± {r2[:, n].std():.2f}",
        )
    ratio = np.array([row["ratio_r2"] for row in results["bias"]["rows"]])
    add("… and log (C_damp / C_mass), the speed of falling", "–", ratio.mean(), spread=f" ± {ratio.std():.2f}")
    right = np.mean([row["nearest"] == row["cloth"] for row in estimation])
    add("estimation from p = 0, 40 s: nearest trained p is the right one", "–", 100 * right, 70, " %")
    add(
        "… final distance to the right p, in spreads, median",
        "–",
        float(np.median([row["distance"] for row in estimation])),
        0.35,
        at_least=False,
    )
    for n, name in enumerate(("C_damp", "C_mass")):
        errors = np.abs([row["error"][n] for row in results["between"]])
        add(
            f"cloths between the trained ones: largest error of {name} read off p",
            "–",
            100 * errors.max(),
            25,
            " %",
            at_least=False,
            spread=f" (mean {100 * errors.mean():.0f} %)",
        )
    for target in TARGETS:
        for cloth in CONTROL_CLOTHS:
            ours = [row for row in results["control"] if (row["target"], row["cloth"]) == (target, cloth)]
            median = [
                np.median(np.concatenate([row[f"{name}_best"] for row in ours])) for name in ("control", "random")
            ]
            spread_ = np.std([np.median(row["control_best"]) / median[1] for row in ours])
            add(
                f"control, {target}, {cloth}: best distance a period, median, over Random's",
                "Control better",
                median[0] / median[1],
                0.4,
                at_least=False,
                spread=f" ± {spread_:.2f} ({median[0]:.2f} / {median[1]:.2f})",
            )
    ratios = np.array([row["ratio"] for row in results["integrated"]])
    add(
        "integrated: distance to the right p after 50 s, over the start's, mean of five",
        "approaches",
        ratios.mean(),
        1 / 3,
        at_least=False,
        spread=f" ± {ratios.std():.2f}",
    )
    return rows
