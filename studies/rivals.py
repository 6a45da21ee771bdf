"""What do trained rivals do without parametric bias?

All learn from the paper's amount of recordings (weights `torque-paper`), with the
compute of a model with p: 900 updates of 3,000 predicted steps, of an LSTM. All know 40
s of random commands with the cloth in the hand, and choose a throw by what they have
learned. The rivals:

* an LSTM without p. "Without p" is trained on windows of 30 steps, as the model with p
  is; others on windows of 100 or 200, or on a window behind a stretch of another run
  of the same material, with a reset between both. Its memory reads the random commands.
  What becomes of it when the cloth is hung up for the throw was tried in three ways: it
  is kept as it is; it settles, by reading 2 s of hanging at rest; it is emptied;
* a context encoder, which makes what stands in the place of p of 30, 100 or 200 steps;
* a model that is told the constants of the material: more than any rival can know;
* an ensemble of all models of one kind with a search by the cross-entropy method, which
  is charged for where they disagree. It has 550 plans a period, where iterative
  learning control has about 330. Its first throw is its own plan, or a recorded one by
  the score below: the development chose;
* a policy by hindsight: a network from the z that is wanted (and perhaps the state) to
  a plan of eight commands, trained on recorded stretches with what they led to as the
  goal, and told of the material nothing, p or the constants. It searches for nothing.

All but the last two throw as iterative learning control does: first the recorded plan
with the best sum of predicted and seen distances (and the distance in p, or in what
stands in its place, where there is one), then with what was learned from outcomes.

What would say what, written down before the throws were made. A throw is judged by its
best distance to the target over that of random commands, first throws with the eight
new cloths to each target, three trainings; intervals are of the difference to the same
throw with estimated p, over tasks and trainings. The margin is 0.05.

* A rival is "no worse" if the upper end of its interval is at most the margin, "worse"
  if the lower end is above zero and the upper one above the margin, otherwise "open".
* p is worth nothing for a first throw if the rival without p that the development
  chose (`CHOSEN`) is no worse. The others without p are shown beside it.
* p's way of being found, by gradient, is worth nothing if the chosen context encoder
  is no worse; the search is worth nothing if ensemble or hindsight with p is no worse.

Settings are chosen on cloths that no throw of `rivals` is made with: what is done with
the memory, and the length of windows and contexts, by predictions of the eight steps
from rest (`best_beliefs` of the table `rival_predictions`), settings of ensemble and
hindsight by first throws at targets of their own (`rivals_development`).

What was computed is less than what was planned: p, the rival without p and the context
encoder that the development chose, and the replays have three trainings; the others
have one, so that their intervals are over tasks alone, and say nothing of another
training. Ten periods were thrown with one training. A context of 200 steps, and a model
with p of the rivals' compute, can be had by name and are in no table.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd
import torch

from clothlab import data
from clothlab.analysis import (
    best_per_period,
    crossed_interval,
    nearest_material,
    target_distance,
)
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.gauss_newton import estimate_bias
from clothlab.method.iterative import IterativeLearningSettings
from clothlab.method.model import PredictiveModel
from clothlab.method.policy import Policy
from clothlab.trials import Trial
from studies import ablations, transfer
from studies._grid import Case, Experiment, Tables, grid, shared
from studies._rival_models import (
    HindsightPlans,
    Remembering,
    TrainedKind,
    memory_of,
    train,
    train_hindsight,
)
from studies._rival_policies import Belief, EnsemblePolicy, HindsightPolicy
from studies._rows import Row
from studies._runs import (
    DEVELOPMENT,
    EVALUATION,
    NEW,
    best_iou,
    errors_ahead,
    find_cloth,
    new_trial,
    random_trial,
    recorded_runs,
    replay_nearest,
    trained,
)
from studies._throws import Rival, Task

WEIGHTS = {"torque": "torque-paper"}  # the paper's amount of recordings
MARGIN = 0.05  # of random commands' distance, written down beforehand
_PERIOD = ControlSettings.period  # [step]
_EXCITED = 200  # [step] of random commands: 40 s
_CHANCE_PERIODS = 31  # of random commands with which throws are compared
_AT_REST = 10  # [step] that a memory reads of a hanging cloth, to settle
_MEMBERS = {"p": 5, "without p": 3}  # models of an ensemble


# What is believed after 40 s of random commands


@cache
def _estimated(model: PredictiveModel, run: Run) -> np.ndarray:
    """p `[D_p]` of a run."""
    p, _ = estimate_bias(model, run, method="newton")
    return p


def _trained_kind(task: Task, kind: str) -> TrainedKind:
    """The rival of this kind that belongs to the weights of a task."""
    weights, seed = task.learned.name.rsplit("-", 1)
    return train(kind, weights, int(seed))


def _stored(task: Task) -> Belief:
    """The stored weights with p as it is estimated."""
    learned = task.learned
    p = _estimated(learned.model, task.excited)
    return Belief(learned.model, learned.biases, p)


def _nearest_trained(task: Task) -> Belief:
    """The stored weights with the trained p that is nearest to the estimate."""
    belief = _stored(task)
    nearest = nearest_material(belief.p, belief.biases)
    return belief._replace(p=belief.biases[nearest])


def _with_p(kind: str, task: Task) -> Belief:
    """A model with p that was trained with the compute of the rivals."""
    learned = _trained_kind(task, kind)
    p = _estimated(learned.model, task.excited)
    return Belief(learned.model, learned.biases, p)


def _told(kind: str, task: Task) -> Belief:
    """A model that is told the constants of the cloth in the hand."""
    learned = _trained_kind(task, kind)
    p = ablations.constants(task.excited.material, [*learned.biases])
    return Belief(learned.model, learned.biases, p)


def _read(kind: str, task: Task) -> Belief:
    """A model whose encoder has read the random commands."""
    learned = _trained_kind(task, kind)
    return Belief(learned.model, learned.biases, learned.read(task.excited))


def _remembered(kind: str, memory: str, task: Task) -> Belief:
    """A model without p, and a memory of the random commands, or an empty one."""
    learned = _trained_kind(task, kind)
    model: PredictiveModel = learned.model
    if memory != "emptied":
        first = memory_of(model, task.excited)
        if memory == "settled":
            first = memory_of(model, _at_rest(task), first)
        model = Remembering(model, first)
    return Belief(model, learned.biases, np.zeros(0))


def _at_rest(task: Task) -> Run:
    """The hanging cloth with which the random commands began, and nothing happens."""
    home = task.learned.arm.home_command
    s = np.tile(task.excited.s[0], (_AT_REST, 1))
    return Run(s, np.tile(home, (_AT_REST, 1)), task.excited.material)


_ENCODERS = ("context of 30", "context of 100", "context of 200")
_WINDOWS = (
    "without p, windows of 100",
    "without p, windows of 200",
    "without p, another run first",
)
_MEMORIES = ("kept", "settled", "emptied")
# Which no table has: there was no time to train them
_NOT_TRAINED = ("p, same compute", "context of 200")
BELIEFS: dict[str, Callable[[Task], Belief]] = {
    "p": _stored,
    "p, nearest trained": _nearest_trained,
    "p, same compute": partial(_with_p, "p"),
    "p, windows of 100": partial(_with_p, "p, windows of 100"),
    "told constants": partial(_told, "told constants"),
    "without p": partial(_remembered, "without p", "emptied"),
}
for _kind in _ENCODERS:
    BELIEFS[_kind] = partial(_read, _kind)
for _kind in _WINDOWS:
    for _memory in _MEMORIES:
        BELIEFS[f"{_kind}, {_memory}"] = partial(_remembered, _kind, _memory)


# Throws by iterative learning control, and replays


def _iterative(
    belief_of: Callable[[Task], Belief],
    task: Task,
    settings: IterativeLearningSettings | None = None,
) -> Policy:
    model, biases, p = belief_of(task)
    learned = replace(task.learned, model=model, biases=biases)
    return learned.iterative_controller(task.target, p, task.runs, settings)


def _without_difference(task: Task) -> Policy:
    """p in the prediction alone: the score does not look at its distance."""
    return _iterative(_stored, task, IterativeLearningSettings(difference=0))


def _replay_nearest_p(task: Task) -> Policy:
    """The best recording of the material with the nearest p."""
    belief = _stored(task)
    nearest = nearest_material(belief.p, belief.biases)
    runs = [run for run in task.runs if run.material == nearest]
    return replay_nearest(runs, task.learned.autoencoder, task.target)


def _replay_any(task: Task) -> Policy:
    """The best recording of all other materials."""
    runs = [run for run in task.runs if run.material != task.excited.material]
    return replay_nearest(runs, task.learned.autoencoder, task.target)


# Throws by a plan that is made anew for each period


def _ensemble(
    members: str, belief: str, recorded_first: bool, penalty: float, task: Task
) -> Policy:
    """All trainings of one kind, each with what it makes of the random commands.

    Args:
        members: one of `_MEMBERS`.
        belief: one of `BELIEFS`.
        recorded_first: whether the first throw is a recorded plan.
        penalty: weight of the variance.
        task: of one of them.
    """
    weights, _ = task.learned.name.rsplit("-", 1)
    beliefs = []
    for seed in range(_MEMBERS[members]):
        its_task = replace(task, learned=trained(f"{weights}-{seed}"))
        beliefs.append(BELIEFS[belief](its_task))
    return EnsemblePolicy(task, beliefs, penalty, recorded_first)


_KNOWLEDGE = ("nothing", "p", "constants")


def _codes(knowledge: str, learned: ClothCheckpoint) -> dict[str, np.ndarray]:
    """What a policy by hindsight is told of recorded materials, `{name: [D_c]}`."""
    names = [*learned.biases]
    if knowledge == "p":
        return learned.biases
    if knowledge == "constants":
        return {name: ablations.constants(name, names) for name in names}
    return {name: np.zeros(0) for name in names}


@shared
def _hindsight_plans(
    weights: str,
    seed: int,
    knowledge: str,
    from_state: bool,
    components: int,
    updates: int,
) -> HindsightPlans:
    """The network, trained on the recordings of stored weights."""
    learned = trained(f"{weights}-{seed}")
    return train_hindsight(
        recorded_runs(learned),
        _codes(knowledge, learned),
        learned.model,
        latent=learned.autoencoder.latent_size,
        period=_PERIOD,
        from_state=from_state,
        components=components,
        updates=updates,
        seed=seed,
    )


def _hindsight(
    knowledge: str, from_state: bool, components: int, updates: int, task: Task
) -> Policy:
    """A policy by hindsight, and what it is told of the material.

    Args:
        knowledge: "nothing", "p" or "constants".
        from_state: whether it is told the state, too.
        components: of its mixture.
        updates: of its training.
        task: whose target it is told.
    """
    weights, seed = task.learned.name.rsplit("-", 1)
    settings = (from_state, components, updates)
    network = _hindsight_plans(weights, int(seed), knowledge, *settings)
    code = np.zeros(0)
    if knowledge == "p":
        code = _stored(task).p
    elif knowledge == "constants":
        names = [*task.learned.biases]
        code = ablations.constants(task.excited.material, names)
    return HindsightPolicy(task, network, code, from_state)


# What is varied in the development, and what it chose (table `rivals_development`)

# Of an ensemble: does it first throw a recorded plan, penalty of the variance
_ENSEMBLES = tuple(itertools.product((True, False), (0.1, 1.0, 10.0)))
# Of a policy by hindsight: is it told the state, components, updates
_HINDSIGHTS = tuple(itertools.product((True, False), (1, 10), (1000,)))
CHOSEN = {  # beliefs
    "without p": "without p, another run first, settled",
    "context": "context of 100",
}
_ENSEMBLE = (True, 0.1)
_HINDSIGHT = (False, 10, 1000)


def _rivals() -> dict[str, Rival]:
    """Each rival by its name, with the settings that the development chose."""
    rivals: dict[str, Rival] = {}
    for name, belief in BELIEFS.items():
        rivals[name] = partial(_iterative, belief)
    rivals["p without difference"] = _without_difference
    rivals["replay, nearest p"] = _replay_nearest_p
    rivals["replay, any other cloth"] = _replay_any

    # Ensembles, and policies by hindsight
    without = CHOSEN["without p"]
    rivals["ensemble, p"] = partial(_ensemble, "p", "p", *_ENSEMBLE)
    rivals["ensemble, without p"] = partial(_ensemble, "without p", without, *_ENSEMBLE)
    for knowledge in _KNOWLEDGE:
        name = f"hindsight, {knowledge}"
        rivals[name] = partial(_hindsight, knowledge, *_HINDSIGHT)
    return rivals


def _tried() -> dict[str, Rival]:
    """Other settings, among which the development chose."""
    tried: dict[str, Rival] = {}
    for recorded_first, penalty in _ENSEMBLES:
        first = "a recorded" if recorded_first else "its own"
        name = f"ensemble, p, first {first} plan, penalty {penalty}"
        tried[name] = partial(_ensemble, "p", "p", recorded_first, penalty)
    for from_state, components, updates in _HINDSIGHTS:
        told = "with" if from_state else "without"
        name = f"hindsight, p, {told} state, {components} components, {updates} updates"
        tried[name] = partial(_hindsight, "p", from_state, components, updates)
    return tried


RIVALS = _rivals()
_TRIED = _tried()


# Rows


@cache
def _excited(weights: str, arm: str, cloth: str, seed: int) -> Run:
    """40 s of random commands, as `transfer` has them."""
    trial = random_trial(arm, find_cloth(cloth), _EXCITED, seed)
    return trained(f"{weights}-0").to_run(trial)


@shared
def _chance(arm: str, cloth: str) -> Trial:
    """31 periods of random commands, as `transfer` has them."""
    steps = _CHANCE_PERIODS * _PERIOD
    return random_trial(arm, find_cloth(cloth), steps, 58_000)


def task_of(arm: str, target: str, cloth: str, model: int) -> Task:
    """What a rival may know before it throws.

    Args:
        arm, target, cloth: of the task, by name.
        model: seed of the training.
    """
    weights = WEIGHTS[arm]
    learned = trained(f"{weights}-{model}")
    return Task(
        learned=learned,
        target=transfer.known_aim(weights, target),
        runs=recorded_runs(learned),
        excited=_excited(weights, arm, cloth, 50_000 + 100 * model),
        seed=model,
    )


def _run_one(
    method: str, arm: str, target: str, cloth: str, model: int, periods: int = 2
) -> dict[str, Any]:
    """Best distance and best IoU in each period whose end is seen `[P]`.

    Args:
        method: one of `RIVALS`, or of what the development tried.
        arm, target, cloth: of the task, by name.
        model: seed of the training.
        periods: of the run, the first one included.
    """
    task = task_of(arm, target, cloth, model)
    policy = (RIVALS | _TRIED)[method](task)
    seed = 51_000 + 100 * model
    trial = new_trial(policy, arm, find_cloth(cloth), periods * _PERIOD, seed)

    # What random commands with this cloth reach
    autoencoder = task.learned.autoencoder
    mask = data.load_target(target)
    by_chance = target_distance(autoencoder, _chance(arm, cloth), mask)

    distance = target_distance(autoencoder, trial, mask)
    return {
        "best": best_per_period(distance).round(4),
        "iou": best_iou(trial, mask).round(4),
        "random": float(np.median(best_per_period(by_chance))),
    }


# Methods by how much of them was computed: three trainings, ten periods of the first
# training, and first throws of the first training
_REPEATED = ("p", *CHOSEN.values(), "replay, nearest p", "replay, any other cloth")
_LONG = ("p", CHOSEN["without p"], CHOSEN["context"], "ensemble, p")
_FIRST = (
    "p without difference",
    "p, nearest trained",
    "p, windows of 100",
    "without p",
    "without p, windows of 100, settled",
    "without p, windows of 200, settled",
    "context of 30",
    "told constants",
    "hindsight, nothing",
    "hindsight, p",
    "hindsight, constants",
    "replay, nearest p",
    "replay, any other cloth",
)


def _cases(periods: int | None = None) -> list[Case]:
    """All methods with all new cloths and targets.

    `periods` is how long each run is, in place of what it has at full size.
    """
    cases: list[Case] = []
    for arm in WEIGHTS:
        new = [cloth.name for cloth in NEW[arm]]
        task = {"arm": arm, "target": transfer.TARGETS[arm], "cloth": new}
        cases += grid(method=_LONG, **task, model=0, periods=periods or 11)
        cases += grid(method=_FIRST, **task, model=0, periods=periods or 2)
        cases += grid(method=_REPEATED, **task, model=(1, 2), periods=periods or 2)
    return cases


def _development_cases(model: Iterable[int] = (0,)) -> list[Case]:
    """First throws with cloths and at targets that no other table uses."""
    held = [cloth.name for cloth in DEVELOPMENT["torque"]]
    targets = [
        "development/torque_damp0.03-mass0.15_0",
        "development/torque_damp0.07-mass0.05_0",
    ]
    task = {"arm": "torque", "target": targets, "cloth": held}
    return grid(method=["p", *_TRIED], **task, model=model, periods=2)


# How well they predict

_AHEAD = 16  # [step]
_EVERY = 32  # steps between the starts of two predictions
_SHORT_RUNS = 8  # from rest, with each new cloth


@shared
def _unseen(arm: str, cloth: str) -> tuple[list[Trial], list[Trial]]:
    """Trials of a cloth that no model has seen: long ones, and all that begin at rest.

    Of a recorded cloth both are those of the evaluation, of others random commands.
    """
    long = []
    for trial in data.load_trials(EVALUATION[arm]):
        if trial.cloth.name == cloth:
            long.append(trial)
    if long:
        return long, long
    long = [_chance(arm, cloth)]
    short = []
    for k in range(_SHORT_RUNS):
        seed = 59_000 + k
        short.append(random_trial(arm, find_cloth(cloth), _AHEAD + 1, seed))
    return long, long + short


def _predict(belief: str, arm: str, cloth: str, model: int) -> dict[str, Any]:
    """Distance of predicted z to the truth, 1 to 16 steps ahead `[16]` [s.d. of z].

    `later` is in the middle of runs, whose beginning has filled the memory; `rest` is
    from the hanging cloth on, as a throw begins.

    Args:
        belief: one of `BELIEFS`.
        arm, cloth: of the task, by name.
        model: seed of the training.
    """
    learned = trained(f"{WEIGHTS[arm]}-{model}")
    task = task_of(arm, transfer.TARGETS[arm][0], cloth, model)
    known = BELIEFS[belief](task)
    p = torch.as_tensor(known.p, dtype=torch.float32)
    first = known.model.initial_memory()
    long, from_rest = _unseen(arm, cloth)

    def errors(trials: list[Trial], starts: Iterable[int]) -> np.ndarray:
        each = []
        for trial in trials:
            run = learned.to_run(trial)
            each.append(errors_ahead(known.model, run, p, starts, _AHEAD, first))
        return np.concatenate(each).mean(axis=0).round(4)

    return {
        "later": errors(long, range(_EVERY, 200 - _AHEAD, _EVERY)),
        "rest": errors(from_rest, (0,)),
    }


def _prediction_cases(model: Iterable[int] = (0,)) -> list[Case]:
    """All beliefs, with cloths of the development and with new ones."""
    names = [cloth.name for cloth in DEVELOPMENT["torque"] + NEW["torque"]]
    compared = [each for each in BELIEFS if each not in _NOT_TRAINED]
    return grid(belief=compared, arm="torque", cloth=names, model=model)


def best_beliefs(table: pd.DataFrame) -> dict[str, str]:
    """Which belief of each family foresees a throw best, `{family: belief}`.

    It has the least mean distance over the steps of a period from rest, with cloths of
    the development.
    """
    held = [cloth.name for cloth in DEVELOPMENT["torque"]]
    runs = table[table["cloth"].isin(held)]
    errors = runs["rest"].map(lambda rest: rest[:_PERIOD].mean())
    by_belief = errors.groupby(runs["belief"]).mean()
    families = {"without p": "without p, ", "context": "context of "}
    return {
        family: by_belief[by_belief.index.str.startswith(start)].idxmin()
        for family, start in families.items()
    }


# What follows from the rows


def over_random(table: pd.DataFrame, method: str, period: int = 0) -> pd.DataFrame:
    """Distance over that of random commands: tasks down, trainings across.

    The first period is 0.
    """
    runs = table[table["method"] == method]
    runs = runs.assign(over=transfer.over_random(runs, period))
    task = ["arm", "target", "cloth"]
    return runs.pivot_table(index=task, columns="model", values="over")


def effects(table: pd.DataFrame, period: int = 0) -> pd.DataFrame:
    """Each method beside estimated p: one row a method, the best one first.

    Columns are its mean distance over that of random commands, the difference to p with
    both ends of its 95 % interval over tasks and trainings, how many trainings both
    have, and the verdict.
    """
    enough = table[table["best"].map(len) > period]
    base = over_random(enough, "p", period)

    # The same tasks, by the trainings that both have
    found = []
    for method in enough["method"].unique():
        values = over_random(enough, method, period)
        shared_models = [model for model in values if model in base]
        gaps = (values - base)[shared_models]
        gap, low, high = crossed_interval(gaps.to_numpy())
        found.append(
            {
                "method": method,
                "distance": float(values.to_numpy().mean()),
                "difference": gap,
                "low": low,
                "high": high,
                "trainings": gaps.shape[1],
                "verdict": verdict(low, high),
            }
        )
    return pd.DataFrame(found).set_index("method").sort_values("distance")


def verdict(low: float, high: float) -> str:
    """What an interval of a difference to p says, by the margin."""
    if high <= MARGIN:
        return "no worse"
    return "worse" if low > 0 else "open"


def _rows(tables: Tables) -> list[Row]:
    """First throws of the rivals that were named beforehand, against estimated p."""
    if "rivals" not in tables:
        return []
    # Those of which the docstring of this module speaks
    found = effects(tables["rivals"])
    named = {
        CHOSEN["without p"]: "without p",
        CHOSEN["context"]: "context",
        "told constants": "constants",
        "ensemble, p": "ensemble",
        "hindsight, p": "hindsight",
    }

    rows = []
    for method, key in named.items():
        effect = found.loc[method]
        row = Row(
            f"rivals/torque/{key}",
            f"torque arm, new cloths, first throw: {method} minus estimated p",
            effect["difference"],
            interval=(effect["low"], effect["high"]),
            of_paper=True,
        )
        rows.append(row)
    return rows


_ABOUT = """
What do trained rivals do without parametric bias?

First throws with new cloths by models that learned from the paper's amount of
recordings. Distances are the best of a period over that of random commands. "No worse"
is a rival whose interval ends below a margin of 0.05, which was written down before.
"""
EXPERIMENTS = (
    Experiment(
        "rivals", _run_one, _cases, seconds=3, slow=True, rows=_rows, about=_ABOUT
    ),
    Experiment(
        "rivals_development", _run_one, _development_cases, seconds=2, slow=True
    ),
    Experiment("rival_predictions", _predict, _prediction_cases, seconds=1, slow=True),
)
