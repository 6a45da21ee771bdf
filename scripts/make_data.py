"""`make data`: record all trials and targets, about a minute on two cores."""

import argparse
import os
import time
from collections.abc import Iterable
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
        return rollout(env, POLICIES[policy](env.arm, seed=seed), RECORDINGS[name].steps, seed=seed, name=policy)
    finally:
        env.close()


def record_all(workers: int, progress: bool = True) -> list[Trial]:
    """Record all trials, several at once."""
    results = joblib.Parallel(n_jobs=workers, return_as="generator")(joblib.delayed(record)(*job) for job in jobs())
    return list(tqdm(results, total=len(jobs()), desc="trials", unit="trial", disable=not progress))


def find_moments(arm: str, cloths: Iterable[str], seeds: Iterable[int]) -> tuple[list, list]:
    """Moments `(reach [m], mask)` at which an operator's cloth is spread in the air, and those at which it swings.

    Reach is how far the free edge is from the hand, towards the side on which the front faces up. The cloth is spread
    where that is more than 0.3 m and the edge is level with the hand to 0.1 m; it swings where the edge is below. In
    both the front is in view and the hand well in front of the shoulder, so that the arm hides little.
    """
    spread, swinging = [], []
    for cloth, seed in product(cloths, seeds):
        env = ClothEnv(arm, cloth)
        policy = OperatorPolicy(env.arm, seed=seed)
        observation, _ = env.reset(seed=seed)
        side = np.sign(env.arm.camera.position[0] - env.cloth_points()[0, :, 0].mean())
        for _ in range(TARGET_STEPS):
            observation, *_ = env.step(policy(observation))
            points = env.cloth_points()
            forward, _, up = points[-1].mean(axis=0) - points[0].mean(axis=0)
            if observation["image"].any() and points[0, :, 0].mean() > HAND_AHEAD:
                moment = (side * forward, observation["image"].astype(bool))
                if side * forward > 0.3 and abs(up) < 0.1:
                    spread.append(moment)
                elif up < -0.1:
                    swinging.append(moment)
        env.close()
    return sorted(spread, key=lambda moment: moment[0]), swinging


def find_targets() -> dict[str, np.ndarray]:
    """Choose the target images by geometry alone, from an operator's runs that nothing else uses.

    Target-1 (hard) and the muscle arm's target are the median of all moments at which the cloth is spread, not the
    widest: a record is hard to repeat even for who set it. Target-2 (easier) swings half as far, its free edge below
    the hand.
    """
    spread, swinging = find_moments("torque", ["damp0.05-mass0.10"], range(3000, 3004))
    median, target_1 = spread[len(spread) // 2]
    _, target_2 = min(swinging, key=lambda moment: abs(moment[0] - median / 2))
    foams, _ = find_moments("muscle", TRAINED_FOAMS, [13000])
    whole = [
        mask for _, mask in foams if not (mask[[0, -1]].any() or mask[:, [0, -1]].any())
    ]  # a near camera cuts some
    return {"target-1": target_1, "target-2": target_2, "muscle": whole[len(whole) // 2]}


def main() -> None:
    """Record everything and write it to `data/`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    workers = parser.parse_args().workers
    start = time.perf_counter()
    for (name, cloth, policy, _), trial in zip(jobs(), record_all(workers), strict=True):
        save_trial(trial, artifacts.DATA / "trials" / name / f"{cloth}_{policy}.npz")
    targets = find_targets()
    for name, mask in targets.items():
        artifacts.save_target(mask, name)
    artifacts.write_checksums()
    print(f"{len(jobs())} trials and {len(targets)} targets in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
