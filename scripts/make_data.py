"""`make data`: record all trials and targets, about eight minutes on two cores."""

import argparse
import os
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path

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
    """A set of trials: some for each cloth and policy."""

    arm: str
    cloths: tuple[str, ...]
    steps: int
    first_seed: int  # no two trials share a seed
    repeats: int = 1  # with each cloth and policy


TRAINED_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")  # hard-2 is kept for the estimation of the unknown
RECORDINGS = {
    "train": Recording("torque", tuple(CLOTHS), 250, 1000),  # 50 s, as in the paper
    "train-more": Recording("torque", tuple(CLOTHS), 250, 100_000, repeats=19),
    "evaluation": Recording("torque", tuple(CLOTHS), 200, 2000),
    "muscle-train": Recording("muscle", TRAINED_FOAMS, 400, 11000),  # 80 s, as in the paper
    "muscle-train-more": Recording("muscle", TRAINED_FOAMS, 400, 200_000, repeats=19),
    "muscle-evaluation": Recording("muscle", TRAINED_FOAMS, 200, 12000),
}
TARGET_STEPS = 250
HAND_AHEAD = 0.3  # [m]


def jobs() -> list[tuple[Path, Recording, str, str, int]]:
    """Every trial to record: its file within `data/trials`, of which recording, cloth, policy, seed."""
    found = []
    for name, recording in RECORDINGS.items():
        # The last repeat changes slowest: the first files of a set are whole sets of cloths and policies themselves.
        for k, (repeat, cloth, policy) in enumerate(product(range(recording.repeats), recording.cloths, POLICIES)):
            file = f"{repeat:02}_{cloth}_{policy}.npz" if recording.repeats > 1 else f"{cloth}_{policy}.npz"
            found.append((Path(name) / file, recording, cloth, policy, recording.first_seed + k))
    return found


def record(path: Path, recording: Recording, cloth: str, policy: str, seed: int) -> None:
    """Record one trial and save it."""
    env = ClothEnv(recording.arm, cloth)
    try:
        trial = rollout(env, POLICIES[policy](env.arm), recording.steps, seed=seed)
    finally:
        env.close()
    save_trial(trial, artifacts.data_folder() / "trials" / path)


def record_all(workers: int, progress: bool = True) -> None:
    """Record all trials, several at once."""
    done = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(
        joblib.delayed(record)(*job) for job in jobs()
    )
    for _ in tqdm(done, total=len(jobs()), desc="trials", unit="trial", disable=not progress):
        pass


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
    record_all(workers)
    targets = find_targets()
    for name, mask in targets.items():
        artifacts.save_target(mask, name)
    artifacts.write_checksums()
    print(f"{len(jobs())} trials and {len(targets)} targets in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
