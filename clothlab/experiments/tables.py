"""The results tables: paper beside here, each row computed from the stored records."""

from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from clothlab.analysis import difference_interval, median_best, rate_interval
from clothlab.experiments import (
    cameras,
    control,
    estimation,
    feeling,
    integrated,
    knowledge,
    limits,
    perception,
    practice,
    race,
    self_organisation,
    stiffness,
    table_setting,
    uncertainty,
)
from clothlab.experiments._record import PAPER
from clothlab.experiments.practice import GRADIENT, PRACTICE
from clothlab.experiments.stiffness import CONDITIONS, CORRECT, FIXED, RANDOM, WARM
from clothlab.simulation.env import CONTROL_PERIOD


@dataclass(frozen=True)
class Row:
    """A row of a results table.

    Attributes:
        what: what was measured.
        paper: the paper's figure, or what it says.
        here: ours, with its spread.
        on_papers: ours from the paper's amount of recordings, as `here`; empty where that was not measured.
        aim: the bound that this project aims at.
        held: whether ours is within it; None where there is none.
    """

    what: str
    paper: str
    here: str
    aim: str
    held: bool | None
    on_papers: str = ""


def row(
    what: str,
    paper: str,
    value: float,
    *,
    at_least: float | None = None,
    at_most: float | None = None,
    unit: str = "",
    spread: str = "",
) -> Row:
    """A row from a figure and its bounds."""
    if at_least is not None and at_most is not None:
        aim = f"{at_least:.3g} to {at_most:.3g}{unit}"
    elif at_least is not None:
        aim = f"≥ {at_least:.2g}{unit}"
    else:
        aim = "–" if at_most is None else f"≤ {at_most:.2g}{unit}"
    held = (at_least is None or value >= at_least) and (at_most is None or value <= at_most)
    return Row(what, paper, f"{value:.2f}{unit}{spread}", aim, None if aim == "–" else bool(held))


def simulation(records: dict[str, Any]) -> list[Row]:
    """Rows of the paper's section "Simulation Experiment", from the records by their experiments' names."""
    return [
        *_perception(records["perception"]),
        *_self_organisation(records["self_organisation"]),
        *_estimation(records["estimation"]),
        *_control(records["control"]),
        *_integrated(records["integrated"]),
    ]


def _perception(record: perception.Record) -> list[Row]:
    (target_2,) = (each for each in record.chamfer if each.target == "target-2")
    what = "correlation of z distance and log chamfer distance, Target-2"
    return [
        row("autoencoder: mean IoU on evaluation trials", "–", record.iou, at_least=0.85),
        row(what, "0.811", target_2.correlation, at_least=0.85),
    ]


def _self_organisation(record: self_organisation.Record) -> list[Row]:
    r2, ratio = np.array([run.r2 for run in record.runs]), np.array([run.ratio_r2 for run in record.runs])
    rows = [
        row(
            f"p explains log {name}, leave one cloth out: R²",
            "–",
            values.mean(),
            at_least=0.9,
            spread=f" ± {values.std():.2f}",
        )
        for name, values in zip(("C_damp", "C_mass"), r2.T, strict=True)
    ]
    straight = np.array([run.linear_r2 for run in record.runs])
    rows += [
        row(f"… and by a straight map, log {name}", "–", values.mean(), spread=f" ± {values.std():.2f}")
        for name, values in zip(("C_damp", "C_mass"), straight.T, strict=True)
    ]
    what = "… and log (C_damp / C_mass), the speed of falling"
    return [*rows, row(what, "–", ratio.mean(), spread=f" ± {ratio.std():.2f}")]


def _estimation(record: estimation.Record) -> list[Row]:
    right = float(np.mean([run.nearest == run.cloth for run in record.trained]))
    distance = float(np.median([run.distance for run in record.trained]))
    what = f"estimation from p = 0, {record.settings.steps * CONTROL_PERIOD:g} s: nearest trained p is the right one"
    rows = [
        row(what, "–", 100 * right, at_least=95, unit=" %"),
        row("… final distance to the right p, in spreads, median", "–", distance, at_most=0.35),
    ]
    errors = 100 * np.abs([run.error for run in record.between])
    for name, values in zip(("C_damp", "C_mass"), errors.T, strict=True):
        what = f"cloths between the trained ones: largest error of {name} read off p"
        rows.append(row(what, "–", values.max(), at_most=25, unit=" %", spread=f" (mean {values.mean():.0f} %)"))
    return rows


def _control(record: control.Record) -> list[Row]:
    rows = []
    for (target, cloth), runs in record.cases().items():
        ours, chance = (median_best(getattr(run, who) for run in runs) for who in ("control", "random"))
        deviation = np.std([np.median(run.best("control")) / chance for run in runs])
        others = f"still {runs[0].still:.2f}, empty image {runs[0].empty:.2f}"
        rows.append(
            row(
                f"control, {target}, {cloth}: best distance a period, median, over Random's",
                "Control better",
                ours / chance,
                at_most=0.4,
                spread=f" ± {deviation:.2f} ({ours:.2f} / {chance:.2f}; {others})",
            )
        )
    return rows


def _integrated(record: integrated.Record) -> list[Row]:
    ratios = np.array([run.ratio for run in record.runs])
    what = f"integrated: distance to the right p after 50 s, over the start's, mean of {_number(len(ratios))}"
    return [row(what, "approaches", ratios.mean(), at_most=1 / 3, spread=f" ± {ratios.std():.2f}")]


def _number(count: int) -> str:
    """A number of trainings; the usual one, which is the paper's, in a word."""
    return "five" if count == 5 else str(count)


def muscle_arm(records: dict[str, Any]) -> list[Row]:
    """Rows of the paper's section "Actual Robot Experiment", from the records by their experiments' names."""
    record: stiffness.Record = records["stiffness"]
    low, *_, high = tensions = record.settings.tensions
    falls = sum(record.area("nonlinear", a) > record.area("nonlinear", b) for a, b in pairwise(tensions))
    right = 100 * float(np.mean([each.nearest == each.cloth for each in record.held_out]))
    between = sum(0 < each.place < 1 for each in record.estimation if each.cloth == "hard-2")
    number, what = len(record.settings.models), "hard-2, never trained on, lies between hard-1 and hard-3"
    gain, linear = (
        record.area("nonlinear", low) / record.area("nonlinear", high),
        record.area("linear", 30) / record.area("linear", high),
    )
    rows = [
        row("stiffness ellipse: area at 10 N over that at 70 N", "changes greatly", gain, at_least=5),
        row("… how often it falls from 10 to 30, 50 and 70 N", "–", falls, at_least=3),
        row("… with linear springs, 30 N over 70 N: the control", "–", linear, at_least=0.98, at_most=1.02),
        row(
            "foams, p estimated from held-out trials: nearest trained p is the right one",
            "–",
            right,
            at_least=80,
            unit=" %",
        ),
        row(f"{what}: trainings of {_number(number)}", "yes", between, at_least=4 / 5 * number),
    ]
    return [*rows, *(each for cloth in record.settings.cloths for each in _foam(record, cloth))]


def _foam(record: stiffness.Record, cloth: str) -> list[Row]:
    runs = {name: record.case(name, cloth) for name in CONDITIONS}
    ours, chance = (median_best(run.distance for run in runs[name]) for name in (CORRECT, RANDOM))
    first = runs[CORRECT][0]
    others = f"still {first.distance[0]:.2f}, empty image {first.empty:.2f}"
    rows = [
        row(
            f"{cloth}: best distance a period, median, Correct over Random",
            "Correct better",
            ours / chance,
            at_most=0.4,
            spread=f" ({ours:.2f} / {chance:.2f}; {others})",
        )
    ]
    for name, each_of in runs.items():
        rate = 100 * np.array([run.rate for run in each_of])
        paper = {CORRECT: "highest", RANDOM: "lowest", WARM: "–"}.get(name, "lower than Correct")
        what = f"{cloth}, {name}: steps nearer than {record.settings.threshold}"
        rows.append(row(what, paper, rate.mean(), unit=" %", spread=f" ± {rate.std():.2f}"))
    free, fixed = (np.array([[*run.peak_hand_speed.values()] for run in runs[name]]) for name in (CORRECT, FIXED))
    gain = 100 * (free.mean(axis=0) / fixed.mean(axis=0) - 1)
    speeds = " / ".join(f"{speed[:, 0].mean():.2f} ± {speed[:, 0].std():.2f}" for speed in (free, fixed))
    other = f"{gain.min():.0f} to {gain.max():.0f} % with other motors and friction"
    what = f"{cloth}: gain in peak hand speed by optimised stiffness over {record.settings.fixed_tension:.0f} N"
    return [*rows, row(what, "+12 %", gain[0], unit=" %", spread=f" ({speeds} m/s; {other})")]


def practised(records: dict[str, Any]) -> list[Row]:
    """Rows of notebook 10, control that learns from its outcomes; of slow experiments, those that have a record."""
    rows = []
    if "practice" in records:
        rows += _practice(records["practice"], records.get("limits"))
    if "any_target" in records:
        held_out = np.array([run.ratio for run in records["any_target"].of("held-out")])
        what = f"practice, {len(held_out)} held-out targets: last ten periods over Random's"
        rows += [
            row(f"{what}, median", "–", float(np.median(held_out)), at_most=0.2),
            row(f"{what}, 90th percentile", "–", float(np.quantile(held_out, 0.9)), at_most=0.45),
        ]
        overlap = np.array([run.overlap for run in records["any_target"].of("drawn")])
        what = f"practice, {len(overlap)} drawn shapes: IoU of the best frame of a period, median of the last ten"
        rows.append(row(what, "–", float(np.median(overlap)), spread=f" ({overlap.min():.2f} to {overlap.max():.2f})"))
    return rows


def _practice(record: practice.Record, limits: limits.Record | None) -> list[Row]:
    def over_random(cases: list[str], last: bool = True) -> np.ndarray:
        return np.array([record.over_random(PRACTICE, case, last=last) for case in cases])  # [cases, models]

    rows, most = [], {"target-1": 0.12, "target-2": 0.1, "muscle": 0.12}
    for target, bound in most.items():
        cases = [name for name in record.settings.cases if practice.CASES[name].target == target]
        last = over_random(cases)
        hands = "both foams" if target == "muscle" else "both cloths"
        what = f"practice, {target}, {hands}: best distance a period over Random's"
        rows += [
            row(f"{what}, last ten periods, median", "–", float(np.median(last)), at_most=bound),
            row(f"{what}, … of the worst training", "–", float(np.median(last, axis=0).max()), at_most=0.3),
            row(f"{what}, all periods", "–", float(np.median(over_random(cases, last=False))), at_most=0.4),
        ]
    for method in record.settings.methods:
        others = [record.over_random(method, case) for case in record.settings.cases if record.select(method, case)]
        rows.append(row(f"{method}, all cases: the same, last ten periods, median", "–", float(np.median(others))))
    rows += _pairs(record)
    for arm, aim in {"torque": 1 / 3, "muscle": None}.items():
        cases = record.cases(arm)
        ratios = [run.bias_ratio for run in record.runs if run.case in cases and run.bias_ratio is not None]
        if ratios:
            what = f"practice from a wrong p, {arm} arm: distance to the right p in the end, over the start's"
            mean, spread = float(np.mean(ratios)), f" ± {np.std(ratios):.2f}"
            rows.append(row(what, "approaches", mean, at_most=aim, spread=spread))
    if limits is not None:
        possible = {
            name: limits.possible(case.target, case.cloth)
            for name, case in practice.CASES.items()
            if name in record.settings.cases
        }
        over = np.median([record.last(PRACTICE, name) / value for name, value in possible.items()])
        what = "practice: last ten periods over what search on the true simulator finds, median"
        rows += [row(what, "–", float(over), at_most=1.5), *_periods(record, possible)]
    return rows


PAIRS = {  # what the paper says of them
    (GRADIENT, practice.RANDOM): "Correct better",
    (GRADIENT, "gradient, wrong p"): "Correct better",
    (GRADIENT, "gradient, without stiffness"): "Correct better",
    (GRADIENT, "gradient, model without p"): "–",
    (GRADIENT, "gradient, known C_damp and C_mass"): "–",
    (PRACTICE, GRADIENT): "–",
    (PRACTICE, "practice, wrong p"): "–",
    (PRACTICE, "practice, p = 0"): "–",
    (PRACTICE, "practice, model without p"): "–",
    (PRACTICE, "practice, estimated p"): "–",
    (PRACTICE, "practice, without stiffness"): "–",
}


def _pairs(record: practice.Record) -> list[Row]:
    """Differences between methods whose runs start alike, with the 95 % interval of their means."""
    rows = []
    for (first, second), paper in PAIRS.items():
        for arm in practice.METHODS[second].arms:
            cases = record.cases(arm)
            if not cases or not all(record.select(name, case) for name in (first, second) for case in cases):
                continue
            what = f"{first} minus {second}, {arm} arm: last ten periods over Random's (95 %)"
            mean, low, high = difference_interval(record.differences(first, second, cases))
            rows.append(row(what, paper, mean, spread=f" ({low:.2f} to {high:.2f})"))
            if practice.METHODS[second].stiffness:
                what = f"{first} over {second}, {arm} arm: gain in peak hand speed (95 %)"
                mean, low, high = (100 * each for each in difference_interval(record.speed_gains(first, second, cases)))
                rows.append(row(what, "+12 %", mean, unit=" %", spread=f" ({low:.0f} to {high:.0f} %)"))
    return rows


def _periods(record: practice.Record, possible: dict[str, float]) -> list[Row]:
    """What p is worth to who practises: how soon the cloth is about as near as it can be."""
    rows = []
    whose = ("", ", wrong p", ", p = 0", ", estimated p", ", model without p")
    for method in (PRACTICE + each for each in whose):
        if record.select(method, next(iter(possible))):
            found = [record.periods_until(method, case, 2 * value) for case, value in possible.items()]
            counts = np.concatenate(found)
            never = 100 * float(np.mean(counts > record.periods))
            what = f"{method}: periods until within twice the possible, median"
            rows.append(row(what, "–", float(np.median(counts)), spread=f" (never: {never:.0f} %)"))
    return rows


def known(records: dict[str, Any]) -> list[Row]:
    """Rows of notebook 12, what can be known; of slow experiments, those that have a record."""
    rows = []
    if "feeling" in records:
        rows += _feeling(records["feeling"])
    if "knowledge" in records and "race" in records:
        rows += _bounds(records["knowledge"], records["race"])
    if "uncertainty" in records:
        rows += _uncertainty(records["uncertainty"])
    if "cameras" in records:
        rows += _cameras(records["cameras"])
    return rows


def _feeling(record: feeling.Record) -> list[Row]:
    rows, end = [], record.settings.steps * CONTROL_PERIOD
    for weights, name, least, most in (
        (feeling.FEELING, "with torques", 0.95, 10),
        (feeling.TORQUE, "without torques", None, None),
    ):
        r2 = record.r2(weights)
        for k, what in enumerate(("log C_damp", "log C_mass")):
            spread = f" ± {r2[:, k].std():.2f}"
            what = f"{name}: leave-one-cloth-out R² of {what}, mean of {len(r2)} trainings"
            rows.append(row(what, "–", r2[:, k].mean(), at_least=least, spread=spread))
        for what, errors in zip(("C_damp", "C_mass"), 100 * record.errors(weights).T, strict=True):
            what = f"{name}: cloths between, {what} read off p after {end:g} s, 90th percentile of errors"
            spread = f" (median {np.median(errors):.1f} %)"
            rows.append(row(what, "–", float(np.quantile(errors, 0.9)), at_most=most, unit=" %", spread=spread))
        rows.append(
            row(f"{name}: nearest trained p is the right one", "–", 100 * record.nearest_rate(weights), unit=" %")
        )
    return rows


def _bounds(record: knowledge.Record, raced: race.Record) -> list[Row]:
    rows, ratio = [], "C_damp / C_mass"
    observers = {
        "z + joints": "of an observer who knows the simulator",
        knowledge.PREDICTED: "… who predicts as the network",
    }
    for sensors, who in observers.items():
        over = raced.over_bound("p", record, sensors, ratio)
        what = f"p after {raced.times[-1]:g} s: error of {ratio} over the Cramér-Rao bound {who}, median"
        rows.append(row(what, "–", float(np.median(over)), at_most=3))
    for method in raced.settings.methods:
        at_five, at_forty = (100 * np.median(raced.errors(method, ratio, "trained")[:, k]) for k in (0, -1))
        what = f"{method}: median error of {ratio} after {raced.times[-1]:g} s"
        rows.append(row(what, "–", at_forty, unit=" %", spread=f" ({at_five:.1f} % after {raced.times[0]:g} s)"))
    return rows


def _uncertainty(record: uncertainty.Record) -> list[Row]:
    right, momentum = (100 * record.right(rule)[-1] for rule in ("newton", "momentum"))
    end = f"{record.settings.lengths[-1] * CONTROL_PERIOD:g} s"
    what = f"p by Gauss-Newton, {end}: nearest trained p is the right one"
    rows = [row(what, "–", right, at_least=97, unit=" %")]
    rows.append(row("… by momentum, the same runs", "–", momentum, unit=" %"))
    for name, rule in (("Gauss-Newton", "newton"), ("momentum", "momentum")):
        seconds = record.seconds_to(rule)
        if seconds is not None:
            rows.append(
                row(f"p by {name}: time from which it is the right one in 90 % of runs", "–", seconds, unit=" s")
            )
    held, bare = 100 * record.coverage()[-1], 100 * record.coverage(calibrated=False)[-1]
    what = f"90 % regions hold the right p after {end}"
    rows.append(row(what, "–", held, at_least=85, at_most=95, unit=" %", spread=f" ({bare:.0f} % by curvature alone)"))
    for kind in uncertainty.KINDS:
        told = 100 * np.mean([*record.alarms(kind).values()], axis=0)[-1]
        also = 100 * np.mean([*record.alarms(kind, or_outside=True).values()], axis=0)[-1]
        what = f"cloths, {kind}: called unfamiliar by the error of prediction"
        rows.append(row(what, "–", told, unit=" %", spread=f" ({also:.0f} % by that or by the place of p)"))
    return rows


def _cameras(record: cameras.Record) -> list[Row]:
    rows, settings = [], record.settings
    where = f"camera off by {settings.both_turn:g}° and {100 * settings.both_shift:g} cm"
    for mended, how in ((False, "as it is"), (True, "registered")):
        over = record.over_unmoved(cameras.BOTH, mended)
        what = f"{where}, {how}: nearest-material rate over the unmoved camera's"
        rows.append(row(what, "–", over["nearest"], at_least=0.9 if mended else None))
        for method in settings.methods:
            what = f"{where}, {how}: {method}, {settings.target}, last ten periods over the unmoved camera's"
            distance = record.last(method, cameras.BOTH, mended)
            rows.append(row(what, "–", over[method], at_most=1.1 if mended else None, spread=f" ({distance:.2f} s.d.)"))
    return rows


def table_set(records: dict[str, Any]) -> list[Row]:
    """Rows of notebook 13, setting the table, if it has a record."""
    return _table_setting(records["table_setting"]) if "table_setting" in records else []


def _table_setting(record: table_setting.Record) -> list[Row]:
    dynamic, slow = table_setting.DYNAMIC, table_setting.SLOW_HAND
    phases = {
        "cloth grasped": ("grasped", "", "in one run", 96),
        "cloth spread by a throw": ("spread", "", "in one run", 80),
        "basket placed, given a spread cloth": ("placed", "spread", "in one run", 90),
        "the whole run": ("success", "", "in one run", 70),
    }
    rows = []
    for what, (held, given, paper, least) in phases.items():
        runs = [run for run in record.select(dynamic) if not given or getattr(run, given)]
        rows.append(_rate(f"{what}, of {len(runs)}", paper, [getattr(run, held) for run in runs], least))
    for method in record.settings.methods:
        if method != dynamic:
            runs = record.select(method)
            rows.append(_rate(f"cloth spread, {method}, of {len(runs)}", "–", [run.spread for run in runs]))
    mean, low, high = (100 * each for each in record.difference(dynamic, slow))
    what = "cloth spread: by a throw minus slowly (95 %)"
    rows.append(row(what, "–", mean, unit=" %", spread=f" ({low:.0f} to {high:.0f} %)"))
    right = [guess.nearest == guess.foam for guess in record.guesses]
    what = f"p after the first swing: nearest of {len(record.settings.foams)} foams is the right one, of {len(right)}"
    return [*rows, _rate(what, "–", right, 75)]


def _rate(what: str, paper: str, held: list[bool], at_least: float | None = None) -> Row:
    rate, low, high = (100 * each for each in rate_interval(held))
    return row(what, paper, rate, at_least=at_least, unit=" %", spread=f" ({low:.0f} to {high:.0f} %)")


TABLES = {"simulation": simulation, "muscle-arm": muscle_arm, "practice": practised, "known": known, "table": table_set}


def table(name: str, records: dict[str, Any]) -> list[Row]:
    """One of `TABLES`, with what the paper's amount of recordings gives beside it."""
    papers = {each.removesuffix(PAPER): record for each, record in records.items() if each.endswith(PAPER)}
    beside = {each.what: each.here for each in TABLES[name](papers)} if papers else {}
    return [replace(each, on_papers=beside.get(each.what, "")) for each in TABLES[name](records)]


def markdown(rows: list[Row]) -> str:
    """A table for the README."""
    marks = {True: "✓", False: "short of it", None: ""}
    lines = ["| | paper | here, from as many recordings | here | aim | |", "| --- | --- | --- | --- | --- | --- |"]
    lines += [
        f"| {each.what} | {each.paper} | {each.on_papers} | {each.here} | {each.aim} | {marks[each.held]} |"
        for each in rows
    ]
    return "\n".join(lines)


def as_json(records: dict[str, Any]) -> dict[str, list[dict]]:
    """All tables as JSON has them."""
    return {name: [asdict(each) for each in table(name, records)] for name in TABLES}


def in_readme(readme: str, records: dict[str, Any]) -> str:
    """The README with each table between its marks, `<!-- NAME -->` and `<!-- /NAME -->`.

    Raises:
        ValueError: a table without its marks.
    """
    for name in TABLES:
        before, mark, rest = readme.partition(f"<!-- {name} -->")
        _, end, after = rest.partition(f"<!-- /{name} -->")
        if not mark or not end:
            raise ValueError(f"the README has no place for the table {name!r}: <!-- {name} --> and <!-- /{name} -->")
        readme = f"{before}{mark}\n{markdown(table(name, records))}\n{end}{after}"
    return readme
