"""The paper's two sections of experiments."""

ENDINGS = ("", "-paper")
OLD = ("perception", "self_organisation", "estimation", "control", "integrated", "stiffness")
NAMES = [name + end for name in OLD for end in ENDINGS]


def tables(name, record):
    """The runs, with the settings that are parameters of `run_one`."""
    base, end = name.removesuffix("-paper"), "-paper" if name.endswith("-paper") else ""
    settings = record["settings"]

    def same(*keys):
        return {key: settings[key] for key in keys}

    if base == "perception":
        overlap = same("weights", "trials") | {key: record[key] for key in ("iou", "iou_visible", "iou_deviation")}
        found = {"reconstruction": [overlap], "chamfer": [same("weights", "steps") | run for run in record["chamfer"]]}
    elif base == "self_organisation":
        found = {base: [same("weights") | run for run in record["runs"]]}
    elif base == "estimation":
        assert [run["seed"] for run in record["runs"]] == [6000 + k for k in _seeds(settings)]
        repeats = [k % settings["repeats"] for k in range(len(record["runs"]))]
        dropped = [{key: value for key, value in run.items() if key != "seed"} for run in record["runs"]]
        found = {
            base: [
                same("weights", "steps", "first_seed") | run | {"repeat": k}
                for run, k in zip(dropped, repeats, strict=True)
            ]
        }
    elif base == "control":
        found = {base: [same("weights", "steps") | run for run in record["runs"]]}
    elif base == "integrated":
        keys = ("weights", "target", "held", "believed", "steps")
        found = {"joint_estimation_control": [same(*keys) | run for run in record["runs"]]}
    else:
        return stiffness(record, settings, end)
    return {table + end: rows for table, rows in found.items()}


def _seeds(settings):
    """Seeds of the estimation, in the order of its cases."""
    order = [*_CLOTHS, "between-light", "between-heavy"]
    return [
        100 * model + 20 * repeat + order.index(cloth)
        for cloth in settings["cloths"]
        for model in settings["models"]
        for repeat in range(settings["repeats"])
    ]


_CLOTHS = [f"damp{c}-mass{m}" for c in ("0.03", "0.05", "0.07") for m in ("0.05", "0.10", "0.15")]


def stiffness(record, settings, end):
    """Five tables of one record."""
    weights = {"weights": settings["weights"]}
    number = len(record["held_out"]) // len(settings["models"])
    control = weights | {key: settings[key] for key in ("fixed_tension", "speed_steps")}
    control["steps"] = settings["control_steps"]
    return {
        "stiffness_ellipse": record["ellipses"],
        f"foam_recorded{end}": [weights | run | {"number": k % number} for k, run in enumerate(record["held_out"])],
        f"foam_estimation{end}": [
            weights | run | {"steps": settings["estimation_steps"]} for run in record["estimation"]
        ],
        f"foam_control{end}": [
            control | run | {"peak_hand_speed": list(run["peak_hand_speed"].values())} for run in record["control"]
        ],
    }


_BETWEEN = "cloths between the trained ones: largest error of {} read off p"
_CONTROL = "control, {}: best distance a period, median, over Random's"
_CASES = [f"{target}, {cloth}" for target in ("target-1", "target-2") for cloth in (_CLOTHS[0], _CLOTHS[-1])]
_GAIN = "{}: gain in peak hand speed by optimised stiffness over 10 N"
FIGURES = {
    "reconstruction": "autoencoder: mean IoU on evaluation trials",
    "chamfer": "correlation of z distance and log chamfer distance, Target-2",
    "estimation/accuracy": "estimation from p = 0, 40 s: nearest trained p is the right one",
    "joint_estimation_control": "integrated: distance to the right p after 50 s, over the start's, mean of five",
    "stiffness_ellipse": "stiffness ellipse: area at 10 N over that at 70 N",
    "foam_recorded": "foams, p estimated from held-out trials: nearest trained p is the right one",
    "foam_estimation": "hard-2, never trained on, lies between hard-1 and hard-3: trainings of five",
    **{f"self_organisation/{k}": f"p explains log {k}, leave one cloth out: R²" for k in ("C_damp", "C_mass")},
    **{f"estimation/{name}": _BETWEEN.format(name) for name in ("C_damp", "C_mass")},
    **{f"control/{case.replace(', ', '/')}": _CONTROL.format(case) for case in _CASES},
}
for _foam in ("hard-1", "soft-1"):
    FIGURES |= {
        f"foam_control/{_foam}/distance": f"{_foam}: best distance a period, median, Correct over Random",
        f"foam_control/{_foam}/rate": f"{_foam}, Correct: steps nearer than 0.5",
        f"foam_control/{_foam}/speed": _GAIN.format(_foam),
    }
