"""What the paper claims, and a verdict on each sentence of it.

    from studies import claims

    claims.judge("constants_in_p")  # with the paper's amount of recordings
    claims.judge("constants_in_p", claims.TWENTY)  # with twenty times as many
    claims.numbers("constants_in_p")  # one number for each world

The sentences stand in `claims.toml`, with what is measured for each, and margins. Here
each has a function of the stored tables that returns its numbers, positive where things
are as the paper says. README and notebook 15 show what comes out, and have no verdict
of their own.
"""

import contextlib
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from itertools import product

import numpy as np
import pandas as pd
from scipy.stats import spearmanr, t as student

from clothlab._validation import choose
from clothlab.analysis import best_per_period, crossed_interval, rate_interval
from clothlab.data import Folder, load_table
from clothlab.findings import finding
from clothlab.simulation.cloth import CLOTHS, get_cloth
from studies._grid import PAPER
from studies.iterative_control import ITERATIVE
from studies.joint_estimation_control import ESTIMATED, RIGHT, WRONG, thirds
from studies.stiffness import CORRECT, FIXED, RANDOM, WARM, WRONG as WRONG_FOAM

# Amounts of recordings: the paper's comes first
TWENTY = ""
AMOUNTS = (PAPER, TWENTY)
AMOUNTS_IN_WORDS = {PAPER: "the paper's recordings", TWENTY: "twenty times as many"}
VERDICTS = ("holds", "equal", "contradicted", "inconclusive")
# So many worlds go before trainings: the interval of fewer would say next to nothing
ENOUGH = 5


class NotMeasured(KeyError):
    """A claim of which nothing is stored for an amount of recordings."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A sentence of the paper, and what is measured for it; see `claims.toml`."""

    name: str
    part: str
    short: str
    says: str
    figure: str
    measured: str
    unit: str
    margin: float
    kind: str
    by: str
    notebook: str
    of: str = "world"
    chance: float | None = None
    varies: bool = True
    afterwards: bool = False
    floor: bool = False

    def verdict(self, low: float, high: float) -> str:
        """One of `VERDICTS`, by the ends of a 95 % interval."""
        within = -self.margin <= low and high <= self.margin
        if self.kind == "value":
            beyond = low > self.margin or high < -self.margin
            return "holds" if within else "contradicted" if beyond else "inconclusive"
        if within:
            return "equal"
        if low > 0:
            return "holds"
        return "contradicted" if high < 0 else "inconclusive"


@dataclass(frozen=True)
class Judged:
    """A claim's numbers in short, and the verdict."""

    claim: Claim
    mean: float
    low: float  # end of the 95 % interval
    high: float
    count: int  # of numbers
    of: str  # what each number is of: "world", "training", "episode", "target"

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        return self.claim.verdict(self.low, self.high)

    @property
    def short(self) -> str:
        """The mean with its unit, to a tenth of the margin."""
        unit = "" if self.claim.unit in ("", "of 1") else f" {self.claim.unit}"
        return f"{self.mean:.{self._digits}f}{unit}"

    @property
    def figure(self) -> str:
        """Mean and interval in words."""
        if self.low == self.high or not np.isfinite(self.low):
            return self.short
        ends = f"{self.low:.{self._digits}f} to {self.high:.{self._digits}f}"
        return f"{self.short} ({ends})"

    @property
    def repeated(self) -> str:
        """How many numbers, of what."""
        if not self.claim.varies:
            return "nothing varies"
        return f"{self.count} {self.of}{'s' * (self.count > 1)}"

    @property
    def _digits(self) -> int:
        return 0 if self.claim.margin >= 1 else 3 if self.claim.margin < 0.02 else 2


class Evidence:
    """Stored tables of one amount of recordings, each row with its `unit`.

    Worlds, in which all is made anew, go before trainings that share recordings and an
    autoencoder, once there are `ENOUGH`. On world 0, the one in `data/`, measures and
    margins were chosen, so that no other world's verdict counts it.

    Args:
        amount: one of `AMOUNTS`.
        data: folder of the tables; by default that of `clothlab.data`.
    """

    def __init__(self, amount: str = PAPER, data: Folder = None):
        self.amount = amount
        self.of = "training"
        self._data = data
        self._read: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        """A table; `NotMeasured` if there is none of this amount."""
        if name not in self._read:
            self._read[name] = self._find(name)
        table = self._read[name]
        self.of = "world" if "world" in table else "training"
        return table

    def trainings(self, name: str) -> pd.DataFrame:
        """A table of trainings, also where there is one of worlds."""
        self.of = "training"
        return self._of_trainings(name)

    def _find(self, name: str) -> pd.DataFrame:
        """Of worlds, or of trainings, with the number of each unit."""
        worlds = self._stored(f"worlds-{name}{self.amount}")
        if worlds is not None and worlds["world"].nunique() >= ENOUGH:
            return worlds.assign(unit=worlds["world"])
        return self._of_trainings(name)

    def _of_trainings(self, name: str) -> pd.DataFrame:
        trainings = self._stored(f"{name}{self.amount}")
        if trainings is None:
            raise NotMeasured(f"no table {name}{self.amount}: run `make results`")
        if "model" not in trainings:  # one for all
            return trainings.assign(unit=0)
        return trainings.assign(unit=trainings["model"])

    def of_no_amount(self, name: str) -> pd.DataFrame:
        """A table that no recordings stand behind; `NotMeasured` if there is none."""
        table = self._stored(name)
        if table is None:
            raise NotMeasured(f"no table {name}: run `make results`")
        return table

    def _stored(self, name: str) -> pd.DataFrame | None:
        with contextlib.suppress(KeyError):
            return load_table(name, data=self._data)
        return None


Numbers = Callable[[Evidence], pd.Series]


def _of_world(values: pd.Series, table: pd.DataFrame) -> pd.Series:
    """Mean of each unit."""
    return values.groupby(table["unit"]).mean()


# p of the cloths


def biases_of(evidence: Evidence, arm: str) -> dict[int, dict[str, np.ndarray]]:
    """Trained p of each material, for each unit.

    Worlds may have been made with one arm alone: the other one has its trainings.
    """
    table = evidence["trained_p"]
    if not table["weights"].str.startswith(arm).any():
        table = evidence.trainings("trained_p")
    table = table[table["weights"].str.startswith(arm)]
    found = {}
    for unit, names, p in zip(
        table["unit"], table["materials"], table["p"], strict=True
    ):
        found[unit] = dict(zip(names.split(), p, strict=True))
    return found


def _logs(names: list[str]) -> dict[str, np.ndarray]:
    """Logarithms of what cloths differ in, by its name, `[K]` each."""
    cloths = [get_cloth(name) for name in names]
    damping = np.log([cloth.damping for cloth in cloths])
    mass = np.log([cloth.mass for cloth in cloths])
    return {"damping": damping, "mass": mass, "ratio": damping - mass}


def pc1_correlations(evidence: Evidence) -> pd.DataFrame:
    """Rank correlations of PC1 with what cloths differ in, without signs.

    A row for each unit; columns "damping", "mass" and "ratio".
    """
    found = {}
    for unit, biases in biases_of(evidence, "torque").items():
        pc1, _ = _principal_components(np.stack([*biases.values()]))
        found[unit] = {
            name: abs(spearmanr(pc1, logs).statistic)
            for name, logs in _logs([*biases]).items()
        }
    return pd.DataFrame.from_dict(found, orient="index")


def _pc1_is_damping(evidence: Evidence) -> pd.Series:
    follows = pc1_correlations(evidence)
    return follows["damping"] - follows[["mass", "ratio"]].max(axis=1)


def _principal_components(p: np.ndarray) -> tuple[np.ndarray, float]:
    """Coordinates on PC1 `[K]` of p `[K, D_p]`, and its share of the variance."""
    left, sizes, _ = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)
    return left[:, 0] * sizes[0], float(sizes[0] ** 2 / (sizes**2).sum())


def _share_of_pc1(evidence: Evidence, arm: str) -> pd.Series:
    shares = {}
    for unit, biases in biases_of(evidence, arm).items():
        _, shares[unit] = _principal_components(np.stack([*biases.values()]))
    return pd.Series(shares)


# Estimates of p


def _known(evidence: Evidence) -> pd.DataFrame:
    """Estimates of cloths that were trained on."""
    table = evidence["estimation"]
    return table[table["distance"].notna()]


# In the paper's figure
SHOWN = ("damp0.05-mass0.05", "damp0.07-mass0.10", "damp0.03-mass0.15")


def _estimate_approaches(evidence: Evidence) -> pd.Series:
    runs = _known(evidence)
    runs = runs[runs["cloth"].isin(SHOWN)]
    return _of_world(1 - runs["distance"] / runs["start"], runs)


def named_right(evidence: Evidence) -> pd.DataFrame:
    """How often the nearest trained p is right, 0 to 1.

    A row for each unit; columns "cloth", "damping" and "mass".
    """
    runs = _known(evidence)
    right = {"cloth": runs["nearest"] == runs["cloth"]}
    for name in ("damping", "mass"):
        said = runs["nearest"].map(lambda each, name=name: getattr(CLOTHS[each], name))
        true = runs["cloth"].map(lambda each, name=name: getattr(CLOTHS[each], name))
        right[name] = said == true
    return pd.DataFrame(right).groupby(runs["unit"]).mean()


def _constants_in_p(evidence: Evidence) -> pd.Series:
    return named_right(evidence)[["damping", "mass"]].min(axis=1) - 1 / 3


def _estimate_finds(evidence: Evidence) -> pd.Series:
    return named_right(evidence)["cloth"] - 1 / 9


def _median_errors(runs: pd.DataFrame, errors: np.ndarray) -> pd.DataFrame:
    """Medians of sizes of errors `[runs, K]`, a row for each unit."""
    sizes = pd.DataFrame(np.abs(errors), runs.index)
    return sizes.groupby(runs["unit"]).median()


def _mass_less_exact(evidence: Evidence) -> pd.Series:
    runs = _known(evidence)
    medians = _median_errors(runs, np.stack(runs["error"]))  # of C_damp and C_mass
    return medians[1] - medians[0]


def _estimate_of_new_cloths(evidence: Evidence) -> pd.Series:
    table = evidence["estimation"]
    runs = table[table["distance"].isna()]
    both = _median_errors(runs, np.stack(runs["error"]))
    return 0.2 - both.mean(axis=1)


def _little_effect_less_exact(evidence: Evidence) -> pd.Series:
    runs = _known(evidence)
    logs = np.log1p(np.stack(runs["error"]))  # of C_damp and C_mass
    product_and_ratio = np.stack([logs.sum(axis=1), logs[:, 0] - logs[:, 1]], axis=1)
    medians = _median_errors(runs, product_and_ratio)
    return medians[0] - medians[1]


# Control of the cloths


def nearness(distance: np.ndarray) -> float:
    """How near a run is, mean of its steps, 0 to 1.

    A step on the target counts 1, one at half of the hanging cloth's distance or
    farther 0, and between them it is linear. It is the area under the curve of the
    paper's figures, the share of steps below a threshold, up to that distance.

    Distances are those of each step `[T]`; a run begins with the hanging cloth.
    """
    limit = 0.5 * distance[0]
    return float(np.maximum(0, 1 - distance[1:] / limit).mean())


_Measure = Callable[[np.ndarray], float]  # of the distances of a run [T]


def rate(distance: np.ndarray, within: float) -> float:
    """Share of a run's steps `[T]` within some share of the hanging cloth's distance.

    A run begins with the hanging cloth.
    """
    return float((distance[1:] < within * distance[0]).mean())


# The paper names one threshold, 0.5 for foams that hang 0.86 from the target
PAPERS_THRESHOLD = 0.5 / 0.86
_papers_rate: _Measure = partial(rate, within=PAPERS_THRESHOLD)


def _task(evidence: Evidence, target: int) -> pd.DataFrame:
    """Runs of `control` towards a target, with the light cloth and the heavy one."""
    table = evidence["control"]
    return table[table["target"] == f"target-{target}"]


def _nearer_than_random(evidence: Evidence, target: int) -> pd.Series:
    runs = _task(evidence, target)
    gained = runs["control"].map(nearness) - runs["random"].map(nearness)
    return _of_world(gained, runs)


def median_best(distances: pd.Series) -> pd.Series:
    """Median over periods of the smallest distance, over that of the hanging cloth.

    Distances are those of each step `[T]` of a run.
    """
    best = distances.map(lambda distance: np.median(best_per_period(distance)))
    return best / distances.str[0]


def _nearer_than_still(evidence: Evidence, target: int) -> pd.Series:
    runs = _task(evidence, target)
    return _of_world(1 - median_best(runs["control"]), runs)


def _as_near_as_recorded(evidence: Evidence) -> pd.Series:
    runs = evidence["control"]
    best = runs["control"].map(np.min)
    return _of_world((runs["recorded"] - best) / runs["still"], runs)


def _target_1_harder(evidence: Evidence) -> pd.Series:
    near = []
    for target in (1, 2):
        runs = _task(evidence, target)
        near.append(_of_world(runs["control"].map(nearness), runs))
    return near[1] - near[0]


def _reproducible(evidence: Evidence) -> pd.Series:
    """A quarter less how far a world is from the mean of all, of four tasks.

    Trainings are not judged: the paper repeats all, "including learning".
    """
    runs = evidence["control"]
    if evidence.of != "world":
        raise NotMeasured("trainings of one world share recordings and autoencoder")
    near = runs.assign(near=median_best(runs["control"]))
    table = near.pivot_table("near", "unit", ["target", "cloth"])
    return 0.25 - (table / table.mean() - 1).abs().mean(axis=1)


def from_starts(evidence: Evidence) -> pd.DataFrame:
    """Median best distance over the hanging cloth's, by how a period begins.

    A row for each unit and task; columns "last", the last plan alone, and "recorded",
    the best of 200 recorded ones besides.
    """
    runs = evidence["starts"]
    near = runs.assign(near=median_best(runs["distance"]))
    table = near.pivot_table("near", ["unit", "target", "cloth"], "start")
    return table.rename(columns={"recorded 200": "recorded"})[["last", "recorded"]]


def starts_by_experience(*evidences: Evidence) -> pd.DataFrame:
    """Means of `from_starts`, by amount of recordings and target."""
    means = {
        AMOUNTS_IN_WORDS[evidence.amount]: from_starts(evidence)
        .groupby("target")
        .mean()
        for evidence in evidences
    }
    return pd.concat(means)


def _warm_start(evidence: Evidence) -> pd.Series:
    near = from_starts(evidence)
    return (near["recorded"] - near["last"]).groupby("unit").mean()


def _other_targets(evidence: Evidence, of: str) -> pd.Series:
    """Of each target of a set, which has a training and a cloth of its own."""
    if evidence.amount == PAPER:
        raise NotMeasured("throws at other targets are by twenty times the recordings")
    runs = evidence.of_no_amount("transfer")
    long = runs["method"].eq(ITERATIVE) & runs["periods"].gt(10)
    there = runs["target"].str.startswith(of) & runs["p"].eq("estimated")
    runs = runs[long & there]
    tenth = runs["best"].str[9] / runs["random"]
    return 0.5 - tenth.groupby(runs["target"]).mean()


# Estimation and control at once


def _found_in_control(evidence: Evidence) -> pd.Series:
    table = evidence["joint_estimation_control"]
    return _of_world(1 - table["ratio"], table)


def _arm(evidence: Evidence, knowledge: str) -> pd.DataFrame:
    """Runs in which control knows p so, with the paper's start and target."""
    table = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    return table[table["knowledge"] == knowledge]


def _improvement(runs: pd.DataFrame) -> pd.Series:
    """How much nearer the last third of a run is than the first."""
    first, last = thirds(runs)
    return _of_world(pd.Series(first - last, runs.index), runs)


def _improves_by_p(evidence: Evidence) -> pd.Series:
    by_time_alone = _improvement(_arm(evidence, WRONG))
    return _improvement(_arm(evidence, ESTIMATED)) - by_time_alone


def right_over_wrong(runs: pd.DataFrame) -> pd.DataFrame:
    """Median best distance with p fixed wrong, minus that with p fixed right.

    A row for each unit, a column for each target [s.d. of z].
    """
    best = runs["distance"].map(lambda each: np.median(best_per_period(each)))
    table = runs.assign(best=best)
    near = table.pivot_table("best", "unit", ["knowledge", "target"])
    return near[WRONG] - near[RIGHT]


def _right_p_nearer(evidence: Evidence) -> pd.Series:
    runs = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    return right_over_wrong(runs).mean(axis=1)


def _right_p_nearer_from_starts(evidence: Evidence) -> pd.Series:
    runs = evidence["joint_arms"].query("starts == 200")
    if runs.empty:
        raise NotMeasured("no runs from recorded starts: run `make worlds`")
    return right_over_wrong(runs).mean(axis=1)


def _chamfer_target_2(evidence: Evidence) -> pd.Series:
    table = evidence["chamfer"].query("target == 'target-2'")
    return table.set_index("unit")["correlation"] - 0.811


# Foams


def _ellipse(evidence: Evidence) -> pd.Series:
    """The share of its area that the ellipse loses; nothing varies in it."""
    table = evidence.of_no_amount("stiffness_ellipse").query("spring == 'nonlinear'")
    areas = table.set_index("f_const")["area"]
    return pd.Series([1 - areas[70] / areas[10]])


def _places(evidence: Evidence) -> pd.DataFrame:
    """Where estimates under control end, 0 at hard-1, 1 at hard-3, by foam."""
    table = evidence["foam_estimation"]
    return table.pivot_table("place", "unit", "cloth")


def _hard_2_midway(evidence: Evidence) -> pd.Series:
    """How far from the middle its estimate is, also beside the line."""
    runs = evidence["foam_estimation"].query("cloth == 'hard-2'")
    trained = biases_of(evidence, "muscle")
    away = {}
    for unit, trace in zip(runs["unit"], runs["trace"], strict=True):
        first = trained[unit]["hard-1"]
        last = trained[unit]["hard-3"]
        gap = np.linalg.norm(trace[-1] - (first + last) / 2)
        away[unit] = gap / np.linalg.norm(last - first)
    return 0.25 - pd.Series(away)


def _hard_1_and_3_found(evidence: Evidence) -> pd.Series:
    places = _places(evidence)
    away = places["hard-1"].abs() + (places["hard-3"] - 1).abs()
    return 0.25 - away / 2


def _under(
    evidence: Evidence, condition: str, cloth: str | None = None
) -> pd.DataFrame:
    """Runs of `foam_control` under one condition, with one foam or with both."""
    table = evidence["foam_control"]
    table = table[table["condition"] == condition]
    return table if cloth is None else table[table["cloth"] == cloth]


def _foam(
    evidence: Evidence, measure: _Measure, condition: str, cloth: str | None = None
) -> pd.Series:
    """A measure of the distances of runs under one condition."""
    runs = _under(evidence, condition, cloth)
    return _of_world(runs["distance"].map(measure), runs)


def _beyond(
    evidence: Evidence, measure: _Measure, other: str, condition: str = CORRECT
) -> pd.Series:
    """The measure under one condition less that under another."""
    return _foam(evidence, measure, condition) - _foam(evidence, measure, other)


def foam_differences(*evidences: Evidence) -> pd.DataFrame:
    """Three measures of one comparison beside each other, with intervals.

    A row for each amount of recordings and each rival of Correct, and for Correct as
    published over Random; positive where the first one is better.
    """
    pairs = {
        "Correct, over Random": (CORRECT, RANDOM),
        "Correct, over Wrong": (CORRECT, WRONG_FOAM),
        "Correct, over a fixed stiffness": (CORRECT, FIXED),
        "as published, over Random": (WARM, RANDOM),
    }
    measures: dict[str, _Measure] = {
        "nearness": nearness,
        f"steps within {PAPERS_THRESHOLD:.0%} of hanging": _papers_rate,
        "least distance [s.d. of z]": lambda distance: -float(np.min(distance)),
    }
    rows = {}
    for evidence, (label, pair) in product(evidences, pairs.items()):
        row = {}
        for name, measure in measures.items():
            gained = _beyond(evidence, measure, pair[1], pair[0]).to_numpy()
            mean, low, high = crossed_interval(gained[:, None])
            row[name] = f"{mean:.3f} ({low:.3f} to {high:.3f})"
        rows[AMOUNTS_IN_WORDS[evidence.amount], label] = row
    return pd.DataFrame.from_dict(rows, orient="index")


def _stiff_then_soft(evidence: Evidence) -> pd.Series:
    runs = _under(evidence, CORRECT)
    share = runs["fall"].map(lambda fall: (np.asarray(fall) > 0).mean())
    return _of_world(share, runs) - 0.5


def _stiffness_speed(evidence: Evidence) -> pd.Series:
    return speed_gain(evidence) - 0.12


def speed_gain(evidence: Evidence) -> pd.Series:
    """Highest hand speed with free stiffness over that with a fixed one, minus 1.

    With the arm as it is assumed, the first of its variants.
    """
    speeds = []
    for condition in (CORRECT, FIXED):
        runs = _under(evidence, condition)
        speeds.append(_of_world(runs["peak_hand_speed"].str[0], runs))
    free, fixed = speeds
    return free / fixed - 1


def _soft_foam_later(evidence: Evidence) -> pd.Series:
    """Delay and time to come down, of the soft foam less those of the hard one."""
    runs = _under(evidence, CORRECT)
    taken = runs["delay"] + runs["lowering"].map(np.median)
    by_foam = runs.assign(taken=taken).pivot_table("taken", "unit", "cloth")
    return by_foam["soft-1"] - by_foam["hard-1"]


def _hard_1_harder(evidence: Evidence) -> pd.Series:
    soft = _foam(evidence, nearness, CORRECT, "soft-1")
    return soft - _foam(evidence, nearness, CORRECT, "hard-1")


def _table_set(evidence: Evidence) -> pd.Series:
    """Whether an episode succeeded, by models with what they learned from."""
    if evidence.amount == PAPER:
        raise NotMeasured("the table's model has one amount of recordings")
    runs = evidence.of_no_amount("table_setting").query("method == 'dynamic'")
    return runs["spread"] & runs["placed"]


_NUMBERS: Mapping[str, Numbers] = {
    "pc1_is_damping": _pc1_is_damping,
    "constants_in_p": _constants_in_p,
    "estimate_finds": _estimate_finds,
    "estimate_approaches": _estimate_approaches,
    "mass_less_exact": _mass_less_exact,
    "estimate_of_new_cloths": _estimate_of_new_cloths,
    "little_effect_less_exact": _little_effect_less_exact,
    "control_1": partial(_nearer_than_random, target=1),
    "control_2": partial(_nearer_than_random, target=2),
    "nearer_than_still_1": partial(_nearer_than_still, target=1),
    "nearer_than_still_2": partial(_nearer_than_still, target=2),
    "as_near_as_recorded": _as_near_as_recorded,
    "target_1_harder": _target_1_harder,
    "reproducible": _reproducible,
    "warm_start": _warm_start,
    "held_out_targets": partial(_other_targets, of="held-out/"),
    "drawn_targets": partial(_other_targets, of="drawn/"),
    "found_in_control": _found_in_control,
    "improves_by_p": _improves_by_p,
    "right_p_nearer": _right_p_nearer,
    "right_p_nearer_from_starts": _right_p_nearer_from_starts,
    "chamfer_target_2": _chamfer_target_2,
    "ellipse": _ellipse,
    "foam_corners": lambda evidence: 0.85 - _share_of_pc1(evidence, "muscle"),
    "hard_2_midway": _hard_2_midway,
    "hard_1_and_3_found": _hard_1_and_3_found,
    "stiff_then_soft": _stiff_then_soft,
    "stiffness_speed": _stiffness_speed,
    "soft_foam_later": _soft_foam_later,
    "foam_random": partial(_beyond, measure=nearness, other=RANDOM),
    "foam_random_as_published": partial(
        _beyond, measure=nearness, other=RANDOM, condition=WARM
    ),
    "foam_rate_as_published": partial(
        _beyond, measure=_papers_rate, other=RANDOM, condition=WARM
    ),
    "foam_wrong_p": partial(_beyond, measure=nearness, other=WRONG_FOAM),
    "foam_no_stiffness": partial(_beyond, measure=nearness, other=FIXED),
    "foam_farthest": partial(_beyond, measure=np.max, other=RANDOM),
    "hard_1_harder": _hard_1_harder,
    "table_set": _table_set,
}


# What depends on a camera, a target and a scale of p that are not the paper's


def not_comparable() -> pd.DataFrame:
    """Numbers that the paper prints of its own set-up beside those of ours."""
    table: dict[str, dict[str, float]] = {"the paper": {}}
    for amount in AMOUNTS:
        evidence = Evidence(amount)
        table[AMOUNTS_IN_WORDS[amount]] = here = {}
        for target, theirs in ((1, 1.55), (2, 1.36)):
            label = f"the hanging cloth's distance from Target-{target} [s.d. of z]"
            table["the paper"][label] = theirs
            here[label] = _task(evidence, target)["still"].mean()
        label = "the hanging foam's distance [s.d. of z]"
        table["the paper"][label] = 0.86
        here[label] = evidence["foam_control"]["distance"].str[0].mean()
        label = "share of PC1 in the variance of p"
        table["the paper"][label] = 0.65
        here[label] = _share_of_pc1(evidence, "torque").mean()
    return pd.DataFrame(table)


@cache
def all_claims() -> dict[str, Claim]:
    """The claims of `claims.toml`, by name, in the paper's order."""
    text = resources.files("studies").joinpath("claims.toml").read_text("utf-8")
    claims = [Claim(**each) for each in tomllib.loads(text)["claim"]]
    return {claim.name: claim for claim in claims}


def numbers(name: str, amount: str = PAPER, *, data: Folder = None) -> pd.Series:
    """The numbers on which a verdict stands, one for each unit.

    `NotMeasured` where there is none with this amount of recordings.
    """
    return choose("claim", name, _NUMBERS)(Evidence(amount, data))


def judge(name: str, amount: str = PAPER, *, data: Folder = None) -> Judged:
    """Mean, interval and verdict of a claim; `NotMeasured` as `numbers` has it."""
    return judge_by(name, Evidence(amount, data))


def judge_by(name: str, evidence: Evidence) -> Judged:
    """The same, from tables that are read already."""
    claim = choose("claim", name, all_claims())
    found = _NUMBERS[name](evidence)
    if not claim.varies:
        mean = low = high = float(found.item())
    elif claim.chance is None:
        mean, low, high = crossed_interval(found.to_numpy(dtype=float)[:, None])
    else:
        mean, low, high = (each - claim.chance for each in rate_interval(found))
    of = evidence.of if claim.of == "world" else claim.of
    return Judged(claim, mean, low, high, len(found), of)


def lasting(found: Sequence[Judged]) -> list[Judged]:
    """Claims that hold, or are contradicted, also by Bonferroni's rule for all of them.

    Each interval is made so wide that one in twenty experiments has any that misses.
    Rates, whose interval is none of Student's, are left out.
    """
    level = 1 - 0.025 / len(found)
    left = []
    for each in found:
        if each.count < 2 or each.claim.chance is not None:
            continue
        wider = student.ppf(level, each.count - 1) / student.ppf(0.975, each.count - 1)
        low = each.mean + (each.low - each.mean) * wider
        high = each.mean + (each.high - each.mean) * wider
        if each.claim.verdict(low, high) in ("holds", "contradicted"):
            left.append(each)
    return left


def judged(amount: str = PAPER, *, data: Folder = None) -> list[Judged]:
    """All claims that were measured with an amount of recordings, in order."""
    evidence = Evidence(amount, data)
    found = []
    for name in all_claims():
        with contextlib.suppress(NotMeasured):
            found.append(judge_by(name, evidence))
    return found


def side_by_side(*names: str, data: Folder = None) -> pd.DataFrame:
    """What is measured for claims, in words: a column for each amount of recordings."""
    table: dict[str, dict[str, str]] = {}
    for amount in AMOUNTS:
        measured = {}
        for name in names:
            measured[all_claims()[name].short] = _in_words(name, amount, data)
        table[AMOUNTS_IN_WORDS[amount]] = measured
    return pd.DataFrame(table)


def _in_words(name: str, amount: str, data: Folder) -> str:
    try:
        found = judge(name, amount, data=data)
    except NotMeasured:
        return "not measured"
    return f"{found.verdict}: {found.figure}, {found.repeated}"


# Conditions of a notebook


def lower_end(values: np.ndarray) -> float:
    """Of the interval of numbers `[units]`, or of differences `[units, repeats]`."""
    return crossed_interval(np.reshape(values, (len(values), -1)))[1]


def state(verdict: str, names: Sequence[str], amount: str = PAPER) -> None:
    """State that claims have the verdict that a page says they have.

    Args:
        verdict: such as "holds", by all that `judge` asks for.
        names: of the claims.
        amount: of recordings.
    """
    for name in names:
        found = judge(name, amount).verdict
        finding(f"{name}: {verdict}", found == verdict, at_least=1)
