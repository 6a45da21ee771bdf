"""What is recorded, and from which seeds.

Sets of trials, and targets that are chosen from runs of their own.
"""

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import cv2
import numpy as np

from clothlab._files import write_bytes
from clothlab._validation import choose
from clothlab.data import Folder, data_folder
from clothlab.method.rollout import Policy
from clothlab.policies import OperatorPolicy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.trials import Trial, rollout, save_trial
from studies._parallel import side_by_side
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


class _Moment(NamedTuple):
    """One of an operator's run."""

    reach: float  # how far the free edge is from the hand [m]
    mask: np.ndarray  # [H, W]


class _OperatorRun(NamedTuple):
    """What was seen of an operator's run, and where the cloth was then."""

    images: np.ndarray  # [T, H, W]
    points: np.ndarray  # of the cloth [T, rows, columns, 3] [m]


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
    # Onto the table; a trial's outcome says whether the cloth came to lie spread there
    throws: bool = False
    # So often is a throw repeated that spread the cloth, from other starts
    again: int = 0

    def runs(self) -> dict[str, dict[str, Any]]:
        """Cloth, policy and seed of each trial, by the name of its file.

        The repeat changes slowest.
        """
        found = {}
        seed = self.first_seed
        for repeat, cloth, policy in product(
            range(self.repeats), self.cloths, self.policies
        ):
            file = f"{cloth}_{policy}"
            if self.repeats > 1:
                file = f"{repeat:02}_{file}"
            found[file] = {"cloth": cloth, "policy": policy, "seed": seed}
            seed += 1
        return found


_ALL = tuple(CLOTHS)
_HAND = "muscle-hand"
_SETS = (
    Dataset("train", "torque", _ALL, 250, 1000),  # 50 s, as in the paper
    Dataset("train-more", "torque", _ALL, 250, 100_000, repeats=19),
    Dataset("evaluation", "torque", _ALL, 200, 2000),
    # 80 s, as in the paper
    Dataset("muscle-train", "muscle", _TRAINED_FOAMS, 400, 11000),
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


def record(
    dataset: Dataset, *, anew: bool = True, data: Folder = None, **options: Any
) -> list[str]:
    """Record a set of trials and save each as soon as it is made.

    Args:
        dataset: the set.
        anew: whether trials are recorded that are there already.
        data: the data folder.
        options: those of `side_by_side`.

    Returns:
        The files, from the data folder.
    """
    folder = f"trials/{dataset.name}"
    there = data_folder(data) / folder
    runs = dataset.runs()
    if not anew:
        runs = {k: run for k, run in runs.items() if not (there / f"{k}.npz").exists()}
    calls = [{"dataset": dataset, **run} for run in runs.values()]
    files = []
    recorded = side_by_side(record_run, calls, folder, **options)
    for name, (first, *repeated) in zip(runs, recorded, strict=True):
        # The first one last: where it is, all of them are
        trials = {f"{name}_again{k}": each for k, each in enumerate(repeated, start=1)}
        for file, trial in (trials | {name: first}).items():
            save_trial(trial, there / f"{file}.npz")
            files.append(f"{folder}/{file}.npz")
    return files


def record_run(dataset: Dataset, cloth: str, policy: str, seed: int) -> list[Trial]:
    """Record one trial.

    Behind it come, of a throw that spread the cloth, its repetitions.
    """
    policy_of = choose("policy", policy, _POLICIES)

    # In the air one trial is all
    if not dataset.throws:
        with closing(ClothEnv(dataset.arm, cloth)) as env:
            return [rollout(env, policy_of(env.arm), dataset.steps, seed=seed)]

    # Onto the table
    with closing(TableEnv(dataset.arm, cloth, start_in="hand")) as env:
        first = _throw(env, policy_of(env.arm), dataset, seed)
        trials = [first]
        if was_spread(first):
            for k in range(1, dataset.again + 1):
                replay = ReplayPolicy(first.commands)
                trials.append(_throw(env, replay, dataset, _REPEATED_SEED * k + seed))
        return trials


def _throw(env: TableEnv, policy: Policy, dataset: Dataset, seed: int) -> Trial:
    """Record one throw, and look how the cloth lies after it."""
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


_TABLES = (cloth_name(0.03, 0.05), cloth_name(0.07, 0.15))
_OTHERS = (cloth_name(0.05, 0.10), cloth_name(0.03, 0.15), cloth_name(0.07, 0.05))
TARGET_SETS = (
    TargetSet("held-out", "torque", _TABLES, 3200, varied=10),
    # Methods of control were chosen on these, and no table has them.
    TargetSet("development", "torque", _OTHERS, 3100, varied=2, spread=True),
)
_RUNS = 4  # of the operator with each cloth


def save_targets(found: Mapping[str, np.ndarray]) -> list[str]:
    """Save targets by their names; returned are the files, from the data folder."""
    for name, mask in found.items():
        _, content = cv2.imencode(".png", mask.astype(np.uint8) * 255)
        write_bytes(data_folder() / "targets" / f"{name}.png", content.tobytes())
    return [f"targets/{name}.png" for name in found]


def find_targets(
    steps: int = 250,
    seeds: Sequence[int] = range(3000, 3004),
    foams: Sequence[str] = _TRAINED_FOAMS,
) -> dict[str, np.ndarray]:
    """Choose target-1, target-2 and the muscle arm's by geometry alone.

    They are from an operator's runs that nothing else uses. Target-1 (hard) and the
    muscle arm's target are the median of all moments at which the cloth is spread.
    Target-2 (easier) swings half as far, its free edge below the hand.
    """
    # The torque arm's
    spread: list[_Moment] = []
    swinging: list[_Moment] = []
    for seed in seeds:
        run = _record_operator("torque", "damp0.05-mass0.10", seed, steps)
        spread += _spread_moments("torque", run)
        swinging += _swinging_moments("torque", run)
    hard = _median(spread)
    easy = min(swinging, key=lambda moment: abs(moment.reach - hard.reach / 2))

    # The muscle arm's, whose near camera cuts some pictures
    held: list[_Moment] = []
    for foam in foams:
        run = _record_operator("muscle", foam, 13000, steps)
        held += _spread_moments("muscle", run)
    whole = [moment for moment in held if _in_view(moment.mask)]
    return {"target-1": hard.mask, "target-2": easy.mask, "muscle": _median(whole).mask}


def find_target_set(targets: TargetSet) -> dict[str, np.ndarray]:
    """Targets `{SET/ARM_CLOTH_K: mask}` out of an operator's runs.

    From all moments at which the whole cloth is in the picture.
    """
    found: dict[str, np.ndarray] = {}
    first_seed = targets.first_seed
    for cloth in targets.cloths:
        # Each cloth has seeds of its own
        seeds = range(first_seed, first_seed + _RUNS)
        first_seed += _RUNS
        runs = [_record_operator(targets.arm, cloth, seed) for seed in seeds]

        # Masks that stand for all
        images = np.concatenate([run.images for run in runs])
        whole = images[[_in_view(image) for image in images]]
        chosen = [*choose_varied(whole, targets.varied)]

        # And one of a spread cloth
        if targets.spread:
            moments = [m for run in runs for m in _spread_moments(targets.arm, run)]
            spread = [moment for moment in moments if _in_view(moment.mask)]
            chosen += [_median(spread).mask] if spread else []
        for number, mask in enumerate(chosen):
            found[f"{targets.name}/{targets.arm}_{cloth}_{number}"] = mask
    return found


def _record_operator(arm: str, cloth: str, seed: int, steps: int = 250) -> _OperatorRun:
    points: list[np.ndarray] = []
    with closing(ClothEnv(arm, cloth)) as env:
        # One more, since the image after a step is the one that the next step sees.
        trial = rollout(
            env,
            OperatorPolicy(env.arm),
            steps + 1,
            seed=seed,
            watch=lambda: points.append(env.cloth_points()),
            samples=1,
        )
    return _OperatorRun(trial.images[1:], np.array(points[:-1]))


def _moments(arm: str, run: _OperatorRun) -> list[tuple[_Moment, float]]:
    """Moments of a run, and how far the free edge is above the hand then [m].

    Reach is towards the side on which the front faces up. Only moments at which the
    front is in view and the hand at least 0.3 m in front of the shoulder, so that the
    arm hides little.
    """
    hand = run.points[0, 0, :, 0].mean()
    side = np.sign(get_arm(arm).camera.position[0] - hand)
    found = []
    for points, image in zip(run.points, run.images, strict=True):
        if image.any() and points[0, :, 0].mean() > 0.3:
            forward, _, up = points[-1].mean(axis=0) - points[0].mean(axis=0)
            found.append((_Moment(side * forward, image), up))
    return found


def _is_spread(moment: _Moment, up: float) -> bool:
    """Whether the edge is more than 0.3 m away, and level with the hand to 0.1 m."""
    return moment.reach > 0.3 and abs(up) < 0.1


def _spread_moments(arm: str, run: _OperatorRun) -> list[_Moment]:
    """Moments at which the cloth is spread in the air."""
    return [moment for moment, up in _moments(arm, run) if _is_spread(moment, up)]


def _swinging_moments(arm: str, run: _OperatorRun) -> list[_Moment]:
    """Moments at which the cloth swings, its free edge below the hand."""
    return [moment for moment, up in _moments(arm, run) if up < -0.1]


def _median(moments: list[_Moment]) -> _Moment:
    """The moment of the median reach.

    Not the widest, which even the operator hardly repeats.
    """
    return sorted(moments, key=lambda moment: moment.reach)[len(moments) // 2]


def _in_view(mask: np.ndarray) -> bool:
    """Whether the cloth's front is in view, and no border of the picture cuts it."""
    border = mask[[0, -1]].any() or mask[:, [0, -1]].any()
    return bool(mask.any() and not border)


def choose_varied(masks: np.ndarray, number: int) -> np.ndarray:
    """Choose masks `[number, H, W]` that stand for all `[N, H, W]`.

    By area and place, from small to large: area, column and row of the centre are
    standardised, k-means makes groups of what is alike, and of each group the mask
    nearest to its mean is taken.
    """
    from sklearn.cluster import KMeans  # slow to import

    features = _area_and_centre(masks)
    standardised = (features - features.mean(axis=0)) / features.std(axis=0)
    groups = KMeans(number, n_init=10, random_state=0)
    distance = groups.fit_transform(standardised)  # [N, number]

    # Of its own group, so that none is taken twice
    distance[groups.labels_[:, None] != np.arange(number)] = np.inf
    chosen = distance.argmin(axis=0)
    from_small = np.argsort(features[chosen, 0], kind="stable")
    return masks[chosen[from_small]]


def _area_and_centre(masks: np.ndarray) -> np.ndarray:
    """Area of masks `[N, H, W]`, column and row of their centres: `[N, 3]` [pixel]."""
    area = masks.sum(axis=(1, 2))
    column = (masks.sum(axis=1) * np.arange(masks.shape[2])).sum(axis=1) / area
    row = (masks.sum(axis=2) * np.arange(masks.shape[1])).sum(axis=1) / area
    return np.stack([area, column, row], axis=1)
