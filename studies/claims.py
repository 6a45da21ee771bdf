"""What the paper claims, and a verdict on each sentence of it.

    from studies import claims

    claims.judge("mass_in_p")  # with the paper's amount of recordings
    claims.judge("mass_in_p", claims.TWENTY)  # with twenty times as many
    claims.numbers("mass_in_p")  # what the verdict stands on, one number for each world

The sentences stand in `claims.toml`, with what is measured for each, and margins. Here
each has a function of the stored tables that returns its numbers, positive where things
are as the paper says. README, `docs/results.md` and notebook 15 show what comes out,
and have no verdict of their own.
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
from clothlab.simulation.cloth import get_cloth
from studies._grid import PAPER
from studies._runs import HEAVY, LIGHT
from studies.joint_estimation_control import ESTIMATED, RIGHT, WRONG, thirds
from studies.stiffness import CORRECT, FIXED, RANDOM, WARM, WRONG as WRONG_FOAM

# Amounts of recordings: the paper's comes first
TWENTY = ""
AMOUNTS = (PAPER, TWENTY)
AMOUNTS_IN_WORDS = {PAPER: "the paper's recordings", TWENTY: "twenty times as many"}
VERDICTS = ("holds", "equal", "contradicted", "inconclusive")


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
    why: str
    chance: float | None = None
    varies: bool = True
    afterwards: bool = False

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
    of: str  # what each number is of: a "world", a "training", a "run"

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
    def _digits(self) -> int:
        return 0 if self.claim.margin >= 1 else 3 if self.claim.margin < 0.02 else 2


class Evidence:
    """Stored tables of one amount of recordings, each row with its `unit`.

    Worlds, in which all is made anew, go before trainings that share recordings and an
    autoencoder. On world 0, the one in `data/`, measures and margins were chosen, so
    that no other world's verdict counts it.

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

    def _find(self, name: str) -> pd.DataFrame:
        """Of worlds, or of trainings, with the number of each unit."""
        worlds = self._stored(f"worlds-{name}{self.amount}")
        if worlds is not None:
            return worlds.assign(unit=worlds["world"])
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
    """Trained p of each material, for each unit."""
    table = evidence["trained_p"]
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


def _pc1_follows(evidence: Evidence, rival: str) -> pd.Series:
    """Rank correlation of PC1 with C_damp, less that with a rival."""
    found = {}
    for unit, biases in biases_of(evidence, "torque").items():
        pc1, _ = _principal_components(np.stack([*biases.values()]))
        logs = _logs([*biases])
        damping = abs(spearmanr(pc1, logs["damping"]).statistic)
        found[unit] = damping - abs(spearmanr(pc1, logs[rival]).statistic)
    return pd.Series(found)


def _principal_components(p: np.ndarray) -> tuple[np.ndarray, float]:
    """Coordinates on PC1 `[K]` of p `[K, D_p]`, and its share of the variance."""
    left, sizes, _ = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)
    return left[:, 0] * sizes[0], float(sizes[0] ** 2 / (sizes**2).sum())


def _readable(evidence: Evidence, constant: int) -> pd.Series:
    """R² of C_damp (0) or C_mass (1), of a cloth that the map has not seen."""
    table = evidence["self_organisation"]
    return _of_world(table["r2"].str[constant], table)


def _mass_less_ordered(evidence: Evidence) -> pd.Series:
    return _readable(evidence, 0) - _readable(evidence, 1)


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


def _estimate_finds(evidence: Evidence) -> pd.Series:
    runs = _known(evidence)
    return _of_world(1.0 * (runs["nearest"] == runs["cloth"]), runs) - 1 / 9


def _mass_less_exact(evidence: Evidence) -> pd.Series:
    runs = _known(evidence)
    errors = pd.DataFrame(np.abs(np.stack(runs["error"])), runs.index)
    medians = errors.groupby(runs["unit"]).median()  # of C_damp and C_mass
    return medians[1] - medians[0]


# Control of the cloths


def nearness(distance: np.ndarray, within: float = 0.5) -> float:
    """How near a run is, mean of its steps, 0 to 1.

    A step on the target counts 1, and one that is too far counts 0. It is the area
    under the curve of the paper's figures, the share of steps below a threshold, up to
    that distance. By default it is half of the hanging cloth's; the paper's own
    threshold, 0.5, is 0.32 to 0.58 of its hanging cloths' distances.

    Args:
        distance: of each step `[T]`; a run begins with the hanging cloth.
        within: how far is too far, over the distance of the hanging cloth.
    """
    limit = within * distance[0]
    return float(np.maximum(0, 1 - distance[1:] / limit).mean())


_Measure = Callable[[np.ndarray], float]  # of the distances of a run [T]
_up_to_hanging: _Measure = partial(nearness, within=1.0)


_CLOTHS = {"light": LIGHT, "heavy": HEAVY}


def _task(evidence: Evidence, target: int, cloth: str | None = None) -> pd.DataFrame:
    """Runs of `control` towards a target, with one cloth or with both."""
    table = evidence["control"]
    table = table[table["target"] == f"target-{target}"]
    return table if cloth is None else table[table["cloth"] == _CLOTHS[cloth]]


def _start_distance(evidence: Evidence, target: int) -> pd.Series:
    runs = _task(evidence, target)
    return _by_autoencoder(_of_world(runs["still"], runs), evidence)


def _by_autoencoder(values: pd.Series, evidence: Evidence) -> pd.Series:
    """Numbers that the autoencoder decides: one for all trainings that share it."""
    return values if evidence.of == "world" else values.iloc[:1]


def _nearness_of_runs(runs: pd.DataFrame) -> pd.Series:
    """Nearness of each run under control."""
    return runs["control"].map(nearness)


def _near(evidence: Evidence, target: int, cloth: str | None = None) -> pd.Series:
    """Nearness under control."""
    runs = _task(evidence, target, cloth)
    return _of_world(_nearness_of_runs(runs), runs)


def _nearer_than_random(
    evidence: Evidence, target: int, cloth: str, measure: _Measure = nearness
) -> pd.Series:
    runs = _task(evidence, target, cloth)
    random = _of_world(runs["random"].map(measure), runs)
    return _of_world(runs["control"].map(measure), runs) - random


def _median_best(runs: pd.DataFrame, column: str) -> pd.Series:
    """Median over periods of the smallest distance, over that of the hanging cloth."""
    best = runs[column].map(lambda distance: np.median(best_per_period(distance)))
    return best / runs[column].str[0]


def _nearer_than_still(evidence: Evidence, target: int) -> pd.Series:
    runs = _task(evidence, target)
    return _of_world(1 - _median_best(runs, "control"), runs)


def _accurate(evidence: Evidence, target: int) -> pd.Series:
    runs = _task(evidence, target)
    best = runs["control"].map(np.min)
    return _of_world((runs["recorded"] - best) / runs["still"], runs)


def _harder(evidence: Evidence, cloth: str | None = None) -> pd.Series:
    """By how much Target-1 is harder."""
    return _near(evidence, 2, cloth) - _near(evidence, 1, cloth)


def _harder_with_light(evidence: Evidence) -> pd.Series:
    return _harder(evidence, "light") - _harder(evidence, "heavy")


def _heavy_is_easier(evidence: Evidence) -> pd.Series:
    return _near(evidence, 1, "heavy") - _near(evidence, 1, "light")


def _reproducible(
    evidence: Evidence, measure: Callable[[pd.DataFrame], pd.Series]
) -> pd.Series:
    """A quarter less how far a measure is from its mean over worlds, of four tasks.

    Trainings are not judged: the paper repeats all, "including learning".
    """
    found = []
    for target, cloth in product((1, 2), _CLOTHS):
        runs = _task(evidence, target, cloth)
        found.append(_of_world(measure(runs), runs))
    if evidence.of != "world":
        raise NotMeasured("trainings of one world share recordings and autoencoder")
    table = pd.concat(found, axis=1)
    return 0.25 - (table / table.mean() - 1).abs().mean(axis=1)


# Estimation and control at once


def _found_in_control(evidence: Evidence) -> pd.Series:
    table = evidence["joint_estimation_control"]
    return _of_world(1 - table["ratio"], table)


def _arm(evidence: Evidence, knowledge: str) -> pd.DataFrame:
    """Runs in which control knows p so, with the paper's start of each period."""
    table = evidence["joint_arms"].query("starts == 0 and target == 'target-1'")
    return table[table["knowledge"] == knowledge]


def _improvement(runs: pd.DataFrame) -> pd.Series:
    """How much nearer the last third of a run is than the first."""
    first, last = thirds(runs)
    return _of_world(pd.Series(first - last, runs.index), runs)


def _improves_by_p(evidence: Evidence) -> pd.Series:
    by_time_alone = _improvement(_arm(evidence, WRONG))
    return _improvement(_arm(evidence, ESTIMATED)) - by_time_alone


def _right_p_nearer(evidence: Evidence) -> pd.Series:
    bests = {}
    for knowledge in (WRONG, RIGHT):
        runs = _arm(evidence, knowledge)
        best = runs["distance"].map(lambda each: np.median(best_per_period(each)))
        bests[knowledge] = _of_world(best, runs)
    return bests[WRONG] - bests[RIGHT]


def _chamfer(evidence: Evidence, target: int) -> pd.Series:
    table = evidence["chamfer"]
    return table.set_index("unit")["correlation"][
        table["target"].to_numpy() == f"target-{target}"
    ]


# Foams


def _ellipse(evidence: Evidence) -> pd.Series:
    """The share of its area that the ellipse loses; nothing varies in it."""
    table = evidence.of_no_amount("stiffness_ellipse").query("spring == 'nonlinear'")
    areas = table.set_index("f_const")["area"]
    return pd.Series([1 - areas[70] / areas[10]])


def _foam_corners(evidence: Evidence) -> pd.Series:
    """Whether the diagonals of the square cross."""
    found = {}
    for unit, p in biases_of(evidence, "muscle").items():
        first = p["soft-1"], p["hard-3"]
        second = p["soft-2"], p["hard-1"]
        found[unit] = _parts(first, second) and _parts(second, first)
    return pd.Series(found)


_Line = tuple[np.ndarray, np.ndarray]  # two points [2]


def _parts(line: _Line, ends: _Line) -> bool:
    """Whether two points are on different sides of a line."""
    start, end = line
    along = end - start
    first, second = (each - start for each in ends)
    sides = [along[0] * each[1] - along[1] * each[0] for each in (first, second)]
    return bool(sides[0] * sides[1] < 0)


def _places(evidence: Evidence) -> pd.DataFrame:
    """Where estimates under control end, 0 at hard-1, 1 at hard-3, by foam."""
    table = evidence["foam_estimation"].query("motion == 'control'")
    return table.pivot_table("place", "unit", "cloth")


def _foam_straight_line(evidence: Evidence) -> pd.Series:
    places = _places(evidence)
    rising = places["hard-1"] < places["hard-2"]
    return rising & (places["hard-2"] < places["hard-3"])


def _hard_2_between(evidence: Evidence) -> pd.Series:
    return 0.25 - (_places(evidence)["hard-2"] - 0.5).abs()


def _hard_1_drifts(evidence: Evidence) -> pd.Series:
    return _places(evidence)["hard-1"] - 0.5


def _hard_3_found(evidence: Evidence) -> pd.Series:
    return 0.25 - (_places(evidence)["hard-3"] - 1).abs()


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


def _least(evidence: Evidence, other: str) -> pd.Series:
    return _foam(evidence, np.min, other) - _foam(evidence, np.min, CORRECT)


def _random_worst(evidence: Evidence) -> pd.Series:
    """The worse one of a wrong p and a fixed stiffness, less random commands."""
    wrong = _foam(evidence, nearness, WRONG_FOAM)
    fixed = _foam(evidence, nearness, FIXED)
    return np.minimum(wrong, fixed) - _foam(evidence, nearness, RANDOM)


def _rate(distance: np.ndarray) -> float:
    """Share of steps below the paper's threshold."""
    return float((distance[1:] < 0.5).mean())


def _stiff_then_soft(evidence: Evidence) -> pd.Series:
    runs = _under(evidence, CORRECT)
    return _of_world(runs["fall"].map(np.median), runs)


def _stiffness_speed(evidence: Evidence) -> pd.Series:
    """Gain with the arm as it is assumed, the first of its variants."""
    speeds = []
    for condition in (CORRECT, FIXED):
        runs = _under(evidence, condition)
        speeds.append(_of_world(runs["peak_hand_speed"].str[0], runs))
    free, fixed = speeds
    return free / fixed - 1


def _of_foam(evidence: Evidence, column: str, cloth: str) -> pd.Series:
    runs = _under(evidence, CORRECT, cloth)
    return _of_world(runs[column].map(np.median), runs)


def _slower_with_soft(evidence: Evidence, column: str) -> pd.Series:
    return _of_foam(evidence, column, "soft-1") - _of_foam(evidence, column, "hard-1")


def _hard_1_harder(evidence: Evidence) -> pd.Series:
    soft = _foam(evidence, nearness, CORRECT, "soft-1")
    return soft - _foam(evidence, nearness, CORRECT, "hard-1")


def _foam_start(evidence: Evidence) -> pd.Series:
    start = _foam(evidence, lambda distance: float(distance[0]), CORRECT)
    return _by_autoencoder(start - 0.86, evidence)


def _table_set(evidence: Evidence) -> pd.Series:
    """Rates of the table's models, with what they learned from."""
    if evidence.amount == PAPER:
        raise NotMeasured("the table's model has one amount of recordings")
    evidence.of = "training"
    runs = evidence.of_no_amount("table_setting").query("method == 'dynamic'")
    done = runs["spread"] & runs["placed"]
    return done.groupby(runs["model"]).mean() - 0.5


_NUMBERS: Mapping[str, Numbers] = {
    "pc1_damping_not_mass": partial(_pc1_follows, rival="mass"),
    "pc1_damping_not_ratio": partial(_pc1_follows, rival="ratio"),
    "damping_in_p": partial(_readable, constant=0),
    "mass_in_p": partial(_readable, constant=1),
    "mass_less_ordered": _mass_less_ordered,
    "pca_share": lambda evidence: _share_of_pc1(evidence, "torque") - 0.65,
    "estimate_approaches": _estimate_approaches,
    "estimate_finds": _estimate_finds,
    "mass_less_exact": _mass_less_exact,
    "start_target_1": lambda evidence: _start_distance(evidence, 1) - 1.55,
    "start_target_2": lambda evidence: _start_distance(evidence, 2) - 1.36,
    "control_1_light": partial(_nearer_than_random, target=1, cloth="light"),
    "control_1_heavy": partial(_nearer_than_random, target=1, cloth="heavy"),
    "control_2_light": partial(_nearer_than_random, target=2, cloth="light"),
    "control_2_heavy": partial(_nearer_than_random, target=2, cloth="heavy"),
    "control_1_light_all": partial(
        _nearer_than_random, target=1, cloth="light", measure=_up_to_hanging
    ),
    "control_1_heavy_all": partial(
        _nearer_than_random, target=1, cloth="heavy", measure=_up_to_hanging
    ),
    "control_2_light_all": partial(
        _nearer_than_random, target=2, cloth="light", measure=_up_to_hanging
    ),
    "control_2_heavy_all": partial(
        _nearer_than_random, target=2, cloth="heavy", measure=_up_to_hanging
    ),
    "nearer_than_still_1": partial(_nearer_than_still, target=1),
    "nearer_than_still_2": partial(_nearer_than_still, target=2),
    "accurate_1": partial(_accurate, target=1),
    "accurate_2": partial(_accurate, target=2),
    "target_1_harder": _harder,
    "harder_with_light": _harder_with_light,
    "heavy_is_easier": _heavy_is_easier,
    "reproducible": partial(
        _reproducible, measure=partial(_median_best, column="control")
    ),
    "reproducible_nearness": partial(_reproducible, measure=_nearness_of_runs),
    "found_in_control": _found_in_control,
    "improves_by_p": _improves_by_p,
    "right_p_nearer": _right_p_nearer,
    "chamfer_target_2": lambda evidence: _chamfer(evidence, 2) - 0.811,
    "chamfer_target_1": lambda evidence: _chamfer(evidence, 1) - 0.811,
    "ellipse": _ellipse,
    "foam_corners": _foam_corners,
    "foam_not_a_line": lambda evidence: 0.85 - _share_of_pc1(evidence, "muscle"),
    "foam_straight_line": _foam_straight_line,
    "hard_2_between": _hard_2_between,
    "hard_1_drifts": _hard_1_drifts,
    "hard_3_found": _hard_3_found,
    "stiff_then_soft": _stiff_then_soft,
    "stiffness_speed": _stiffness_speed,
    "shoulder_later": partial(_slower_with_soft, column="delay"),
    "soft_slower": partial(_slower_with_soft, column="lowering"),
    "foam_random_all": partial(_beyond, measure=_up_to_hanging, other=RANDOM),
    "foam_random_as_published_all": partial(
        _beyond, measure=_up_to_hanging, other=RANDOM, condition=WARM
    ),
    "foam_random_worst": _random_worst,
    "foam_wrong_p_rate": partial(_beyond, measure=_rate, other=WRONG_FOAM),
    "foam_no_stiffness_rate": partial(_beyond, measure=_rate, other=FIXED),
    "foam_random": partial(_beyond, measure=nearness, other=RANDOM),
    "foam_random_as_published": partial(
        _beyond, measure=nearness, other=RANDOM, condition=WARM
    ),
    "foam_wrong_p": partial(_beyond, measure=nearness, other=WRONG_FOAM),
    "foam_no_stiffness": partial(_beyond, measure=nearness, other=FIXED),
    "foam_wrong_p_minimum": partial(_least, other=WRONG_FOAM),
    "foam_no_stiffness_minimum": partial(_least, other=FIXED),
    "foam_farthest": partial(_beyond, measure=np.max, other=RANDOM),
    "hard_1_harder": _hard_1_harder,
    "foam_start": _foam_start,
    "table_set": _table_set,
}


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
    claim = choose("claim", name, all_claims())
    return _judge(claim, Evidence(amount, data))


def _judge(claim: Claim, evidence: Evidence) -> Judged:
    found = _NUMBERS[claim.name](evidence)
    if not claim.varies:
        mean = low = high = float(found.item())
    elif claim.chance is None:
        mean, low, high = crossed_interval(found.to_numpy(dtype=float)[:, None])
    else:
        mean, low, high = (each - claim.chance for each in rate_interval(found))
    return Judged(claim, mean, low, high, len(found), evidence.of)


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
    for claim in all_claims().values():
        with contextlib.suppress(NotMeasured):
            found.append(_judge(claim, evidence))
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
    return f"{found.verdict}: {found.figure}, {found.count} {found.of}s"


# Conditions of a notebook


def lower_end(values: np.ndarray) -> float:
    """Of the interval of numbers `[units]`, or of differences `[units, repeats]`."""
    return crossed_interval(np.reshape(values, (len(values), -1)))[1]


def upper_end(values: np.ndarray) -> float:
    """The other one."""
    return crossed_interval(np.reshape(values, (len(values), -1)))[2]


def farther_end(values: np.ndarray) -> float:
    """How far from zero the farther of both is."""
    return max(abs(lower_end(values)), abs(upper_end(values)))


def state(verdict: str, names: Sequence[str], amount: str = PAPER) -> None:
    """State that claims have the verdict that a page says they have.

    Args:
        verdict: "holds", "contradicted" or "equal".
        names: of the claims.
        amount: of recordings.
    """
    for name in names:
        values = numbers(name, amount).to_numpy(dtype=float)
        claim = f"{name}: {verdict}"
        if verdict == "holds":
            finding(claim, lower_end(values), above=0)
        elif verdict == "contradicted":
            finding(claim, upper_end(values), below=0)
        else:
            margin = all_claims()[name].margin
            finding(claim, farther_end(values), below=margin)
