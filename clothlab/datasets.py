"""What is recorded, and from which seeds: sets of trials, and the targets that are looked for in runs of their own."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from sklearn.cluster import KMeans
from tqdm.auto import tqdm

from clothlab._validation import choose
from clothlab.policies import OperatorPolicy, Policy, RandomPolicy, ReplayPolicy
from clothlab.simulation.arm import get_arm
from clothlab.simulation.cloth import CLOTHS, cloth_name
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import HEIGHT, WIDTH
from clothlab.table_scene.table_env import TableEnv
from clothlab.table_scene.throwing import (
    ExcitationPolicy,
    OperatorThrow,
    RandomThrow,
    label_spread,
    see_cloth_pose,
    was_spread,
)
from clothlab.trials import Trial, rollout, save_trial

POLICIES = {
    "random": RandomPolicy,
    "operator": OperatorPolicy,
    "random-throw": RandomThrow,
    "throw": OperatorThrow,
    "swing": ExcitationPolicy,
}


@dataclass(frozen=True)
class Recording:
    """A set of trials: some for each cloth and policy."""

    arm: str
    cloths: tuple[str, ...]
    steps: int
    first_seed: int  # no two trials share a seed
    repeats: int = 1  # with each cloth and policy
    policies: tuple[str, ...] = ("random", "operator")
    over_table: bool = False  # the cloth is thrown on a table, and somebody writes down whether it lies as it should
    again: int = 0  # so often is a throw repeated that spread the cloth: was it luck?


TRAINED_FOAMS = ("soft-1", "soft-2", "hard-1", "hard-3")  # hard-2 is kept for the estimation of the unknown
RECORDINGS = {
    "train": Recording("torque", tuple(CLOTHS), 250, 1000),  # 50 s, as in the paper
    "train-more": Recording("torque", tuple(CLOTHS), 250, 100_000, repeats=19),
    "evaluation": Recording("torque", tuple(CLOTHS), 200, 2000),
    "muscle-train": Recording("muscle", TRAINED_FOAMS, 400, 11000),  # 80 s, as in the paper
    "muscle-train-more": Recording("muscle", TRAINED_FOAMS, 400, 200_000, repeats=19),
    "muscle-evaluation": Recording("muscle", TRAINED_FOAMS, 200, 12000),
    # Short: a cloth that was let go does not come back.
    "table-throws": Recording("muscle-hand", TRAINED_FOAMS, 20, 300_000, 50, ("throw",), over_table=True, again=4),
    "table-random": Recording("muscle-hand", TRAINED_FOAMS, 20, 310_000, 15, ("random-throw",), over_table=True),
    "table-swings": Recording("muscle-hand", TRAINED_FOAMS, 40, 320_000, 14, ("swing",), over_table=True),
}
AGAIN = 1_000_000  # added to the seed of a throw that is repeated
TARGET_STEPS = 250
HAND_AHEAD = 0.3  # [m]


@dataclass(frozen=True)
class Views:
    """Targets that an operator's cloth passes through, from `RUNS` runs with each cloth that nothing else uses."""

    arm: str
    cloths: tuple[str, ...]
    first_seed: int  # no two runs share a seed
    varied: int  # so many of each cloth that stand for all moments
    spread: bool = False  # and the median of those at which it is spread, where it ever is


RUNS = 4
VIEWS = {
    "held-out": (Views("torque", (cloth_name(0.03, 0.05), cloth_name(0.07, 0.15)), 3200, varied=10),),
    "development": (  # methods of control are chosen on these, and no table has them
        Views("torque", (cloth_name(0.05, 0.10), cloth_name(0.03, 0.15), cloth_name(0.07, 0.05)), 3100, 2, spread=True),
        Views("muscle", ("hard-3", "soft-2"), 13100, 2, spread=True),
    ),
}
Job = tuple[Path, Recording, str, str, int]  # file within `data/trials`, of which recording, cloth, policy, seed
Stroke = tuple[tuple[float, float], ...]  # where the pointer went, column and row [pixel]
DRAWN: dict[str, tuple[float, tuple[Stroke, ...]]] = {  # radius of the brush [pixel], strokes
    "arch": (4, (((53, 68), (55, 56), (60, 48), (68, 45), (76, 48), (81, 56), (83, 68)),)),
    "bar": (7, (((64, 54), (92, 54)),)),
    "blob": (12, (((67, 62), (72, 66)),)),
    "bowl": (5, (((54, 50), (57, 60), (64, 66), (73, 66), (80, 60), (84, 50)),)),
    "column": (8, (((65, 36), (65, 66)),)),
    "corner": (5, (((62, 38), (62, 68), (82, 68)),)),
    "high": (7, (((50, 28), (76, 22)),)),
    "slope": (7, (((62, 44), (84, 70)),)),
    "triangle": (
        3,
        (((57, 42), (88, 50), (64, 70), (57, 42)), ((60, 46), (82, 51), (65, 64), (62, 50), (74, 53), (66, 59))),
    ),
    "wave": (5, (((54, 42), (60, 38), (66, 42), (72, 54), (78, 60), (86, 56)),)),
}


def jobs(names: Iterable[str] = tuple(RECORDINGS), recordings: Mapping[str, Recording] = RECORDINGS) -> list[Job]:
    """Every trial of these sets, in the order of their seeds; the last repeat changes slowest.

    Raises:
        KeyError: an unknown set; the message lists the choices.
    """
    found = []
    for name in names:
        recording = choose("set of recordings", name, recordings)
        # The last repeat changes slowest: the first files of a set are whole sets of cloths and policies themselves.
        for k, (repeat, cloth, policy) in enumerate(
            product(range(recording.repeats), recording.cloths, recording.policies)
        ):
            file = f"{repeat:02}_{cloth}_{policy}.npz" if recording.repeats > 1 else f"{cloth}_{policy}.npz"
            found.append((Path(name) / file, recording, cloth, policy, recording.first_seed + k))
    return found


def record(path: Path, recording: Recording, cloth: str, policy: str, seed: int) -> None:
    """Record one trial and save it."""
    if recording.over_table:
        return record_throw(path, recording, cloth, policy, seed)
    env = ClothEnv(recording.arm, cloth)
    try:
        trial = rollout(env, POLICIES[policy](env.arm), recording.steps, seed=seed)
    finally:
        env.close()
    save_trial(trial, path)


def record_throw(path: Path, recording: Recording, cloth: str, policy: str, seed: int) -> None:
    """Record one throw, look what came of it, write that down and save it; what went well is tried again."""
    env = TableEnv(recording.arm, cloth, start_in="hand")
    try:
        first = thrown(env, POLICIES[policy](env.arm), recording.steps, seed)
        save_trial(first, path)
        for k in range(1, recording.again + 1) if was_spread(first) else ():
            again = thrown(env, ReplayPolicy(first.commands), recording.steps, AGAIN * k + seed)
            save_trial(again, path.with_stem(f"{path.stem}_again{k}"))
    finally:
        env.close()


def thrown(env: TableEnv, policy: Policy, steps: int, seed: int) -> Trial:
    """A throw, and what came of it."""
    trial = rollout(env, policy, steps, seed=seed)
    seen = None if env.held else see_cloth_pose(env)
    return label_spread(trial, seen is not None and seen.spread)


def record_all(todo: list[Job], folder: Path, workers: int, progress: bool = True) -> None:
    """Record trials, several at once, and save each in a folder as soon as it is made."""
    calls = [joblib.delayed(record)(folder / path, *how) for path, *how in todo]
    done = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")(calls)
    for _ in tqdm(done, total=len(calls), desc="trials", unit="trial", disable=not progress):
        pass


def operate(arm: str, cloth: str, seed: int, steps: int = TARGET_STEPS) -> tuple[np.ndarray, np.ndarray]:
    """An operator's run: images `[T, H, W]`, and where the points are then `[T, rows, columns, 3]` [m]."""
    env = ClothEnv(arm, cloth)
    points: list[np.ndarray] = []
    watch = lambda: points.append(env.cloth_points())  # noqa: E731
    # One more, since the image after a step is the one that the next step sees.
    trial = rollout(env, OperatorPolicy(env.arm), steps + 1, seed=seed, watch=watch, samples=1)
    env.close()
    return trial.images[1:], np.array(points[:-1])


def is_whole(mask: np.ndarray) -> bool:
    """Whether the front of the cloth is in view, and the picture's border cuts nothing off."""
    return bool(mask.any() and not (mask[[0, -1]].any() or mask[:, [0, -1]].any()))


def find_moments(arm: str, images: np.ndarray, points: np.ndarray) -> tuple[list, list]:
    """Moments `(reach [m], mask)` of an operator's run at which the cloth is spread in the air, and at which it swings.

    Reach is how far the free edge is from the hand, towards the side on which the front faces up. The cloth is spread
    where that is more than 0.3 m and the edge is level with the hand to 0.1 m; it swings where the edge is below. In
    both the front is in view and the hand well in front of the shoulder, so that the arm hides little.
    """
    side = np.sign(get_arm(arm).camera.position[0] - points[0, 0, :, 0].mean())
    spread, swinging = [], []
    for after, image in zip(points, images, strict=True):
        forward, _, up = after[-1].mean(axis=0) - after[0].mean(axis=0)
        if image.any() and after[0, :, 0].mean() > HAND_AHEAD:
            moment = (side * forward, image)
            if side * forward > 0.3 and abs(up) < 0.1:
                spread.append(moment)
            elif up < -0.1:
                swinging.append(moment)
    return spread, swinging


def median(moments: list) -> tuple[float, np.ndarray]:
    """The moment of the median reach: not the widest, since a record is hard to repeat even for who set it."""
    return sorted(moments, key=lambda moment: moment[0])[len(moments) // 2]


def find_named_targets(
    steps: int = TARGET_STEPS, seeds: Sequence[int] = range(3000, 3004), foams: Sequence[str] = TRAINED_FOAMS
) -> dict[str, np.ndarray]:
    """Choose target-1, target-2 and the muscle arm's by geometry alone, from an operator's runs that nothing else uses.

    Target-1 (hard) and the muscle arm's target are the median of all moments at which the cloth is spread. Target-2
    (easier) swings half as far, its free edge below the hand.

    Args:
        steps: of each run.
        seeds: of the torque arm's runs.
        foams: with each of which the muscle arm makes one.
    """
    runs = [operate("torque", "damp0.05-mass0.10", seed, steps) for seed in seeds]
    found = [find_moments("torque", *run) for run in runs]
    spread, swinging = ([moment for run in found for moment in run[kind]] for kind in (0, 1))
    reach, target_1 = median(spread)
    _, target_2 = min(swinging, key=lambda moment: abs(moment[0] - reach / 2))
    held = [find_moments("muscle", *operate("muscle", foam, 13000, steps)) for foam in foams]
    whole = [moment for spread, _ in held for moment in spread if is_whole(moment[1])]  # a near camera cuts some
    return {"target-1": target_1, "target-2": target_2, "muscle": median(whole)[1]}


def area_and_place(masks: np.ndarray) -> np.ndarray:
    """Area [pixel] of each mask `[N, H, W]`, and column and row [pixel] of its centre: `[N, 3]`."""
    area = masks.sum(axis=(1, 2))
    column = (masks.sum(axis=1) * np.arange(masks.shape[2])).sum(axis=1) / area
    row = (masks.sum(axis=2) * np.arange(masks.shape[1])).sum(axis=1) / area
    return np.stack([area, column, row], axis=1)


def choose_varied(masks: np.ndarray, number: int) -> np.ndarray:
    """Choose masks `[number, H, W]` that stand for all `[N, H, W]` by area and place, from small to large.

    Area, column and row of the centre are standardised, k-means makes groups of what is alike, and of each group the
    mask nearest to its mean is taken: small and large, high and low as they occur, and nobody looks who can reach them.
    """
    features = area_and_place(masks)
    groups = KMeans(number, n_init=10, random_state=0)
    away = groups.fit_transform((features - features.mean(axis=0)) / features.std(axis=0))  # [N, number]
    away[groups.labels_[:, None] != np.arange(number)] = np.inf  # of its own group, so that none is taken twice
    chosen = away.argmin(axis=0)
    return masks[chosen[np.argsort(features[chosen, 0], kind="stable")]]


def find_views(name: str, views: Views) -> dict[str, np.ndarray]:
    """Targets `{NAME/ARM_CLOTH_K: mask}`, out of all moments at which the cloth is whole in the picture."""
    found: dict[str, np.ndarray] = {}
    for k, cloth in enumerate(views.cloths):
        seeds = range(views.first_seed + RUNS * k, views.first_seed + RUNS * (k + 1))
        runs = [operate(views.arm, cloth, seed) for seed in seeds]
        chosen = [
            *choose_varied(np.array([image for images, _ in runs for image in images if is_whole(image)]), views.varied)
        ]
        spread = [moment for run in runs for moment in find_moments(views.arm, *run)[0] if is_whole(moment[1])]
        if views.spread and spread:
            chosen.append(median(spread)[1])
        found |= {f"{name}/{views.arm}_{cloth}_{number}": mask for number, mask in enumerate(chosen)}
    return found


def draw(brush: float, strokes: tuple[Stroke, ...]) -> np.ndarray:
    """Mask `[H, W]` of what a person draws on the live lab's canvas, as its JavaScript (target.js) has it.

    A brush is a disc of this radius [pixel], put down in steps of at most a pixel along each line.
    """
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    mask = np.zeros((HEIGHT, WIDTH), bool)
    for stroke in strokes:
        for start, end in pairwise((stroke[0], *stroke)):
            way = np.subtract(end, start)
            steps = math.ceil(math.hypot(*way)) + 1
            for column, row in np.array(start, float) + way * np.arange(steps + 1)[:, None] / steps:
                mask |= (columns - column) ** 2 + (rows - row) ** 2 <= brush**2
    return mask


def find_targets(workers: int) -> dict[str, np.ndarray]:
    """All targets, by the names that `load_target` knows."""
    calls: list[Any] = [joblib.delayed(find_named_targets)()]
    calls += [joblib.delayed(find_views)(name, views) for name, parts in VIEWS.items() for views in parts]
    found = {name: mask for part in joblib.Parallel(n_jobs=workers)(calls) for name, mask in part.items()}
    return found | drawn_targets()


def drawn_targets() -> dict[str, np.ndarray]:
    """The shapes of `DRAWN`, by the names that `load_target` knows."""
    return {f"drawn/{name}": draw(*drawing) for name, drawing in DRAWN.items()}
