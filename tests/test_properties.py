"""Every public function, given whatever: a right answer, or one sentence that says what is wrong.

The functions are found, not listed, so that a new one is tried too. What must be given to them and is no number, array,
name or path is in `EXAMPLES`; what is left out stands in `LEFT_OUT`, with the reason.

An error counts as a sentence if a `raise` of this package wrote it. An error from the depths of NumPy, or from a line
that meant to do something else, does not, whatever it says. Numbers in an answer are finite, unless `MAY_BE_INFINITE`.
"""

import ast
import dataclasses
import functools
import importlib
import inspect
import linecache
import os
import signal
import traceback
import types
import typing
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import ArrayLike

import clothlab
from clothlab import policies, trials
from clothlab._files import write_bytes
from clothlab.experiments import fisher, recalibration
from clothlab.learning import control, dpmpb, estimation, trained
from clothlab.learning.autoencoder import Autoencoder
from clothlab.simulation import arm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv, Observation, Scene
from clothlab.table_scene.depth import PointCloud, look
from clothlab.table_scene.scene import Basket, Furniture
from clothlab.table_scene.table_env import TableEnv

INPUTS = int(os.environ.get("CLOTHLAB_INPUTS", "1000"))  # in all; `make nightly` asks for ten times as many
PATIENCE = 2.0  # [s] for one answer; one that takes longer is none, and no error either
ERRORS = (ValueError, KeyError, TypeError, OSError, AttributeError, RuntimeError)

# Modules and functions that are not tried, and why.
LEFT_OUT = {
    "experiments": "hours of computing; their settings are tried in test_validation, their names go through `choose`",
    "checks": "given students' answers of all kinds in test_checks",
    "lab": "a session is driven with hostile values in test_soak, and panels in their own tests",
    "episode": "minutes of simulation, moved by a mover and not by a person",
    "throwing": "minutes of simulation; its settings are tried in test_validation",
    "reaching": "minutes of simulation; its settings are tried in test_validation",
    "recordings": "minutes of simulation of what the module itself lists, for `make data` and `make reproduce`",
    "tasks": "given graphs of tasks, which `in_order` refuses where they are wrong; tried in test_tasks",
    "cluster": "needs a scheduler and its workers; tried with real ones in test_cluster",
    "stiffness.learn_body_image": "trains a network",
    "dpmpb.train_dpmpb": "trains a network",
    "identification.train_regressor": "trains a network",
    "identification.fit_simulation": "minutes of simulation",
    "cloth.add_cloth": "called while a scene is built, with what `Scene` and `Cloth` have checked",
    "plots": "drawn from what other functions answered",
}
MAY_BE_INFINITE = {
    "information.cramer_rao": "what a sensor says nothing about has no bound",
    "information.log_det": "no information at all",
}

Hint = Any


def kind_of(hint: Hint) -> str | None:
    """What a person would put there: a word for it, or None for objects of this package."""
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    hints = set(typing.get_args(hint)) - {type(None)} if union else {hint}
    if hints >= set(typing.get_args(ArrayLike)):
        return "array"
    if Path in hints:
        return "path"
    for plain in (bool, int, float, str):
        if plain in hints:
            return plain.__name__
    (hint,) = hints if len(hints) == 1 else (None,)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if (
        origin in (dict, Mapping)
        and hint != Observation
        and arguments
        and (arguments[1] is np.ndarray or kind_of(arguments[1]) == "array")
    ):
        return "arrays by name"
    if origin in (Iterable, Sequence, list) and arguments and kind_of(arguments[0]) == "array":
        return "array"
    return None


@functools.cache
def square() -> np.ndarray:
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    return mask


@functools.cache
def env() -> ClothEnv:
    return ClothEnv("torque", "damp0.05-mass0.10", scene=Scene(picture_size=(96, 128)))


@functools.cache
def cloud() -> PointCloud:
    env().start()
    return look(env(), 48, 64)


@functools.cache
def room() -> TableEnv:
    return TableEnv()


@functools.cache
def trial() -> trials.Trial:
    return trials.rollout(env(), policies.RandomPolicy("torque"), 12)


@functools.cache
def autoencoder() -> Autoencoder:
    torch.manual_seed(0)
    return Autoencoder().eval().requires_grad_(False)


@functools.cache
def model() -> dpmpb.DPMPB:
    torch.manual_seed(0)
    return dpmpb.DPMPB(7, 2).eval().requires_grad_(False)


@functools.cache
def run() -> dpmpb.Sequences:
    return dpmpb.to_sequences(autoencoder(), trial())


def biases() -> dict[str, np.ndarray]:
    return {"a": np.array([1.0, 2.0]), "b": np.array([-1.0, 0.5]), "c": np.array([0.3, -0.7])}


def trained_() -> trained.Trained:
    return trained.Trained("x-0", arm.get_arm("torque"), autoencoder(), model(), biases(), np.array([0.3, 0.2]), "x")


def observation() -> dict[str, np.ndarray]:
    return env().observe()


def rows() -> dict[str, Callable[[], Any]]:
    """What stands for a parameter, by its name or `module.function.name`."""
    p, z = np.array([0.3, -0.2]), np.zeros(3)
    F = np.array([[2.0, 0.5], [0.5, 1.0]])
    noise = fisher.Noise(np.eye(3), 0.2)
    return {
        "mask": square,
        "target": square,
        "a": square,
        "b": square,
        "images": lambda: trial().images,
        "p": lambda: p,
        "centre": lambda: p,
        "covariance": lambda: F,
        "information": lambda: F,
        "biases": biases,
        "combinations": lambda: np.eye(2),
        "noise": lambda: noise,
        "z_ref": lambda: z,
        "autoencoder.decode.z": lambda: z[None],
        "sensitivity": lambda: np.ones((5, 3, 2)),
        "sensitivities": lambda: np.random.default_rng(0).normal(size=(4, 5, 3, 2)),
        "values": lambda: np.ones((5, 3)),
        "residuals": lambda: np.random.default_rng(0).normal(size=(4, 6, 3)),
        "stated": lambda: np.eye(3),
        "distances": lambda: np.arange(1.0, 25.0),
        "best": lambda: np.arange(1.0, 7.0),
        "analysis.median_best.runs": lambda: [np.arange(1.0, 25.0)] * 2,
        "differences": lambda: np.arange(5.0),
        "held": lambda: [True, False, True],
        "thresholds": lambda: [0.5, 1.0],
        "resamples": lambda: 100,
        "analysis.success_rate.distances": lambda: np.ones((3, 24)),
        "material": lambda: "a",
        "model": model,
        "run": run,
        "runs": lambda: [run()],
        "trial": trial,
        "trials": lambda: [trial()],
        "autoencoder": autoencoder,
        "trained": trained,
        "autoencoder.encode.model": autoencoder,
        "autoencoder.decode.model": autoencoder,
        "artifacts.save_autoencoder.model": autoencoder,
        "losses": lambda: [0.2, 0.1],
        "arm": lambda: arm.get_arm("torque"),
        "cloth": lambda: get_cloth("damp0.05-mass0.10"),
        "env": env,
        "table.room_picture.env": room,
        "settings": lambda: None,
        "commands": lambda: trial().commands,
        "robot": lambda: trial().robot,
        "policy": lambda: policies.RandomPolicy("torque"),
        "results": lambda: {"x": 1.0},
        "camera": lambda: arm.get_arm("torque").camera,
        "points": lambda: np.ones((4, 3)),
        "u": lambda: [0.1, 0.2],
        "theta": lambda: np.array([0.1, 0.2]),
        "force": lambda: [0.5, 0.0],
        "displacements": lambda: np.eye(4)[:, :2],
        "theta_ref": lambda: [0.1, 0.2],
        "f_const": lambda: 20.0,
        "s": lambda: np.zeros(7),
        "stiffness.stiffness_ellipse.force": lambda: 1.0,
        "stiffness.static_posture.u": lambda: [0.1, 0.2, 20.0],
        "stiffness.stiffness_ellipse.arm": lambda: arm.get_arm("muscle"),
        "stiffness.static_posture.arm": lambda: arm.get_arm("muscle"),
        "depth": lambda: np.ones((6, 8)),
        "fovy": lambda: 45.0,
        "position": lambda: np.zeros(3),
        "axes": lambda: np.eye(3),
        "fit": lambda: fit(),
        "lengths": lambda: (8, 10),
        "observation": observation,
        "furniture": Furniture,
        "table.spread.points": lambda: np.random.default_rng(0).uniform(-1, 1, (3, 6, 3)),
        "cost": lambda: lambda plans: np.ones(len(plans)),
        "starts": lambda: np.zeros((60, 8, 2)),
        "lower": lambda: [-1.0, -1.0],
        "upper": lambda: [1.0, 1.0],
        "rng": lambda: np.random.default_rng(0),
        "scale": lambda: np.ones(2),
        "cloths": cloths,
        "name": lambda: "x",
        "kind": lambda: "soft",
        "sheets": lambda: 1,
        "steps": lambda: 2,
        "damping": lambda: 0.05,
        "mass": lambda: 0.1,
        "seed": lambda: 0,
        "period": lambda: 4,
        "interval": lambda: 0.1,
        "sigma": lambda: 0.1,
        "horizon": lambda: 4,
        "count": lambda: 2,
        "function": lambda: lambda observation: np.zeros(2),
        "share": lambda: 0.9,
        "height": lambda: 24,
        "width": lambda: 32,
        "length": lambda: 5,
        "stride": lambda: 5,
        "near": lambda: np.zeros(3),
        "shift": lambda: (0.1, 0.0, 0.0),
        "turn": lambda: (0.1, 0.0, 0.0),
        "elongation": lambda: np.full(6, 0.01),
        "action": lambda: np.array([0.1, 0.2]),
        "cloud": cloud,
        "basket": Basket,
        "bottom": lambda: np.zeros(3),
        "recognition.basket_distance.turn": lambda: 0.1,
        "watch": lambda: None,
        "samples": lambda: 1,
        "stretch": lambda: 1.0,
        "estimation.Fit.step.freedom": lambda: 4.0,
        "estimation.Fit.covariance.freedom": lambda: 4.0,
        "lag": lambda: 2,
        "plans": lambda: None,
        "first": lambda: None,
        "control.period_mask.settings": control.ControlSettings,
        "control.step_sizes.settings": control.ControlSettings,
        "t": lambda: 2,
        "device": lambda: "cpu",
        "false_alarms": lambda: 0.05,
        "rounds": lambda: 1,
        "latent_size": lambda: 3,
        "state_size": lambda: 7,
        "command_size": lambda: 2,
        "tension": lambda: np.full(6, 20.0),
    }


def cloths() -> dict[str, Any]:
    names = ("damp0.03-mass0.05", "damp0.05-mass0.10", "damp0.10-mass0.15")
    return dict(zip(biases(), map(get_cloth, names), strict=True))


@functools.cache
def fit() -> estimation.Fit:
    return estimation.Fit.of(model(), torch.as_tensor(run().s), torch.as_tensor(run().u), np.zeros(2))


EXAMPLES = rows()

# What methods belong to, made anew for each call: a refusal must not spoil the next answer.
OBJECTS: dict[type, Callable[[], Any]] = {
    arm.Camera: lambda: arm.get_arm("torque").camera,
    arm.TorqueArm: lambda: arm.get_arm("torque"),
    arm.FeelingArm: lambda: arm.get_arm("torque-feeling"),
    arm.MuscleArm: lambda: arm.get_arm("muscle"),
    trained.Trained: trained_,
    ClothEnv: env,
    control.ControlPolicy: lambda: control.ControlPolicy(
        model(), autoencoder(), arm.get_arm("torque"), square(), np.zeros(2)
    ),
    estimation.BiasEstimator: lambda: estimation.BiasEstimator(model()),
    estimation.NewtonEstimator: lambda: estimation.NewtonEstimator(model()),
    estimation.Fit: fit,
    fisher.Noise: EXAMPLES["noise"],
    trials.Trial: trial,
    policies.RandomPolicy: EXAMPLES["policy"],
    policies.OperatorPolicy: lambda: policies.OperatorPolicy("torque"),
    policies.ReplayPolicy: lambda: policies.ReplayPolicy(trial().commands),
    recalibration.Registration: lambda: recalibration.Registration(
        arm.get_arm("torque"), arm.get_arm("torque").camera, 0.1
    ),
}


@dataclass(frozen=True)
class Subject:
    """Something that is called: its name, and what its parameters are."""

    name: str
    call: Callable[..., Any]
    of: Callable[[], Any] | None  # makes the object whose method it is
    kinds: dict[str, str]  # of the parameters that a person fills in
    needed: tuple[str, ...]  # parameters without a default

    def example(self, parameter: str) -> Any:
        """Something right."""
        for name in (f"{self.name}.{parameter}", parameter):
            if name in EXAMPLES:
                return EXAMPLES[name]()
        raise LookupError(f"{self.name} needs {parameter}: put an example into EXAMPLES, or a reason into LEFT_OUT")


def subject(name: str, call: Callable[..., Any], of: Callable[[], Any] | None = None) -> Subject | None:
    """What can be tried, if a person fills in anything."""
    parameters = list(inspect.signature(call).parameters.values())[of is not None :]
    hints = typing.get_type_hints(call.__init__ if inspect.isclass(call) else call)
    if any(hints.get(each.name) is torch.Tensor for each in parameters):
        return None  # only the package itself makes tensors, and calls with them
    kinds = {each.name: kind for each in parameters if (kind := kind_of(hints.get(each.name)))}
    needed = tuple(each.name for each in parameters if each.default is each.empty and each.kind not in (2, 4))
    return Subject(name, call, of, kinds, needed) if kinds else None


def found() -> Iterator[Subject]:
    """Every public function and class of the package, and the methods of the classes in `OBJECTS`."""
    for name in sorted(clothlab.__all__):
        module = importlib.import_module(f"clothlab.{name}")
        for own, item in vars(module).items():
            path = f"{name}.{own}"
            ours = inspect.isfunction(item) or inspect.isclass(item)
            if own.startswith("_") or not ours or item.__module__ != module.__name__ or left_out(path):
                continue
            if inspect.isfunction(item) or (inspect.isclass(item) and worth_making(item)):
                yield subject(path, item)
            for method, each in inspect.getmembers(item, inspect.isroutine) if item in OBJECTS else ():
                ours = str(getattr(each, "__module__", "")).startswith("clothlab") and (
                    method[0] != "_" or method == "__call__"
                )
                if ours and not left_out(f"{path}.{method}"):
                    yield subject(f"{path}.{method}", each, OBJECTS[item] if inspect.isfunction(each) else None)


def left_out(path: str) -> bool:
    return any(path == name or path.startswith(f"{name}.") for name in LEFT_OUT)


def worth_making(cls: type) -> bool:
    """Whether a person makes one: settings are tried in test_validation; errors and answers are not made."""
    if issubclass(cls, BaseException | tuple) or inspect.isabstract(cls):
        return False
    if dataclasses.is_dataclass(cls):
        return any(field.type is np.ndarray for field in dataclasses.fields(cls)) and "__post_init__" in vars(cls)
    return True


SUBJECTS = {each.name: each for each in found() if each}


class OutOfPatience(BaseException):
    """No answer in time: neither right nor wrong."""


def hostile(kind: str, example: Any, folder: Path) -> st.SearchStrategy:
    """What might be put where something of this kind belongs."""
    odd = st.sampled_from([None, "", "x", b"x", True, 1j, {}, [], object(), float("nan"), [[1], [2, 3]]])
    if kind in ("float", "int"):
        extreme = [0, -1, 1, 0.5, 1e-300, 1e300, -1e300, float("inf"), float("-inf"), 10**30, -(10**9), 10**400]
        return st.one_of(
            st.sampled_from([*extreme, np.float32("nan"), np.int8(3), np.ones(1)]), st.floats(-10, 10), odd
        )
    if kind == "bool":
        return st.sampled_from([0, 1, True, False])
    if kind == "str":
        names = [
            "..",
            "../x",
            "/etc/passwd",
            "a\0b",
            "ä-雪",
            "x" * 5000,
            "nul\n",
            "%s",
            "{x}",
            "target-1",
            3,
            ["a"],
            {"a": 1},
        ]
        return st.one_of(st.sampled_from(names), st.text(max_size=8), odd)
    if kind == "path":
        files = [folder / name for name in ("nowhere", "file", "file/x.npz", "x" * 300, "a\0b", "ä/雪.npz", "x.npz")]
        return st.sampled_from([*files, *map(str, files), folder])
    if kind == "arrays by name":
        wrong = st.sampled_from(
            [{}, {"a": None}, {"a": [1.0, np.nan]}, {"a": [1.0, 2.0], "b": [1.0]}, {"a": "x"}, {"a": []}]
        )
        return st.one_of(wrong, st.dictionaries(st.text(max_size=3), arrays(), max_size=3), odd)
    return st.one_of(arrays(), bent(example), odd)


def arrays() -> st.SearchStrategy:
    types = st.sampled_from([np.float64, np.float32, np.int64, np.uint8, bool, np.complex128, np.dtype("U2"), object])
    return npst.arrays(types, npst.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4), fill=st.nothing())


def bent(example: Any) -> st.SearchStrategy:
    """Nearly right: one thing about it is wrong, or only unusual."""
    try:
        array = np.asarray(example, dtype=np.float64)
    except (TypeError, ValueError):
        return st.just(None)
    ways: list[Callable[[], Any]] = [lambda: array[..., :-1], lambda: array[:0], lambda: array[None], lambda: array.T]
    ways += [
        lambda: array.astype(object),
        lambda: array.tolist(),
        lambda: torch.as_tensor(array),
        lambda: array.astype(str),
    ]
    ways += [
        lambda: array * 1e300,
        lambda: array * 1e-300,
        lambda: -array,
        lambda: array * 0,
        lambda: array + 0.3,
        lambda: array,
    ]
    for value in (np.nan, np.inf, -1e308):
        ways += [lambda value=value: np.where(np.arange(array.size).reshape(array.shape) == 0, value, array)]
    return st.sampled_from(ways).map(lambda way: way() if array.ndim else array)


def endless(answer: Any, depth: int = 0) -> bool:
    """Whether there is a number in it that is none, or infinite."""
    if isinstance(answer, torch.Tensor):
        return bool(answer.is_floating_point() and not answer.isfinite().all())
    if isinstance(answer, np.ndarray | float | np.floating):
        array = np.asarray(answer)
        return array.dtype.kind in "fc" and not np.isfinite(array).all()
    if depth > 3:
        return False
    if dataclasses.is_dataclass(answer) and not isinstance(answer, type):
        return any(endless(getattr(answer, field.name), depth + 1) for field in dataclasses.fields(answer))
    if isinstance(answer, Mapping):
        return any(endless(each, depth + 1) for each in answer.values())
    return isinstance(answer, list | tuple) and any(endless(each, depth + 1) for each in answer)


def is_sentence(error: BaseException) -> bool:
    """Whether the package itself raised it, and says something; or the system said what it has against a file."""
    if isinstance(error, OSError) and error.filename:
        return True
    last = traceback.extract_tb(error.__traceback__)[-1]
    if not Path(last.filename).is_relative_to(Path(clothlab.__file__).parent) or len(str(error)) < 10:
        return False
    return any(first <= last.lineno <= end for first, end in raises(last.filename))


@functools.cache
def raises(filename: str) -> list[tuple[int, int]]:
    tree = ast.parse("".join(linecache.getlines(filename)))
    return [(node.lineno, node.end_lineno) for node in ast.walk(tree) if isinstance(node, ast.Raise)]


def too_late(*_: object) -> None:
    raise OutOfPatience


def judge(subject: Subject, arguments: dict[str, Any]) -> None:
    """Call, and fail unless there is a right answer or a sentence."""
    told = f"{subject.name}({', '.join(f'{key}={value!r:.60}' for key, value in arguments.items())}): "
    before = signal.signal(signal.SIGALRM, too_late)
    try:
        owner = [] if subject.of is None else [subject.of()]
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        answer = subject.call(*owner, **arguments)
        signal.setitimer(signal.ITIMER_REAL, 0)
    except (OutOfPatience, MemoryError):
        return
    except Exception as error:
        if not (isinstance(error, ERRORS) and is_sentence(error)):
            raise AssertionError(f"{told}{type(error).__name__}: {error}") from error
        return
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        plt.close("all")
    assert subject.name in MAY_BE_INFINITE or not endless(answer), f"{told}a number that is none: {answer!r:.200}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where files are written and read."""
    folder = tmp_path_factory.mktemp("hostile")
    write_bytes(folder / "file", b"no folder")
    return folder


@pytest.fixture(autouse=True)
def elsewhere(folder, monkeypatch) -> None:
    """No name may reach the data of the clone."""
    monkeypatch.setenv("CLOTHLAB_DATA", str(folder))
    estimation.BiasEstimator(model()).update(np.zeros(7), np.zeros(2))  # torch imports at leisure, not under the alarm


@pytest.mark.parametrize("name", SUBJECTS)
def test_whatever_it_is_given_it_answers_or_says_what_is_wrong(name, folder):
    subject = SUBJECTS[name]

    @settings(
        max_examples=max(1, -(-INPUTS // len(SUBJECTS))),
        deadline=None,
        database=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
        report_multiple_bugs=False,
        derandomize=INPUTS <= 1000,
    )
    @given(st.data())
    def tried(data):
        spoiled = data.draw(st.sets(st.sampled_from(sorted(subject.kinds)), min_size=1, max_size=2))
        arguments = {each: subject.example(each) for each in subject.needed if each not in spoiled}
        for each in sorted(spoiled):
            example = subject.example(each) if subject.kinds[each] in ("array", "arrays by name") else None
            arguments[each] = data.draw(hostile(subject.kinds[each], example, folder), label=each)
        judge(subject, arguments)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # an answer is judged by its numbers
        tried()


def test_nothing_is_left_out_that_is_not_there():
    for name in [*LEFT_OUT, *MAY_BE_INFINITE]:
        module, _, rest = name.partition(".")
        item = importlib.import_module(f"clothlab.{module}")
        for part in filter(None, rest.split(".")):
            item = getattr(item, part)
