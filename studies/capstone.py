"""What a policy of one's own has to beat.

The rivals of notebook 09: each throws at targets that nothing was tuned on.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

from clothlab import analysis, data, plots
from clothlab.analysis import crossed_interval, period_ends, target_distance
from clothlab.method.data import Run
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.method.rollout import Policy
from clothlab.policies import RandomPolicy, ReplayPolicy
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.scene import Scene
from clothlab.trials import Trial, recorded_plans, rollout
from clothlab.weights import ClothCheckpoint
from studies._grid import Case, Experiment
from studies._runs import MIDDLE, RECORDINGS, new_trial, replay_nearest, trained
from studies.oracle import search_trial

_ARM = "torque"
_ORACLE_STEPS = 41  # five periods: it is slow, and has found its plan by then
STEPS = 73  # control steps: nine periods of eight, and the look after the last one
# Numbers of a set's targets, by their cloths. At targets that are far from a hanging
# cloth nearly every controller gets above ninety points: no change could be seen there.
_TARGETS: dict[str, dict[str, tuple[int, ...]]] = {
    "held-out": {"damp0.03-mass0.05": (0, 1, 2), "damp0.07-mass0.15": (0, 1, 2)},
    "development": {
        "damp0.03-mass0.15": (0, 2),
        "damp0.05-mass0.10": (0, 2),
        "damp0.07-mass0.05": (0,),
    },
}
_RECORDED_PLANS = 200  # from which a period may start

# A rival is made of the weights, the target's mask [H, W] and the cloth's name.
_Make = Callable[[ClothCheckpoint, np.ndarray, str], Policy]


@cache
def _runs() -> list[Run]:
    """The recordings that a reader has, which are fewer than a training had.

    All trainings share one autoencoder.
    """
    learned = trained(f"{_ARM}-0")
    return [learned.to_run(trial) for trial in data.load_trials(RECORDINGS[_ARM])]


def _plans() -> np.ndarray:
    trials = data.load_trials(RECORDINGS[_ARM])
    return recorded_plans(trials, 8, _RECORDED_PLANS)


def _random(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return RandomPolicy(learned.arm)


def _replay(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    """The recorded plan that came nearest with this very cloth, again and again."""
    runs = [run for run in _runs() if run.material == cloth]
    return replay_nearest(runs, learned.autoencoder, target)


def _papers(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return learned.controller(target, cloth)


def _recorded(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    return learned.controller(target, cloth, plans=_plans())


def _iterative(learned: ClothCheckpoint, target: np.ndarray, cloth: str) -> Policy:
    settings = IterativeLearningSettings(trust=0)
    return learned.iterative_controller(target, cloth, _runs(), settings)


_RIVALS: dict[str, _Make] = {
    "random": _random,
    "replay": _replay,
    "the paper's": _papers,
    "with recorded starts": _recorded,
    "iterative": _iterative,
}
ORACLE = "oracle"  # searches in the true simulator, which no other may do


def tasks(name: str) -> list[tuple[str, str]]:
    """Targets of a set, "held-out" or "development", with the cloths to throw.

    The last one for development is Target-1 of the paper, with the middle cloth.
    """
    chosen = []
    for cloth, numbers in _TARGETS[name].items():
        for k in numbers:
            chosen.append((f"{name}/{_ARM}_{cloth}_{k}", cloth))
    if name == "development":
        chosen.append(("target-1", MIDDLE))
    return chosen


def _run_one(rival: str, target: str, cloth: str, steps: int = STEPS) -> dict[str, Any]:
    """Distance at each step `[T]` [s.d. of z], the first of them of the still cloth.

    Args:
        rival: one of `_RIVALS`, or the oracle.
        target, cloth: of the task, by name.
        steps: control steps.
    """
    learned = trained(f"{_ARM}-0")
    mask = data.load_target(target)
    if rival == ORACLE:
        trial = _oracle_trial(learned, mask, cloth, steps)
    else:
        policy = _RIVALS[rival](learned, mask, cloth)
        trial = new_trial(policy, _ARM, cloth, steps, seed=70_000)
    distance = target_distance(learned.autoencoder, trial, mask)
    return {"distance": distance.round(4)}


def _oracle_trial(
    learned: ClothCheckpoint, mask: np.ndarray, cloth: str, steps: int
) -> Trial:
    """Search each period in a copy of the scene, and send the best plan."""
    periods = -(-steps // 8)
    trial = search_trial(learned.autoencoder, _ARM, cloth, mask, _plans(), periods)
    return trial[:steps]


def _cases(**same: Any) -> list[Case]:
    """Each rival on each task of both sets, and the oracle on the held-out ones."""
    cases = []
    for rival in _RIVALS:
        cases += _on_tasks(rival, "held-out", **same)
    cases += _on_tasks(ORACLE, "held-out", **{"steps": _ORACLE_STEPS} | same)
    for rival in _RIVALS:
        cases += _on_tasks(rival, "development", **same)
    return cases


def _on_tasks(rival: str, name: str, **same: Any) -> list[Case]:
    """A rival on each task of a set."""
    return [
        {"rival": rival, "target": target, "cloth": cloth} | same
        for target, cloth in tasks(name)
    ]


def points(distance: np.ndarray) -> np.ndarray:
    """Points of the throws of a run `[P]`, from its distance at each step `[T]`."""
    return analysis.points(period_ends(distance), distance[0])


def stored_points(
    rival: str, tasks: Sequence[tuple[str, str]], steps: int = STEPS
) -> np.ndarray:
    """Points of a rival that has played: one number a task."""
    table = data.load_table("capstone")
    runs = table[table.rival == rival].set_index("target").distance
    return np.array([points(runs[target][:steps]).mean() for target, _ in tasks])


def play(
    maker: Callable[[np.ndarray, str, int], Policy],
    tasks: Sequence[tuple[str, str]],
    steps: int = STEPS,
    seed: int = 0,
) -> tuple[np.ndarray, dict[str, Trial]]:
    """Let a maker's policies throw: their points `[task, throw]`, and their runs.

    Args:
        maker: makes a policy of a target's mask `[H, W]`, a cloth's name and a seed.
        tasks: targets with the cloths to throw, by name.
        steps: control steps of a run.
        seed: of whatever is drawn.
    """
    autoencoder = trained(f"{_ARM}-0").autoencoder
    scores = []
    runs = {}
    for target, cloth in tasks:
        mask = data.load_target(target)
        runs[target] = new_trial(maker(mask, cloth, seed), _ARM, cloth, steps, seed)
        scores.append(points(target_distance(autoencoder, runs[target], mask)))
    return np.array(scores), runs


def tries_file() -> Path:
    """The table of a reader's tries, beside the own recordings."""
    return data.own_trials() / "tries.csv"


# Of two rows of tries that agree in these, the later one is no new try
_SAME_TRY = ["set", "name", "steps", "each"]


def _written() -> pd.DataFrame:
    """The rows of the file that hold one number a task, as this version writes them."""
    columns = [*_SAME_TRY, "note"]
    if not tries_file().exists():
        return pd.DataFrame({name: [] for name in columns})
    rows = pd.read_csv(tries_file(), dtype={"each": str, "note": str})
    rows = rows.reindex(columns=columns).dropna(subset=_SAME_TRY)
    return rows.fillna({"note": ""})


def keep(name: str, scores: np.ndarray, of: str, *, steps: int, note: str = "") -> None:
    """Add a try to the table.

    Args:
        name: of the policy.
        scores: points `[task, throw]`.
        of: the set of targets, "development" or "held-out".
        steps: control steps of a run.
        note: what was changed and expected.
    """
    each = " ".join(f"{score:.2f}" for score in scores.mean(axis=1))
    row = {"set": of, "name": name, "steps": steps, "each": each, "note": note}
    tries = pd.DataFrame([*_written().to_dict("records"), row])
    with data.recording_into(tries_file().parent):
        tries.drop_duplicates(_SAME_TRY).to_csv(tries_file(), index=False)


def kept_tries(steps: int) -> pd.DataFrame:
    """All tries of runs of so many steps, numbered in the order of keeping.

    What is said of a try is computed here from its points, one number a task (`each`).
    """
    tries = _written()
    tries = tries[tries.steps == steps].drop(columns="steps")
    numbers = [np.array(text.split(), float) for text in tries["each"]]
    ends = [crossed_interval(each[:, None]) for each in numbers]  # Student's
    for k, column in enumerate(("points", "low", "high")):
        tries[column] = [round(end[k], 1) for end in ends]
    tries["each"] = numbers
    tries.index = pd.RangeIndex(1, len(tries) + 1, name="try")
    return tries[["set", "name", "points", "low", "high", "note", "each"]]


_LEFT = -160.0  # [point] where the axis of a contest ends at most


def show_contest(scores: Mapping[str, np.ndarray], title: str) -> Figure:
    """A row each: a stroke for each task, a dot for their mean.

    Args:
        scores: points by the names of the policies, one number a task.
        title: what is to be seen.
    """
    # From the lowest mean up, a row each
    names = sorted(scores, key=lambda name: scores[name].mean())
    figure, ((ax,),) = plots.new_axes(size=(10, 1.4 + 0.5 * len(names)))
    for k, name in enumerate(names):
        theirs = name in (*_RIVALS, ORACLE, "operator")
        colour = plots.COLOURS[0] if theirs else plots.COLOURS[1]
        ax.plot(scores[name], np.full(len(scores[name]), k), "|k", ms=12, mew=1.5)
        ax.plot(scores[name].mean(), k, "o", ms=11, mec="black", color=colour)

    # Its words, and the still cloth
    ax.axvline(0, color="0.35", ls="--", lw=1.2)
    ax.set_yticks(range(len(names)), names)
    lowest = max(_LEFT, min(-100.0, *(each.min() for each in scores.values())))
    for k, name in enumerate(names):
        beyond = int((scores[name] < lowest).sum())
        if beyond:
            words = f"◂ {beyond} farther left"
            ax.text(lowest - 8, k + 0.22, words, fontsize=12, color="0.35")
    ax.set(xlim=(lowest - 10, 104), ylim=(-0.6, len(names) - 0.4))
    ax.set_xlabel("points (0: hanging still, 100: the target)")
    ax.set_title(title)
    return plots.larger(figure)


def show_leads(leads: np.ndarray, title: str) -> Figure:
    """A bar for each task's lead."""
    figure, ((ax,),) = plots.new_axes(size=(7, 3.6))
    ax.bar(np.arange(1, len(leads) + 1), leads, width=0.5, color="0.55")
    ax.axhline(0, color="black", lw=1)
    reach = max(50.0, 1.1 * np.abs(leads).max())  # equal for nearly all tries
    ax.set(xticks=np.arange(1, len(leads) + 1), xlabel="task", ylabel="lead [points]")
    ax.set_ylim(-reach, reach)
    ax.set_title(title)
    return plots.larger(figure)


def film(trial: Trial, until: int) -> list[np.ndarray]:
    """The last 4 s of a trial's first `until` steps, 25 pictures `[h, w, 3]` a second.

    It is played again from its commands, at the speed of the robot.
    """
    pictures: deque[np.ndarray] = deque(maxlen=100)
    scene = Scene(picture_size=(240, 320))
    with closing(ClothEnv(trial.arm, trial.cloth, scene=scene)) as env:
        policy = ReplayPolicy(trial.commands[:until])
        rollout(env, policy, until, watch=lambda: pictures.append(env.picture()))
    return list(pictures)


def save_film(pictures: list[np.ndarray]) -> Path:
    """Write every second picture into `throw.gif`, beside the table of tries."""
    frames = [Image.fromarray(picture) for picture in pictures[::2]]
    file = data.own_trials() / "throw.gif"
    rest = frames[1:]
    with data.recording_into(file.parent):
        frames[0].save(file, save_all=True, append_images=rest, duration=80, loop=0)
    return file


EXPERIMENTS = (Experiment("capstone", _run_one, _cases),)
