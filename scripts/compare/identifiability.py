"""Identifiability, system identification, calibrated regions and the moved camera."""

from clothlab.analysis import nearest_material
from clothlab.experiments import EXPERIMENTS, calibration_test, camera_recalibration, sysid_benchmark
from clothlab.experiments._runs import trained
from clothlab.experiments.iterative_control import ITERATIVE, PAPERS

NAMES = ["knowledge", "race", "cameras", "uncertainty"]
CONTROLLERS = {"gradient": PAPERS, "practice": ITERATIVE}
_OVER = "p after 40 s: error of C_damp / C_mass over the Cramér-Rao bound"
_CAMERA = "camera off by 3° and 5 cm"
FIGURES = {
    "sysid_benchmark/over-bound/z + joints": f"{_OVER} of an observer who knows the simulator, median",
    "sysid_benchmark/over-bound/z as predicted": f"{_OVER} … who predicts as the network, median",
    **{
        f"sysid_benchmark/{method}": f"{method}: median error of C_damp / C_mass after 40 s"
        for method in ("p", "sysid", "network")
    },
    "calibration_test/nearest": "p by Gauss-Newton, 40 s: nearest trained p is the right one",
    "calibration_test/coverage": "90 % regions hold the right p after 40 s",
    "calibration_test/beyond": "cloths, beyond: called unfamiliar by the error of prediction",
    "camera_control/nearest": f"{_CAMERA}, registered: nearest-material rate over the unmoved camera's",
    **{
        f"camera_control/{controller}": (
            f"{_CAMERA}, registered: {method}, target-2, last ten periods over the unmoved camera's"
        )
        for method, controller in CONTROLLERS.items()
    },
}


def tables(name, record):
    """The rows that are kept, in the order of the cases."""
    found = {"knowledge": knowledge, "race": race, "cameras": cameras, "uncertainty": uncertainty}[name](record)
    return {table: _ordered(table, rows) for table, rows in found.items()}


def _ordered(table, rows):
    cases = EXPERIMENTS[table].cases()
    place = {tuple(sorted(case.items())): number for number, case in enumerate(cases)}
    return sorted(rows, key=lambda row: place[tuple(sorted((key, row[key]) for key in cases[0]))])


def knowledge(record):
    """The cloths as they are, with the usual step and disturbance; without torques and masks."""
    settings, rows = record["settings"], []
    usual = {key: settings[key] for key in ("step", "disturbance")} | {"variant": "as it is"}
    for run in record["runs"]:
        case, known = run["case"], run["known"]
        if usual.items() <= case.items():
            rows.append({key: case[key] for key in ("cloth", "motion", "seed")})
            rows[-1] |= {"steps": settings["steps"], "time": settings["times"], "noise": known["noise"]["z"]}
            rows[-1] |= {key: known["information"][key] for key in ("z", "z as predicted", "joints")}
    return {"identifiability": rows}


def race(record):
    """Answers of all methods."""
    rows = []
    for run in record["runs"]:
        assert run["seed"] == 31_000 + 100 * run["model"] + [*sysid_benchmark._ALL].index(run["cloth"])
        rows.append({key: run[key] for key in ("method", "cloth", "model", "error")})
        rows[-1]["time"] = [steps / 5 for steps in record["settings"]["steps"]]
    return {"sysid_benchmark": rows}


def cameras(record):
    """All poses; estimation and control with the unmoved camera and with those shifted and turned."""
    kept = [camera_recalibration.UNMOVED, camera_recalibration.BOTH]

    def moved(run, *columns):
        row = {"direction": run["place"], "size": run["size"]} | {key: run[key] for key in columns}
        return row | ({"recalibrated": run["mended"]} if "mended" in run else {})

    return {
        "camera_pose": [moved(run, "residual", "shift_error", "turn_error") for run in record["registrations"]],
        "camera_estimation": [
            moved(run, "model", "cloth", "nearest") for run in record["estimates"] if run["place"] in kept
        ],
        "camera_control": [
            moved(run, "model", "cloth", "best") | {"controller": CONTROLLERS[run["method"]]}
            for run in record["control"]
            if run["place"] in kept
        ],
    }


def uncertainty(record):
    """Calibrations; runs with the last of their estimates."""
    columns, rows = ("cloth", "model", "estimate", "bare", "covariance"), []
    for run in record["runs"]:
        number = run["seed"] - 56_000 - 200 * run["model"] - [*calibration_test._ALL].index(run["cloth"])
        assert number % 30 == 0
        biases = trained(f"torque-{run['model']}").biases
        last = {"nearest": nearest_material(run["newton"][-1], biases)}
        last |= {"out_of_distribution": run["unfamiliar"], "outside_hull": run["outside"]}
        rows.append({key: run[key] for key in columns} | {"repeat": number // 30} | last)
    calibrations = [{"model": k} | each for k, each in zip(range(5), record["calibrations"], strict=True)]
    return {"calibration": calibrations, "calibration_test": rows}
