"""The results in seven rows, in words that need no paper.

Each question has a function of the stored tables of one amount of recordings that
returns its answer. Numbers in brackets are the ends of a 95 % interval.
"""

import contextlib
from collections.abc import Callable

import numpy as np
import pandas as pd

import studies
from clothlab.analysis import crossed_interval, late_median
from clothlab.data import Folder
from studies import claims, iterative_control, what_p_buys
from studies.claims import AMOUNTS_IN_WORDS, PAPER, TWENTY, Evidence, NotMeasured

Answer = Callable[[Evidence], str]


def amount(evidence: Evidence) -> str:
    """An amount of recordings in words, and over how many repetitions numbers are."""
    units = _repetitions(evidence, "estimation")
    of = "each made from nothing" if evidence.of == "world" else "on one set"
    return f"{AMOUNTS_IN_WORDS[evidence.amount]}: {units}, {of}"


def _repetitions(evidence: Evidence, table: str) -> str:
    """How many there are in a table, such as "10 worlds"."""
    units = evidence[table]["unit"]
    return _counted(units.nunique(), evidence.of)


def _counted(count: int, of: str) -> str:
    return f"{count} {of}{'s' * (count > 1)}"


def _unless_as_above(evidence: Evidence, repetitions: str) -> str:
    """Repetitions in brackets, where they are not those of the head."""
    head = _repetitions(evidence, "estimation")
    return "" if repetitions == head else f" ({repetitions})"


def said(answer: Answer, evidence: Evidence) -> str:
    """An answer, or that it was not measured."""
    try:
        return answer(evidence)
    except NotMeasured:
        return "not measured"


def _with_interval(
    values: pd.Series,
    unit: str = "",
    scale: float = 1,
    digits: int = 0,
    within: tuple[float, float] = (-np.inf, np.inf),
) -> str:
    """Mean of numbers with its 95 % interval, such as "81 % (74 to 89)".

    Args:
        values: one of each repetition; of a single one, or where none differs, there
            is no interval.
        unit: of the numbers.
        scale: by which they are multiplied.
        digits: behind the point.
        within: what a number can be at all.
    """
    numbers = scale * values.to_numpy(dtype=float)
    mean, low, high = crossed_interval(numbers[:, None])
    mean_words = f"{mean:.{digits}f}{unit}"
    if len(numbers) == 1 or np.ptp(numbers) < 1e-9:
        return mean_words
    low, high = np.clip((low, high), *within)
    return f"{mean_words} ({low:.{digits}f} to {high:.{digits}f})"


def _share(values: pd.Series, digits: int = 0) -> str:
    return _with_interval(values, " %", 100, digits, within=(0, 100))


def _word(claim: str, evidence: Evidence, words: dict[str, str]) -> str:
    """What the verdict on a claim is called, in bold; nothing for a single number."""
    judged = claims.judge_by(claim, evidence)
    return f"**{words[judged.verdict]}**: " if judged.count > 1 else ""


def _which_cloth(evidence: Evidence) -> str:
    right = claims.named_right(evidence)["cloth"]
    return f"right in **{_share(right)}** of runs"


def _arranged(evidence: Evidence) -> str:
    follows = claims.pc1_correlations(evidence).mean()
    by_fall = follows["ratio"] > follows["damping"]
    by = "how fast they fall" if by_fall else "their drag"
    return (
        f"by **{by}**: rank correlation with drag over mass {follows['ratio']:.2f}, "
        f"with drag alone {follows['damping']:.2f}"
    )


_OFTENER = {
    "holds": "yes",
    "equal": "no",
    "contradicted": "no, less often",
    "inconclusive": "open",
}


def _within_half(evidence: Evidence, target: int) -> str:
    """Share of moments, under control and under random commands."""
    runs = evidence["control"].query(f"target == 'target-{target}'")
    shares = {}
    for kind in ("control", "random"):
        near = runs[kind].map(lambda distance: claims.rate(distance, 0.5))
        shares[kind] = near.groupby(runs["unit"]).mean()
    word = _word(f"control_{target}", evidence, _OFTENER)
    by_chance = 100 * shares["random"].mean()
    return f"{word}{_share(shares['control'], 1)}, by chance {by_chance:.1f} %"


_SEEN = {
    "holds": "yes",
    "equal": "no difference",
    "contradicted": "no, farther",
    "inconclusive": "not seen",
}


def _knows(evidence: Evidence) -> str:
    """The right p against a wrong one, as near to the hard picture."""
    runs = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    gained = claims.right_over_wrong(runs).mean(axis=1)
    hanging = runs["distance"].str[0].groupby(runs["unit"]).mean()
    word = _word("right_p_nearer", evidence, _SEEN)
    nearer = _with_interval(gained / hanging, " %", 100)
    return f"{word}nearer by {nearer} of the way from hanging still"


_PRINTED = {
    "holds": "yes",
    "equal": "yes",
    "contradicted": "no",
    "inconclusive": "open",
}


def _faster(evidence: Evidence) -> str:
    gain = claims.speed_gain(evidence)
    word = _word("stiffness_speed", evidence, _PRINTED)
    foams = _unless_as_above(evidence, _repetitions(evidence, "foam_control"))
    return f"{word}{_with_interval(gain, ' %', 100)} with our motors{foams}"


# The runs of `iterative_control` that are like those of `control_rivals`
_SAME = "recordings == 'all' and p == 'right' and repeat == 0 and arm == 'torque'"


def rivals(evidence: Evidence) -> pd.DataFrame:
    """Late distance over the hanging cloth's, of each controller on the torque arm.

    Median of the last ten periods of a run; a row for each unit, means over both
    targets and both cloths.
    """
    try:
        runs = evidence["control_rivals"]
    except NotMeasured:
        if evidence.amount != TWENTY:
            raise
        runs = evidence["iterative_control"].query(_SAME)
    return _late(runs).pivot_table("late", "unit", "controller")


def _late(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs with the median distance of their last ten periods over the hanging one."""
    return runs.assign(late=runs["best"].map(late_median) / runs["still"])


def rivals_in_new_worlds(*, data: Folder = None) -> pd.DataFrame:
    """Means of `late` with twenty times as many recordings, also of their own.

    A row for each controller, columns by target and world. World 0 has five trainings
    on the recordings on which all choices were made; the others are made from nothing,
    each once.
    """
    anew = _late(studies.load("worlds-control_rivals", data=data))
    first = studies.load("iterative_control", data=data).query(_SAME)
    both = pd.concat([_late(first).assign(world=0), anew])
    return both.pivot_table("late", "controller", ["target", "world"])


def _replay(evidence: Evidence) -> str:
    late = rivals(evidence)
    others = _unless_as_above(evidence, _counted(len(late), evidence.of))
    replay = _share(late[iterative_control.REPLAY])
    papers = _share(late[iterative_control.PAPERS])
    starts = _share(late[iterative_control.STARTS])
    learning = _share(late[iterative_control.ITERATIVE])
    return (
        f"replay **{replay}**, the paper's controller {papers}, with recorded first "
        f"plans {starts}, learning from each throw {learning}{others}"
    )


QUESTIONS: dict[str, Answer] = {
    "Swung for 40 s: which of nine cloths is it? (Chance: 11 %)": _which_cloth,
    "By what do its two numbers for a cloth, p, sort them? (Paper: drag)": _arranged,
    "Easy picture: for what share of the time is the cloth more than halfway there, "
    "from hanging still?": lambda evidence: _within_half(evidence, 2),
    "Hard picture, the cloth spread in the air: the same": (
        lambda evidence: _within_half(evidence, 1)
    ),
    "Does control come nearer to it because it knows the cloth?": _knows,
    "Does a variable stiffness make the hand 12 % faster?": _faster,
    "A rival without a network replays this cloth's best recorded throw. How much of "
    "the way is left, over both pictures?": _replay,
}
# What they read
TABLES = (
    "estimation",
    "trained_p",
    "control",
    "joint_arms",
    "foam_control",
    "control_rivals",
)


def sentences(*, data: Folder = None) -> list[str]:
    """What p and the network are for, in three sentences."""
    bought = what_p_buys.effects(studies.load("what_p_buys", data=data))

    def nearer(question: str, group: str = "all") -> str:
        """How much nearer a way is than its rival, over a group of tasks."""
        effect = bought.loc[(question, group)]
        mean, low, high = (
            -100 * effect[each] for each in ("difference", "high", "low")
        )
        return f"{mean:.0f} % ({low:.0f} to {high:.0f})"

    named = studies.load("naming", data=data).groupby("method")["right"]
    least, most = named.min(), named.max()
    return [
        "1. **p** beats the same robot without p, over cloths and sheets of foam: the "
        "first throw with a new one ends nearer, by "
        f"{nearer('p at all, over none')} of the distance at which random commands "
        f"end. Over cloths alone it is {nearer('p at all, over none', 'torque')}. It "
        "is not seen to beat sending the nearest recording of any of them: "
        f"{nearer('plan by p, over the nearest replay of any cloth')}.",
        "2. **The network** names the cloth better than a regression for each cloth "
        f"does: of 18 runs that no training saw, {least['p']} to {most['p']} by its p, "
        f"{least['regression']} to {most['regression']} by regressions.",
        "3. With a recording of this very cloth near this very picture, **neither** "
        f"p nor the network is needed: {_times_nearer(data)}.",
    ]


def _times_nearer(data: Folder) -> str:
    """How far the paper's controller stays away over replay, by amount of recordings.

    Of twenty times as many by new worlds alone: in world 0 replay comes several times
    nearer to the hard target than in any of them.
    """
    late = {}
    with contextlib.suppress(NotMeasured):
        late[PAPER] = rivals(Evidence(PAPER, data))
    with contextlib.suppress(KeyError):
        worlds = rivals_in_new_worlds(data=data).T.groupby(level="world").mean()
        late[TWENTY] = worlds.drop(index=0)
    found = []
    for amount, table in late.items():
        mean = table.mean()
        times = mean[iterative_control.PAPERS] / mean[iterative_control.REPLAY]
        repeated = _counted(len(table), "world")
        found.append(f"{times:.1f} ({AMOUNTS_IN_WORDS[amount]}, {repeated})")
    return f"sending it again comes nearer by a factor of {', '.join(found)}"
