"""`make data`: record all trials and targets, about a minute on two cores."""

import argparse
import os
import time
from dataclasses import dataclass
from itertools import product

import joblib
import numpy as np
from tqdm.auto import tqdm

from clothlab import artifacts
from clothlab.cloth import CLOTHS
from clothlab.env import ClothEnv
from clothlab.trials import OperatorPolicy, RandomPolicy, Trial, rollout, save_trial

POLICIES = {"random": RandomPolicy, "operator": OperatorPolicy}


@dataclass(frozen=True)
class Recording:
    """A set of trials: one for each cloth and policy."""

    arm: str
    cloths: tuple[str, ...]
    steps: int
    first_seed: int  # no two trials share a seed


TRAINED_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")  # hard-2 is kept for the estimation of the unknown
RECORDINGS = {
    "train": Recording("torque", tuple(CLOTHS), 250, 1000),  # 50 s, as in the paper
    "evaluation": Recording("torque", tuple(CLOTHS), 200, 2000),
    "muscle-train": Recording("muscle", TRAINED_FOAMS, 400, 11000),  # 80 s, as in the paper
    "muscle-evaluation": Recording("muscle", TRAINED_FOAMS, 200, 12000),
}
TARGET_STEPS = 250
HAND_AHEAD = 0.3  # [m]


def jobs() -> list[tuple[str, str, str, int]]:
    """Every trial to record: name of the recording, cloth, policy, seed."""
    return [
        (name, *pair, recording.first_seed + k)
        for name, recording in RECORDINGS.items()
        for k, pair in enumerate(product(recording.cloths, POLICIES))
    ]


def record(name: str, cloth: str, policy: str, seed: int) -> Trial:
    """Record one trial."""
    env = ClothEnv(RECORDINGS[name].arm, cloth)
    try:
        return rollout(env, POLICIES[policy](env.arm), RECORDINGS[name].steps, seed=seed)
    finally:
        env.close()


def record_all(workers: int, progress: bool = True) -> list[Trial]:
    """Record all trials, several at once."""
    results = joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(record)(*job) for job in jobs())
    return list(tqdm(results, total=len(jobs()), desc="trials", unit="trial", disable=not progress))


def find_moments(arm: str, cloth: str, seed: int) -> tuple[list, list]:
    """Moments `(reach [m], mask)` at which an operator's cloth is spread in the air, and those at which it swings.

    Reach is how far the free edge is from the hand, towards the side on which the front faces up. The cloth is spread
    where that is more than 0.3 m and the edge is level with the hand to 0.1 m; it swings where the edge is below. In
    both the front is in view and the hand well in front of the shoulder, so that the arm hides little.
    """
    env = ClothEnv(arm, cloth)
    points: list[np.ndarray] = []
    steps = TARGET_STEPS + 1  # the image after a step is the one that the next step sees
    watch = lambda: points.append(env.cloth_points())  # noqa: E731
    trial = rollout(env, OperatorPolicy(env.arm), steps, seed=seed, watch=watch, samples=1)
    env.close()
    side = np.sign(env.arm.camera.position[0] - points[0][0, :, 0].mean())
    spread, swinging = [], []
    for after, image in zip(points[:-1], trial.images[1:], strict=True):
        forward, _, up = after[-1].mean(axis=0) - after[0].mean(axis=0)
        if image.any() and after[0, :, 0].mean() > HAND_AHEAD:
            moment = (side * forward, image)
            if side * forward > 0.3 and abs(up) < 0.1:
                spread.append(moment)
            elif up < -0.1:
                swinging.append(moment)
    return spread, swinging


def find_targets() -> dict[str, np.ndarray]:
    """Choose the target images by geometry alone, from an operator's runs that nothing else uses.

    Target-1 (hard) and the muscle arm's target are the median of all moments at which the cloth is spread, not the
    widest: a record is hard to repeat even for who set it. Target-2 (easier) swings half as far, its free edge below
    the hand.
    """
    found = [find_moments("torque", "damp0.05-mass0.10", seed) for seed in range(3000, 3004)]
    spread, swinging = ([moment for run in found for moment in run[kind]] for kind in (0, 1))
    spread = sorted(spread, key=lambda moment: moment[0])
    median, target_1 = spread[len(spread) // 2]
    _, target_2 = min(swinging, key=lambda moment: abs(moment[0] - median / 2))
    foams = [moment for foam in TRAINED_FOAMS for moment in find_moments("muscle", foam, 13000)[0]]
    whole = [  # a near camera cuts some
        mask
        for _, mask in sorted(foams, key=lambda moment: moment[0])
        if not (mask[[0, -1]].any() or mask[:, [0, -1]].any())
    ]
    return {"target-1": target_1, "target-2": target_2, "muscle": whole[len(whole) // 2]}


def main() -> None:
    """Record everything and write it to `data/`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    workers = parser.parse_args().workers
    start = time.perf_counter()
    for (name, cloth, policy, _), trial in zip(jobs(), record_all(workers), strict=True):
        save_trial(trial, artifacts.data_folder() / "trials" / name / f"{cloth}_{policy}.npz")
    targets = find_targets()
    for name, mask in targets.items():
        artifacts.save_target(mask, name)
    artifacts.write_checksums()
    print(f"{len(jobs())} trials and {len(targets)} targets in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
