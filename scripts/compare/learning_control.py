"""Studies of learning control."""

from clothlab.experiments import iterative_control as ic
from clothlab.experiments import oracle, target_generalization

NAMES = ["practice", "limits", "any_target", "experience"]
P = {"right p": "right", "p = 0": "zero", "wrong p": "wrong", "model without p": "none", "estimated p": "estimated"}
P |= {"known C_damp and C_mass": "known"}
TASKS = dict(
    zip(
        ("target-1, light", "target-1, heavy", "target-2, light", "target-2, heavy", "foam hard-1", "foam soft-1"),
        ic.TASKS,
        strict=True,
    )
)
DROPPED = {"gradient, five models", "gradient, retrained on its own run", "cross-entropy", "changes"}


def method(name):
    """Controller, p, recordings and tension of a method of old."""
    if name == "replay of the best recorded stretch":
        return ic.REPLAY, "right", "all", None
    if name == "gradient, recorded starts":
        return ic.STARTS, "right", "all", None
    first, _, rest = name.partition(", ")
    controller = {"random": ic.RANDOM, "gradient": ic.PAPERS, "practice": ic.ITERATIVE}[first]
    recordings = "paper" if rest == "paper's recordings" else "all"
    return controller, P.get(rest, "right"), recordings, 10.0 if rest == "without stiffness" else None


def practice(record):
    """Runs in the order of the cases."""
    keys, rows = ("controller", "p", "recordings", "f_const", "arm", "target", "cloth", "model", "repeat"), {}
    for run in record["runs"]:
        if run["method"] in DROPPED:
            continue
        repeat = run["seed"] - 20_000 - 100 * run["model"]
        case = (*method(run["method"]), *TASKS[run["case"]], run["model"], repeat)
        found = {key: run[key] for key in ("seed", "still", "best", "hand_speed", "bias_ratio")}
        rows[case] = dict(zip(keys, case, strict=True)) | {"steps": 248} | found | {"predicted": run["promises"]}
    order = [tuple(case[key] for key in keys) for case in ic._cases()]
    assert set(order) == set(rows)
    return {"iterative_control": [rows[case] for case in order]}


def limits(record):
    """Searches in the order of the cases, and speeds by seed."""
    keys = ("arm", "target", "cloth", "f_const", "remembers", "seed")
    rows = {tuple(run["case"][key] for key in keys): run for run in record["runs"]}
    order = [tuple(case[key] for key in keys) for case in oracle._cases()]
    assert set(order) == set(rows)
    found = [
        dict(zip(keys, case, strict=True))
        | {"periods": record["settings"]["periods"], "search": None}
        | {key: rows[case][key] for key in ("distance", "trace")}
        for case in order
    ]
    speeds = {}
    for each in record["speeds"]:
        speeds.setdefault(each["seed"], []).append(each)
    fast = [
        {"seed": seed, "foam": record["settings"]["speed_foam"], "steps": record["settings"]["speed_steps"]}
        | {"search": None}
        | {key: [each[key] for each in rows] for key in ("peak", "trace", "commands")}
        for seed, rows in speeds.items()
    ]
    assert all([each["f_const"] for each in rows] == [10, 30, 70, None] for rows in speeds.values())
    return {"oracle": found, "peak_speed": fast}


def any_target(record):
    """One row a target."""
    names = {"still": "still", "practice": "best", "random": "random"}
    names |= {"practice_overlap": "iou", "random_overlap": "random_iou"}
    rows = [
        case | {"weights": "torque", "steps": 248, "cloth": run["cloth"]} | {names[key]: run[key] for key in names}
        for case, run in zip(target_generalization._cases(), record["runs"], strict=True)
    ]
    assert [row["target"] for row in rows] == [run["target"] for run in record["runs"]]
    return {"target_generalization": rows}


def experience(record):
    """Autoencoders, and models with their control in columns."""
    settings = record["settings"]
    seen = [
        {"arm": each["arm"], "amount": each["amount"], "updates": settings["autoencoder_updates"]}
        | {"moved_steps": settings["seen_steps"], "steps": each["steps"], "updates_done": each["updates"]}
        | {key: each[key] for key in ("iou", "correlation")}
        for each in record["seen"]
    ]
    runs = []
    for run in record["runs"]:
        by = {}
        for each in run["control"]:
            by.setdefault(each["method"], []).append(each)
        columns = {"random": [each["random"] for each in by["practice"]]}
        names = {"paper": "paper's control", "starts": "paper's control, recorded starts", "iterative": "practice"}
        for name, of in names.items():
            columns |= {f"{name}_{key}": [each[key] for each in by[of]] for key in ("best", "last")}
        damp, mass = run["r2"] or (None, None)
        runs.append(
            {"arm": run["arm"], "amount": run["amount"], "model": run["model"]}
            | {"autoencoder_updates": settings["autoencoder_updates"], "updates": settings["model_updates"]}
            | {"estimation_steps": settings["estimation_steps"], "control_steps": settings["control_steps"]}
            | {"updates_done": run["updates"], "prediction": run["prediction"], "r2_damp": damp, "r2_mass": mass}
            | {"r2_ratio": run["ratio_r2"], "nearest": run["nearest"], "distance": run["distance"]}
            | columns
        )
    return {"sample_complexity_autoencoder": seen, "sample_complexity": runs}


def tables(name, record):
    """Rows of the tables that a record became."""
    return globals()[name](record)


_OLD = "{}: last ten periods over Random's (95 %)"
FIGURES = {
    "iterative_control/speed": "gradient over gradient, without stiffness, muscle arm: gain in peak hand speed (95 %)",
    "iterative_control/oracle": "practice: last ten periods over what search on the true simulator finds, median",
    "iterative_control/periods": "practice: periods until within twice the possible, median",
    "iterative_control/replay": "replay of the best recorded stretch, all cases: the same, last ten periods, median",
    "iterative_control/paper's controller": "gradient, all cases: the same, last ten periods, median",
    "iterative_control/paper's controller, recorded starts": "gradient, recorded starts, all cases: the same, "
    "last ten periods, median",
    "iterative_control/iterative learning control": "practice, all cases: the same, last ten periods, median",
    "target_generalization/held-out/median": "practice, 20 held-out targets: last ten periods over Random's, median",
    "target_generalization/held-out/90": "practice, 20 held-out targets: last ten periods over Random's, "
    "90th percentile",
    "target_generalization/drawn/iou": "practice, 10 drawn shapes: IoU of the best frame of a period, median of the "
    "last ten",
}
for _target, _hands in {"target-1": "both cloths", "target-2": "both cloths", "muscle": "both foams"}.items():
    FIGURES[f"iterative_control/{_target}"] = (
        f"practice, {_target}, {_hands}: best distance a period over Random's, last ten periods, median"
    )
for _arm in ("torque", "muscle"):
    for _new, _before in {
        "paper's controller minus random commands": "gradient minus random",
        "paper's controller minus the same with a wrong p": "gradient minus gradient, wrong p",
        "paper's controller minus the same held at 10 N": "gradient minus gradient, without stiffness",
        "iterative learning control minus the same with a wrong p": "practice minus practice, wrong p",
    }.items():
        FIGURES[f"iterative_control/{_new}/{_arm}"] = _OLD.format(f"{_before}, {_arm} arm")
