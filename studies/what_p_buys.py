"""What does p buy? First throws and tenth periods with cloths that were never recorded.

A throw needs a plan, and p may help to choose it in two places: it says which recorded
cloth is like the one in the hand, and it is told to the network that predicts where a
plan leads. Each row of the first table switches one of them. The plan of the first
throw is the recorded one with the least

    predicted² + trust (seen² + difference gap²)

where `seen` is how near it came when it was recorded, `gap` the distance in p between
the cloth of the recording and this one. All settings are those of iterative learning
control but for what the table says:

    knowledge                network       trust     difference
    no p                     without p     1         0
    p chooses                without p     very much 0.1
    p predicts               with p        1         0
    both                     with p        1         0.1

With so much trust predictions don't count: p chooses a recording, and nothing else
does. The network without p was trained as the other one was, on the same recordings.
From the third period on "p chooses" uses it, too.

p itself is one of three: "estimated" is the continuous one, by Gauss-Newton from 40 s
of random commands; "nearest" is the trained p of the recorded cloth that is nearest to
it, and "farthest" that of the farthest one, as a control.

The plan is sent in one of two ways: "as recorded", period after period; "replanned",
twice as recorded and then as iterative learning control has it, by the outcomes and the
network. The first throw of both is the same, so that rows of first throws have "as
recorded" alone.

Floors are replays: of the nearest recording of any cloth, or of the cloth with the
nearest p. A replay of the same cloth exists for recorded cloths alone (`transfer`).
Rivals without a network begin with the replay by nearest p, and refine it by its
outcomes: an evolution strategy and a Gaussian process (`_without_network`), whose
settings were chosen on recorded cloths whose own recordings were left out, and on
targets of the development. The oracle, which searches on the true simulator, is that of
`oracle_transfer`; it sees with the other autoencoder, and only its distance over that
of random commands compares.

All learned from the paper's amount of recordings. A unit is a new cloth and a target,
crossed with the trainings: three of them for first throws, two for ten periods and for
first throws with less known, in which the network is not trained again. Distances are
the best of a period over that of random commands with the same cloth.

Written before the table was made. The margin is 0.05 of random commands' distance. By
the 95 % interval of a difference over units and trainings (`crossed_interval`), all
targets and both arms in one, then each by itself:

* p is worth nothing if "both, estimated" minus "no p" lies within ± 0.05;
* the continuous p is worth nothing over a class if "both, estimated" minus "both,
  nearest" does, and nothing over the simplest use of a class if minus the replay by
  nearest p does;
* p in the prediction is worth nothing if "p predicts, estimated" minus the same with
  the farthest p does;
* the network is worth nothing beyond refinement without one if "both, estimated,
  replanned" minus the evolution strategy or minus the Gaussian process does, by the
  best of ten periods, which each of them could send again: else a strategy would be
  blamed for what it tries.

An interval below zero that is not within the margin is "worth something"; one above
zero "does harm"; any other leaves it open.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from torch import nn

from clothlab import data
from clothlab.analysis import (
    best_per_period,
    crossed_interval,
    nearest_material,
    target_distance,
)
from clothlab.method.control import ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias
from clothlab.method.iterative import IterativeLearningSettings, IterativePolicy
from clothlab.method.model import DPMPB
from clothlab.method.rollout import Policy
from clothlab.policies import ReplayPolicy
from clothlab.simulation.env import CONTROL_PERIOD
from clothlab.trials import Trial
from clothlab.weights import ClothCheckpoint
from studies import ablations, transfer
from studies._grid import PAPER, Case, Experiment, grid, shared
from studies._runs import (
    NEW,
    find_cloth,
    new_trial,
    random_trial,
    recorded_runs,
    replay_nearest,
    trained,
)
from studies._without_network import (
    EvolutionPolicy,
    ProcessPolicy,
    ProcessSettings,
    Refining,
)

MARGIN = 0.05  # of random commands' distance, written down beforehand
_PERIOD = ControlSettings.period  # [step]
_EXCITED = 200  # [step] of random commands from which p is estimated
_CHANCE_PERIODS = 31  # of random commands with which throws are compared
SECONDS = 40  # of random commands
MATERIALS = 9  # recorded ones that may be used
LESS = ({"seconds": 10}, {"materials": 3})  # with less of one of them

# Methods: what is known of p, as the docstring's table has it
NONE = "no p"
CHOOSES = "p chooses"
PREDICTS = "p predicts"
BOTH = "both"
# Floors, and refinement without a network
ANY_OTHER = transfer.ANY_OTHER
NEAREST_P = transfer.NEAREST_P
EVOLUTION = "evolution strategy"
PROCESS = "Gaussian process"
# Ways to send a plan
RECORDED = "as recorded"
REPLANNED = "replanned"


@dataclass(frozen=True)
class _Knowledge:
    """Where p is used."""

    in_prediction: bool
    settings: IterativeLearningSettings


_VERY_MUCH = 1e6
_WITHOUT_GAP = IterativeLearningSettings(difference=0)
_CHOICE_ALONE = IterativeLearningSettings(trust=_VERY_MUCH)
_USUAL = IterativeLearningSettings()
KNOWLEDGE = {
    NONE: _Knowledge(False, _WITHOUT_GAP),
    CHOOSES: _Knowledge(False, _CHOICE_ALONE),
    PREDICTS: _Knowledge(True, _WITHOUT_GAP),
    BOTH: _Knowledge(True, _USUAL),
}


# How far a step of the evolution goes, and how the Gaussian process is set
STEP = 0.1
SETTINGS = ProcessSettings(scale=2.0, caution=0.05)


# What is known before a throw


def _weights(arm: str) -> str:
    """Name of the trainings with the paper's amount of recordings."""
    return arm + PAPER


@shared
def _excited(arm: str, cloth: str, model: int) -> Run:
    """Random commands with the cloth in the hand, as the model sees them."""
    learned = trained(f"{_weights(arm)}-{model}")
    trial = random_trial(arm, find_cloth(cloth), _EXCITED, 50_000 + 100 * model)
    return learned.to_run(trial)


@shared
def _estimates(arm: str, cloth: str, model: int) -> np.ndarray:
    """p after each step of the random commands `[T, D_p]`."""
    learned = trained(f"{_weights(arm)}-{model}")
    run = _excited(arm, cloth, model)
    _, path = estimate_bias(learned.model, run, method="newton")
    return path


@shared
def _chance(arm: str, cloth: str) -> Trial:
    """31 periods of random commands, with which throws are compared."""
    steps = _CHANCE_PERIODS * _PERIOD
    return random_trial(arm, find_cloth(cloth), steps, 58_000)


@cache
def _without_p(arm: str, model: int) -> DPMPB:
    """The network that was trained without p."""
    return _deaf(ablations.train("none", _weights(arm), model).model)


def _deaf(model: DPMPB, bias_size: int = 2) -> DPMPB:
    """The same predictions by a network that is told p and doesn't listen."""
    deaf = DPMPB(model.state_size, model.command_size, bias_size)
    weights = model.state_dict()
    first = "fc_in.0.weight"  # p comes last
    weights[first] = nn.functional.pad(weights[first], (0, bias_size))
    deaf.load_state_dict(weights)
    return deaf.eval().requires_grad_(False)


class _Hand(NamedTuple):
    """What is known of the cloth in the hand, and what may be used."""

    learned: ClothCheckpoint  # its trained p are those of the materials in use
    aim: np.ndarray  # the target as the autoencoder knows it [H, W]
    runs: list[Run]  # recordings in use
    p: np.ndarray  # [D_p]
    s: np.ndarray  # the state at rest, in which a throw begins [D_s]


def _hand(
    p: str,
    arm: str,
    target: str,
    cloth: str,
    model: int,
    seconds: float,
    materials: int,
) -> _Hand:
    """What is known after some seconds of random commands."""
    learned = trained(f"{_weights(arm)}-{model}")
    runs = recorded_runs(learned)

    # The recorded materials that may be used
    names = _in_use([*learned.biases], cloth, model, materials)
    biases = {name: learned.biases[name] for name in names}
    runs = [run for run in runs if run.material in biases]

    # p, as it is told
    steps = round(seconds / CONTROL_PERIOD)
    estimate = _estimates(arm, cloth, model)[steps - 1]
    aim = transfer.known_aim(_weights(arm), target)
    at_rest = _excited(arm, cloth, model).s[0]
    told = _told(p, estimate, biases)
    return _Hand(replace(learned, biases=biases), aim, runs, told, at_rest)


def _in_use(names: list[str], cloth: str, model: int, count: int) -> list[str]:
    """So many of the recorded materials at most, drawn anew for each cloth and model.

    Fewer of them are among those of more.
    """
    rng = np.random.default_rng([model, *cloth.encode()])
    drawn = {*rng.permutation(names)[:count]}
    return [name for name in names if name in drawn]


def _told(p: str, estimate: np.ndarray, biases: dict[str, np.ndarray]) -> np.ndarray:
    """p of a kind, "estimated", "nearest" or "farthest"."""
    if p == "estimated":
        return estimate
    if p == "nearest":
        return biases[nearest_material(estimate, biases)]
    return max(biases.values(), key=lambda each: np.linalg.norm(each - estimate))


# Policies


def _controller(method: str, hand: _Hand, without: DPMPB) -> Policy:
    """A controller with one of `KNOWLEDGE`."""
    learned = hand.learned
    knowledge = KNOWLEDGE[method]
    return IterativePolicy(
        learned.model if knowledge.in_prediction else without,
        learned.autoencoder,
        learned.arm,
        hand.aim,
        hand.p,
        hand.runs,
        knowledge.settings,
        biases=learned.biases,
    )


def _nearest_runs(hand: _Hand) -> list[Run]:
    """Recordings of the cloth with the nearest p."""
    name = nearest_material(hand.p, hand.learned.biases)
    return [run for run in hand.runs if run.material == name]


def _replay_any(hand: _Hand) -> Policy:
    return replay_nearest(hand.runs, hand.learned.autoencoder, hand.aim)


def _replay_nearest_p(hand: _Hand) -> Policy:
    return replay_nearest(_nearest_runs(hand), hand.learned.autoencoder, hand.aim)


def _evolution(hand: _Hand, step: float = STEP) -> Policy:
    return EvolutionPolicy(hand.learned, hand.aim, _nearest_runs(hand), step)


def _process(hand: _Hand, settings: ProcessSettings = SETTINGS) -> Policy:
    return ProcessPolicy(hand.learned, hand.aim, _nearest_runs(hand), settings)


# Those that ask no network
_OTHERS: dict[str, Callable[[_Hand], Policy]] = {
    ANY_OTHER: _replay_any,
    NEAREST_P: _replay_nearest_p,
    EVOLUTION: _evolution,
    PROCESS: _process,
}


def _policy(method: str, sending: str, arm: str, model: int, hand: _Hand) -> Policy:
    """What throws; a plan that is sent as recorded is a replay."""
    if method in _OTHERS:
        return _OTHERS[method](hand)
    without = hand.learned.model
    if not KNOWLEDGE[method].in_prediction:
        without = _without_p(arm, model)
    policy = _controller(method, hand, without)
    if sending == RECORDED:
        plan = _first_plan(policy, hand)
        return ReplayPolicy(np.tile(plan, (_CHANCE_PERIODS, 1)))
    return policy


def _first_plan(policy: Policy, hand: _Hand) -> np.ndarray:
    """The plan `[T, D_u]` that is sent first, from the state at rest."""
    if isinstance(policy, Refining):
        return policy.first
    if isinstance(policy, ReplayPolicy):
        return policy.commands[:_PERIOD]
    controller = policy.controller  # type: ignore[attr-defined]
    controller.act(hand.s)
    plan = controller.under_way.u
    controller.reset()
    return plan.double().numpy()


@lru_cache(maxsize=500)
def _thrown(arm: str, cloth: str, plan: bytes) -> Trial:
    """One period with a cloth that hangs at rest: several ways may send the same."""
    commands = np.frombuffer(plan).reshape(_PERIOD, -1)
    last = np.concatenate([commands, commands[-1:]])  # what it led to is seen
    return new_trial(ReplayPolicy(last), arm, find_cloth(cloth), _PERIOD + 1, 0)


def _run_one(
    method: str,
    p: str,
    sending: str,
    arm: str,
    target: str,
    cloth: str,
    model: int,
    seconds: int = SECONDS,
    materials: int = MATERIALS,
    periods: int = 1,
) -> dict[str, Any]:
    """Best distance in each period `[P]`.

    Args:
        method: one of `KNOWLEDGE`, a floor, or a refinement without a network.
        p: "estimated", "nearest" or "farthest".
        sending: of the plan: as recorded or replanned.
        arm, target, cloth: of the task, by name.
        model: seed of the training.
        seconds: of random commands from which p is estimated [s].
        materials: recorded ones that may be used, at most.
        periods: of the run.
    """
    hand = _hand(p, arm, target, cloth, model, seconds, materials)
    policy = _policy(method, sending, arm, model, hand)

    # A first throw is its plan alone
    if periods == 1:
        plan = _first_plan(policy, hand)
        trial = _thrown(arm, cloth, plan.astype(np.float64).tobytes())
    else:
        steps = periods * _PERIOD + 1  # the end of the last one is seen
        trial = new_trial(policy, arm, find_cloth(cloth), steps, 51_000 + 100 * model)

    # What random commands with this cloth reach
    mask = data.load_target(target)
    autoencoder = hand.learned.autoencoder
    by_chance = target_distance(autoencoder, _chance(arm, cloth), mask)
    distance = target_distance(autoencoder, trial, mask)
    return {
        "best": best_per_period(distance).round(4),
        "random": float(np.median(best_per_period(by_chance))),
    }


_Way = tuple[str, str, str]  # method, p, sending
# First throws, and the main ways over ten periods
FIRST = (
    (ANY_OTHER, "estimated", RECORDED),
    (NEAREST_P, "estimated", RECORDED),
    (NONE, "estimated", RECORDED),
    (CHOOSES, "estimated", RECORDED),
    (PREDICTS, "estimated", RECORDED),
    (PREDICTS, "farthest", RECORDED),
    (BOTH, "estimated", RECORDED),
    (BOTH, "nearest", RECORDED),
    (BOTH, "farthest", RECORDED),
)
LONG = (
    (BOTH, "estimated", REPLANNED),
    (BOTH, "nearest", REPLANNED),
    (NONE, "estimated", REPLANNED),
    (CHOOSES, "estimated", REPLANNED),
    (NEAREST_P, "estimated", RECORDED),
    (EVOLUTION, "estimated", REPLANNED),
    (PROCESS, "estimated", REPLANNED),
)
_RIGHT = (BOTH, "estimated", RECORDED)
_TENTH = 10  # periods of a longer run


def _cases(
    model: Iterable[int] = range(3),
    longer_model: Iterable[int] = range(2),
    periods: int = _TENTH,
) -> list[Case]:
    """First throws of all ways with all tasks, longer runs, and throws with less known.

    The last two are towards recorded targets alone, with fewer trainings.

    Args:
        model: seeds of the trainings of first throws.
        longer_model: seeds of those of the last two.
        periods: of the longer runs.
    """
    cases: list[Case] = []
    for task in _with_each(model, _tasks()):
        cases += _ways(FIRST, task, periods=1)
    recorded = [task for task in _tasks() if "/" not in task["target"]]
    for task in _with_each(longer_model, recorded):
        cases += _ways(LONG, task, periods=periods)
    for task in _with_each(longer_model, recorded):
        for less in LESS:
            cases += _ways((_RIGHT,), task, **less, periods=1)
    return cases


def _tasks() -> Iterator[dict[str, str]]:
    """Each new cloth with each target of its arm, and two cloths with held-out ones.

    These are targets and cloths for which `oracle_transfer` has a search.
    """
    for arm, targets in transfer.TARGETS.items():
        for cloth in NEW[arm]:
            yield from grid(arm=arm, target=targets, cloth=cloth.name)
    held_out = [*data.load_targets("held-out")]
    for cloth in NEW["torque"][-2:]:
        yield from grid(arm="torque", target=held_out[::6], cloth=cloth.name)


def _with_each(model: Iterable[int], tasks: Iterable[Case]) -> list[Case]:
    """Tasks with one training after the other, since cloth by cloth throws recur."""
    tasks = list(tasks)
    return [task | {"model": each} for each in model for task in tasks]


def _ways(which: Sequence[_Way], task: Case, **how: int) -> list[Case]:
    """Some ways with one task."""
    cases = []
    for method, p, sending in which:
        cases.append({"method": method, "p": p, "sending": sending} | task | how)
    return cases


# What follows from the rows


def select(
    table: pd.DataFrame,
    method: str,
    p: str = "estimated",
    sending: str = RECORDED,
    *,
    periods: int = 1,
    seconds: int = SECONDS,
    materials: int = MATERIALS,
) -> pd.DataFrame:
    """Distance over that of random commands, tasks down and trainings across.

    It is the first throw's, or the best one of all `periods`. The columns of the index
    are arm, target and cloth.

    Args:
        table: stored rows of `what_p_buys`.
        method, p, sending: the way.
        periods: of the runs; one for first throws.
        seconds: of random commands from which p was estimated [s].
        materials: recorded ones that were used, at most.
    """
    way = {"method": method, "p": p, "sending": sending, "periods": periods}
    way |= {"seconds": seconds, "materials": materials}
    chosen = np.logical_and.reduce([table[key] == value for key, value in way.items()])
    runs = table[chosen]
    over = runs["best"].map(np.min) / runs["random"]
    wide = runs.assign(over=over).pivot_table(
        index=["arm", "target", "cloth"], columns="model", values="over"
    )
    return wide


# What was asked beforehand: a name, and the two ways of which one is subtracted
QUESTIONS: dict[str, tuple[_Way, _Way]] = {
    "p at all, over none": (_RIGHT, (NONE, "estimated", RECORDED)),
    "continuous p, over the nearest trained": (_RIGHT, (BOTH, "nearest", RECORDED)),
    "plan by p, over replay by nearest p": (_RIGHT, (NEAREST_P, "estimated", RECORDED)),
    "right p in the prediction, over the farthest": (
        (PREDICTS, "estimated", RECORDED),
        (PREDICTS, "farthest", RECORDED),
    ),
}
# What was asked afterwards
MORE: dict[str, tuple[_Way, _Way]] = {
    "right p in both, over the farthest": (_RIGHT, (BOTH, "farthest", RECORDED)),
    "plan by p, over the nearest replay of any cloth": (
        _RIGHT,
        (ANY_OTHER, "estimated", RECORDED),
    ),
}
_LEARNED = (BOTH, "estimated", REPLANNED)
# By the best of ten periods
LATER: dict[str, tuple[_Way, _Way]] = {
    "network with p, over evolution strategy": (
        _LEARNED,
        (EVOLUTION, "estimated", REPLANNED),
    ),
    "network with p, over Gaussian process": (
        _LEARNED,
        (PROCESS, "estimated", REPLANNED),
    ),
    "p at all, over none, ten periods": (_LEARNED, (NONE, "estimated", REPLANNED)),
    "continuous p, over the nearest, ten periods": (
        _LEARNED,
        (BOTH, "nearest", REPLANNED),
    ),
    "p in prediction and choice, over choice alone": (
        _LEARNED,
        (CHOOSES, "estimated", REPLANNED),
    ),
    "learning, over replay by nearest p": (
        _LEARNED,
        (NEAREST_P, "estimated", RECORDED),
    ),
}


def groups(values: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """All tasks `[tasks, trainings]`, those of each arm, and held-out targets."""
    arms = values.index.get_level_values("arm")
    held_out = values.index.get_level_values("target").str.contains("/")
    found = {"all": values}
    for arm in transfer.TARGETS:
        found[arm] = values[(arms == arm) & ~held_out]
    found["held-out"] = values[held_out]
    return {name: part for name, part in found.items() if len(part)}


def effects(table: pd.DataFrame) -> pd.DataFrame:
    """Differences of ways, by question and group of tasks.

    Columns are both means over that of random commands, and their difference with the
    ends of its 95 % interval over tasks and trainings.
    """
    rows = []
    for questions, periods in ((QUESTIONS | MORE, 1), (LATER, _TENTH)):
        for question, (way, rival) in questions.items():
            values = select(table, *way, periods=periods)
            others = select(table, *rival, periods=periods)
            their_groups = groups(others)
            for group, part in groups(values).items():
                other = their_groups[group]
                gap, low, high = crossed_interval((part - other).to_numpy())
                row = {"question": question, "group": group}
                row |= {"way": part.to_numpy().mean(), "rival": other.to_numpy().mean()}
                rows.append(row | {"difference": gap, "low": low, "high": high})
    return pd.DataFrame(rows).set_index(["question", "group"])


def oracle_over_random(search: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """First throws of the search on the true simulator over random commands'.

    One column, tasks as in `select`. Both are distances by the autoencoder of twenty
    times the recordings.

    Args:
        search: stored rows of `oracle_transfer`.
        runs: stored rows of `transfer`, which say how near random commands came.
    """
    keys = ["arm", "target", "cloth"]
    by_distance = search[~search["overlap"].astype(bool)].set_index(keys)
    first = by_distance["best"].map(lambda best: best[0])
    random = runs.groupby(keys)["random"].mean()
    wanted = pd.DataFrame(_tasks())[keys]
    there = [tuple(task) for task in wanted.to_numpy()]
    found = (first / random).dropna()
    return found[found.index.isin(there)].to_frame("oracle")


def less_known(table: pd.DataFrame, **less: int) -> np.ndarray:
    """First throws with less known, minus those with all `[tasks, trainings]`.

    Args:
        table: stored rows of `what_p_buys`.
        less: one of `LESS`.
    """
    values = select(table, *_RIGHT, **less)  # type: ignore[arg-type]
    gaps = values - select(table, *_RIGHT)
    return gaps.dropna(how="all").dropna(axis=1).to_numpy()


EXPERIMENTS = (Experiment("what_p_buys", _run_one, _cases, slow=True),)
