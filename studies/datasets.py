"""What is recorded, and from which seeds: sets of trials, and targets that are chosen
from runs of their own.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from sklearn.cluster import KMeans

from clothlab._validation import check_kind, check_seed, choose
from clothlab.data import Folder, data_folder, save_target
from clothlab.method.policy import Policy
from clothlab.policies import OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, rollout, save_trial
from studies._parallel import Job, run_jobs
from studies.table_scene.table_env import TableEnv
from studies.table_scene.throwing import (
    ExcitationPolicy,
    OperatorThrow,
    RandomThrow,
    label_spread,
    see_cloth_pose,
    was_spread,
)

_POLICIES = {
    "random": RandomPolicy,
    "operator": OperatorPolicy,
    "random-throw": RandomThrow,
    "throw": OperatorThrow,
    "swing": ExcitationPolicy,
}
# Hard-2 is kept for the estimation of an unknown foam
_TRAINED_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")
_REPEATED_SEED = 1_000_000  # added to a throw's seed each time that it is repeated
_Moment = tuple[float, np.ndarray]  # of an operator's run: reach of the cloth [m], mask


@dataclass(frozen=True)
class Dataset:
    """A set of trials, in a folder of its name."""

    name: str
    arm: str
    cloths: tuple[str, ...]
    steps: int  # of each trial
    first_seed: int  # no two trials share a seed
    repeats: int = 1  # with each cloth and policy
    policies: tuple[str, ...] = ("random", "operator")
    # Onto the table; the trial's policy says whether the cloth came to lie spread there
    throws: bool = False
    again: int = (
        0  # so often is a throw repeated that spread the cloth, from other starts
    )

    def runs(self) -> dict[str, dict[str, Any]]:
        """Cloth, policy and seed of each trial, by the name of its file; the repeat
        changes slowest.
        """
        found = {}
        for k, (repeat, cloth, policy) in enumerate(
            product(range(self.repeats), self.cloths, self.policies)
        ):
            file = (
                f"{repeat:02}_{cloth}_{policy}"
                if self.repeats > 1
                else f"{cloth}_{policy}"
            )
            found[file] = {
                "cloth": cloth,
                "policy": policy,
                "seed": self.first_seed + k,
            }
        return found


_ALL, _HAND = tuple(CLOTHS), "muscle-hand"
_SETS = (
    Dataset("train", "torque", _ALL, 250, 1000),  # 50 s, as in the paper
    Dataset("train-more", "torque", _ALL, 250, 100_000, repeats=19),
    Dataset("evaluation", "torque", _ALL, 200, 2000),
    Dataset(
        "muscle-train", "muscle", _TRAINED_FOAMS, 400, 11000
    ),  # 80 s, as in the paper
    Dataset("muscle-train-more", "muscle", _TRAINED_FOAMS, 400, 200_000, repeats=19),
    Dataset("muscle-evaluation", "muscle", _TRAINED_FOAMS, 200, 12000),
    # Short: a cloth that was let go does not come back.
    Dataset(
        "table-throws",
        _HAND,
        _TRAINED_FOAMS,
        20,
        300_000,
        50,
        ("throw",),
        throws=True,
        again=4,
    ),
    Dataset(
        "table-random",
        _HAND,
        _TRAINED_FOAMS,
        20,
        310_000,
        15,
        ("random-throw",),
        throws=True,
    ),
    Dataset(
        "table-swings", _HAND, _TRAINED_FOAMS, 40, 320_000, 14, ("swing",), throws=True
    ),
)
DATASETS = {each.name: each for each in _SETS}


def record(dataset: Dataset, *, data: Folder = None, **options: Any) -> list[str]:
    """Record a set of trials and save each as soon as it is made; options as `run_jobs`
    has them. Returns the files.
    """
    runs, files = dataset.runs(), []
    jobs = [Job(record_run, {"dataset": dataset, **run}) for run in runs.values()]
    for name, trials in zip(
        runs, run_jobs(f"trials/{dataset.name}", jobs, **options), strict=True
    ):
        for k, trial in enumerate(trials):
            files.append(f"trials/{dataset.name}/{name}{f'_again{k}' if k else ''}.npz")
            save_trial(trial, data_folder(data) / files[-1])
    return files


def record_run(dataset: Dataset, cloth: str, policy: str, seed: int) -> list[Trial]:
    """Record one trial; and behind it, of a throw that spread the cloth, its
    repetitions.
    """
    check_kind("dataset", dataset, Dataset)
    choose("policy", policy, _POLICIES)
    check_seed(seed)
    if not dataset.throws:
        with closing(ClothEnv(dataset.arm, cloth)) as env:
            return [rollout(env, _POLICIES[policy](env.arm), dataset.steps, seed=seed)]
    with closing(TableEnv(dataset.arm, cloth, start_in="hand")) as env:
        trials = [_throw(env, _POLICIES[policy](env.arm), dataset, seed)]
        for k in range(1, dataset.again + 1) if was_spread(trials[0]) else ():
            trials.append(
                _throw(
                    env,
                    ReplayPolicy(trials[0].commands),
                    dataset,
                    _REPEATED_SEED * k + seed,
                )
            )
        return trials


def _throw(env: TableEnv, policy: Policy, dataset: Dataset, seed: int) -> Trial:
    trial = rollout(env, policy, dataset.steps, seed=seed)
    # The scene with the table starts the arm in a posture of its own. That makes it no
    # other arm.
    trial = replace(trial, arm=get_arm(dataset.arm))
    seen = None if env.held else see_cloth_pose(env)
    return label_spread(trial, seen is not None and seen.spread)


@dataclass(frozen=True)
class TargetSet:
    """Targets that an operator's cloth passes through, in a folder of their name."""

    name: str
    arm: str
    cloths: tuple[str, ...]
    first_seed: int  # no two runs share a seed
    varied: int  # so many of each cloth that stand for all moments
    spread: bool = False  # and the median of those at which it is spread, if it ever is


_TABLES = cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)
_OTHERS = cloth_name(0.05, 0.10), cloth_name(0.03, 0.15), cloth_name(0.07, 0.05)
TARGET_SETS = (
    TargetSet("held-out", "torque", _TABLES, 3200, varied=10),
    # Methods of control were chosen on these, and no table has them.
    TargetSet("development", "torque", _OTHERS, 3100, varied=2, spread=True),
    TargetSet(
        "development", "muscle", ("hard-3", "soft-2"), 13100, varied=2, spread=True
    ),
)
_RUNS = 4  # of the operator with each cloth


def record_targets(jobs: Sequence[Job], **options: Any) -> list[str]:
    """Find targets by `find_targets` or `find_target_set` and save them; options as
    `run_jobs` has them.
    """
    found = {
        name: mask
        for part in run_jobs("targets", jobs, **options)
        for name, mask in part.items()
    }
    for name, mask in found.items():
        save_target(mask, name)
    return [f"targets/{name}.png" for name in found]


def find_targets(
    steps: int = 250,
    seeds: Sequence[int] = range(3000, 3004),
    foams: Sequence[str] = _TRAINED_FOAMS,
) -> dict[str, np.ndarray]:
    """Choose target-1, target-2 and the muscle arm's by geometry alone, from an
    operator's runs that nothing else uses.

    Target-1 (hard) and the muscle arm's target are the median of all moments at which
    the cloth is spread. Target-2 (easier) swings half as far, its free edge below the
    hand.
    """
    runs = [
        _record_operator("torque", "damp0.05-mass0.10", seed, steps) for seed in seeds
    ]
    found = [_spread_and_swinging("torque", *run) for run in runs]
    spread, swinging = (
        [moment for run in found for moment in run[kind]] for kind in (0, 1)
    )
    reach, target_1 = _median(spread)
    _, target_2 = min(swinging, key=lambda moment: abs(moment[0] - reach / 2))
    held = [
        _spread_and_swinging("muscle", *_record_operator("muscle", foam, 13000, steps))
        for foam in foams
    ]
    # a near camera cuts some
    whole = [moment for spread, _ in held for moment in spread if _in_view(moment[1])]
    return {"target-1": target_1, "target-2": target_2, "muscle": _median(whole)[1]}


def find_target_set(targets: TargetSet) -> dict[str, np.ndarray]:
    """Targets `{SET/ARM_CLOTH_K: mask}`, out of all moments at which the whole cloth is
    in the picture.
    """
    found: dict[str, np.ndarray] = {}
    for k, cloth in enumerate(targets.cloths):
        seeds = range(
            targets.first_seed + _RUNS * k, targets.first_seed + _RUNS * (k + 1)
        )
        runs = [_record_operator(targets.arm, cloth, seed) for seed in seeds]
        whole = np.array(
            [image for images, _ in runs for image in images if _in_view(image)]
        )
        chosen = list(choose_varied(whole, targets.varied))
        spread = [
            each
            for run in runs
            for each in _spread_and_swinging(targets.arm, *run)[0]
            if _in_view(each[1])
        ]
        if targets.spread and spread:
            chosen.append(_median(spread)[1])
        found |= {
            f"{targets.name}/{targets.arm}_{cloth}_{number}": mask
            for number, mask in enumerate(chosen)
        }
    return found


def _record_operator(
    arm: str, cloth: str, seed: int, steps: int = 250
) -> tuple[np.ndarray, np.ndarray]:
    """An operator's run: images `[T, H, W]`, and where the points are then `[T, rows,
    columns, 3]` [m].
    """
    points: list[np.ndarray] = []
    with closing(ClothEnv(arm, cloth)) as env:
        watch = lambda: points.append(env.cloth_points())  # noqa: E731
        # One more, since the image after a step is the one that the next step sees.
        trial = rollout(
            env, OperatorPolicy(env.arm), steps + 1, seed=seed, watch=watch, samples=1
        )
    return trial.images[1:], np.array(points[:-1])


def _spread_and_swinging(
    arm: str, images: np.ndarray, points: np.ndarray
) -> tuple[list[_Moment], list[_Moment]]:
    """Moments of an operator's run at which the cloth is spread in the air, and at
    which it swings.

    Reach is how far the free edge is from the hand, towards the side on which the front
    faces up. The cloth is spread where that is more than 0.3 m and the edge is level
    with the hand to 0.1 m; it swings where the edge is below. In both the front is in
    view and the hand at least 0.3 m in front of the shoulder, so that the arm hides
    little.
    """
    side = np.sign(get_arm(arm).camera.position[0] - points[0, 0, :, 0].mean())
    spread, swinging = [], []
    for after, image in zip(points, images, strict=True):
        forward, _, up = after[-1].mean(axis=0) - after[0].mean(axis=0)
        if image.any() and after[0, :, 0].mean() > 0.3:
            moment = (side * forward, image)
            if side * forward > 0.3 and abs(up) < 0.1:
                spread.append(moment)
            elif up < -0.1:
                swinging.append(moment)
    return spread, swinging


def _median(moments: list[_Moment]) -> _Moment:
    """The moment of the median reach: not the widest, which even the operator hardly
    repeats.
    """
    return sorted(moments, key=lambda moment: moment[0])[len(moments) // 2]


def _in_view(mask: np.ndarray) -> bool:
    """Whether the front of the cloth is in view, and the picture's border cuts nothing
    off.
    """
    return bool(mask.any() and not (mask[[0, -1]].any() or mask[:, [0, -1]].any()))


def choose_varied(masks: np.ndarray, number: int) -> np.ndarray:
    """Choose masks `[number, H, W]` that stand for all `[N, H, W]` by area and place,
    from small to large.

    Area, column and row of the centre are standardised, k-means makes groups of what is
    alike, and of each group the mask nearest to its mean is taken.
    """
    features = _area_and_centre(masks)
    groups = KMeans(number, n_init=10, random_state=0)
    # [N, number]
    distance = groups.fit_transform(
        (features - features.mean(axis=0)) / features.std(axis=0)
    )
    # Of its own group, so that none is taken twice
    distance[groups.labels_[:, None] != np.arange(number)] = np.inf
    chosen = distance.argmin(axis=0)
    return masks[chosen[np.argsort(features[chosen, 0], kind="stable")]]


def _area_and_centre(masks: np.ndarray) -> np.ndarray:
    """Area [pixel] of each mask `[N, H, W]`, and column and row [pixel] of its centre:
    `[N, 3]`.
    """
    area = masks.sum(axis=(1, 2))
    column = (masks.sum(axis=1) * np.arange(masks.shape[2])).sum(axis=1) / area
    row = (masks.sum(axis=2) * np.arange(masks.shape[1])).sum(axis=1) / area
    return np.stack([area, column, row], axis=1)
