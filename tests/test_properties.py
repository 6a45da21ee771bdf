"""What a notebook calls, given plausible mistakes: it answers, or says in one sentence
what is wrong.

Every example is first tried as it is, then with one argument spoiled: another name,
shape or kind, NaN, out of range.
"""

import importlib
import io
import linecache
import os
import pkgutil
import traceback
import typing
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, Phase, given, settings, strategies as st
from PIL import Image

import clothlab
from clothlab import _store, analysis, data as stored, policies, trials
from clothlab._validation import Checked
from clothlab.cloth_checkpoint import ClothCheckpoint
from clothlab.data import _writing
from clothlab.method import autoencoder, estimation, gauss_newton
from clothlab.method.data import Run
from clothlab.method.model import DPMPB
from clothlab.simulation import cloth, env, stiffness, vision
from clothlab.simulation._arm_data import get_arm
from clothlab.simulation._mask_files import mask_from_file
from clothlab.simulation.scene import Scene

pytestmark = pytest.mark.slow  # a thousand inputs

# In all; `make nightly` asks for ten times as many
INPUTS = int(os.environ.get("CLOTHLAB_INPUTS", "1000"))
ERRORS = (ValueError, KeyError, TypeError, FileNotFoundError)
TORQUE, MUSCLE = get_arm("torque"), get_arm("muscle")


@cache
def scene() -> env.ClothEnv:
    return env.ClothEnv("torque", "damp0.05-mass0.10", scene=Scene(settle_time=0.2))


@cache
def trial() -> trials.Trial:
    return trials.rollout(scene(), policies.RandomPolicy("torque"), 12)


@cache
def learned() -> ClothCheckpoint:
    """Networks with random weights."""
    torch.manual_seed(0)
    eyes, model = autoencoder.Autoencoder().eval(), DPMPB(7, 2).eval()
    biases = {
        "damp0.03-mass0.05": np.ones(2),
        "damp0.05-mass0.10": -np.ones(2),
        "damp0.07-mass0.15": np.array([1, 0.3]),
    }
    biases = {name: p.astype(np.float32) for name, p in biases.items()}
    return ClothCheckpoint(
        name="x-0",
        arm=TORQUE,
        autoencoder=eyes.requires_grad_(False),
        model=model.requires_grad_(False),
        biases=biases,
        losses=np.array([0.2, 0.1]),
        autoencoder_name="x",
    )


@cache
def run() -> Run:
    return learned().to_run(trial())


def square() -> np.ndarray:
    mask = np.zeros((96, 128), bool)
    mask[30:50, 40:70] = True
    return mask


def picture_file() -> bytes:
    content = io.BytesIO()
    Image.fromarray(square().astype(np.uint8) * 255).save(content, "PNG")
    return content.getvalue()


def estimator(p: Any, s: Any, u: Any) -> np.ndarray:
    return estimation.BiasEstimator(learned().model, p).update(s, u)


def aimed(target: Any, p: Any) -> policies.Policy:
    policy = learned().controller(square(), "damp0.05-mass0.10")
    policy.set_target(target)
    policy.set_bias(p)
    return policy


THETA, U3 = [0.1, -0.4], [0.1, -0.4, 30.0]
DOORS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "get_cloth": (cloth.get_cloth, {"cloth": "soft-1"}),
    "get_arm": (get_arm, {"arm": "muscle"}),
    "with_stiffness": (MUSCLE.with_stiffness, {"f_const": 20.0}),
    "hand": (TORQUE.hand, {"theta": THETA}),
    "hand_jacobian": (TORQUE.hand_jacobian, {"theta": THETA}),
    "body_image": (MUSCLE.body_image, {"theta": THETA, "tension": np.full(6, 20.0)}),
    "tension": (MUSCLE.tension, {"elongation": [0.01, 0.02]}),
    "elongation": (MUSCLE.elongation, {"tension": [10.0, 20.0]}),
    "moved": (TORQUE.camera.moved, {"shift": [0.1, 0.0, 0.0], "turn": [0.0, 3.0, 0.0]}),
    "static_posture": (
        lambda **given: stiffness.static_posture(MUSCLE, **given),
        {"u": U3, "force": [1.0, 0.0]},
    ),
    "stiffness_ellipse": (
        lambda **given: stiffness.stiffness_ellipse(MUSCLE, **given),
        {"theta_ref": THETA, "f_const": 30.0, "force": 1.0, "directions": 3},
    ),
    "ellipse_area": (stiffness.ellipse_area, {"displacements": np.eye(4)[:, :2]}),
    "ClothEnv": (env.ClothEnv, {"arm": "torque", "cloth": "soft-1"}),
    "hold": (lambda cloth: scene().hold(cloth), {"cloth": "damp0.05-mass0.10"}),
    "reset": (lambda seed: scene().reset(seed=seed), {"seed": 3}),
    "step": (lambda action: scene().step(action), {"action": THETA}),
    "camera_picture": (
        lambda **given: scene().camera_picture(**given),
        {"height": 48, "width": 64},
    ),
    "rollout": (
        lambda **given: trials.rollout(
            scene(), policies.RandomPolicy("torque"), **given
        ),
        {"steps": 1, "seed": 0, "samples": 5},
    ),
    "Trial": (lambda **given: replace(trial(), **given), {}),  # see `known`
    "load_trial": (trials.load_trial, {"path": Path("trials/short/00.npz")}),
    "save_trial": (
        lambda path: trials.save_trial(trial(), path),
        {"path": Path("own.npz")},
    ),
    "RandomPolicy": (policies.RandomPolicy, {"arm": "muscle", "longest_hold": 3}),
    "OperatorPolicy": (policies.OperatorPolicy, {"arm": "muscle"}),
    "ReplayPolicy": (policies.ReplayPolicy, {"commands": [THETA, THETA]}),
    "cloth_mask": (vision.cloth_mask, {"rgb": np.zeros((96, 128, 3), np.uint8)}),
    "chamfer_distance": (vision.chamfer_distance, {"a": square(), "b": square()}),
    "mask_from_file": (mask_from_file, {"content": picture_file()}),
    "encode": (
        lambda images: autoencoder.encode(learned().autoencoder, images),
        {"images": square()[None]},
    ),
    "decode": (
        lambda z: autoencoder.decode(learned().autoencoder, z),
        {"z": np.zeros(3)},
    ),
    "load": (stored.load, {"name": "x-0"}),
    "load_trials": (stored.load_trials, {"name": "short"}),
    "load_target": (stored.load_target, {"name": "a"}),
    "save_target": (_writing.save_target, {"mask": square(), "name": "b"}),
    "estimator": (estimator, {"p": np.zeros(2), "s": np.zeros(7), "u": np.zeros(2)}),
    "estimate_bias": (
        lambda p: gauss_newton.estimate_bias(learned().model, run(), p),
        {"p": np.zeros(2)},
    ),
    "controller": (
        lambda **given: learned().controller(**given),
        {"target": square(), "p": "damp0.05-mass0.10"},
    ),
    "aimed": (aimed, {"target": square(), "p": np.zeros(2)}),
    "nearest_material": (
        lambda p: analysis.nearest_material(p, learned().biases),
        {"p": np.zeros(2)},
    ),
    "best_per_period": (
        analysis.best_per_period,
        {"distances": np.ones(24), "period": 8},
    ),
}


def known(door: str) -> tuple[Callable[..., Any], dict[str, Any]]:
    """A door, and what is right for it; a trial is recorded when it is asked for."""
    call, right = DOORS[door]
    if door == "Trial":
        names = {each.name for each in fields(trials.Trial)}
        names -= {"cloth"}  # which is no number, array or name
        right = {name: getattr(trial(), name) for name in names} | {"arm": "torque"}
    return call, right


def settings_classes(parent: type = Checked) -> Iterator[type]:
    for cls in parent.__subclasses__():
        yield from settings_classes(cls)
        if cls.__module__.startswith("clothlab") and not getattr(
            cls, "__abstractmethods__", None
        ):
            yield cls


def plain(kind: Any) -> Any:
    """Something right for a setting without a default."""
    if typing.get_origin(kind) is tuple:
        return tuple(plain(each) for each in typing.get_args(kind) if each is not ...)
    return example(kind) if is_dataclass(kind) else kind(1)


def example(cls: type) -> Any:
    needed = [each for each in fields(cls) if each.default is each.default_factory]
    return cls(**{each.name: plain(each.type) for each in needed})


for module in pkgutil.walk_packages(clothlab.__path__, "clothlab."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
for own in settings_classes():
    if all(each.type is not np.ndarray for each in fields(own)):
        made = example(own)
        values = {each.name: getattr(made, each.name) for each in fields(own)}
        values = {
            name: value
            for name, value in values.items()
            if isinstance(value, int | float | str | tuple)
        }
        DOORS[f"{own.__module__}.{own.__name__}"] = (
            lambda made=made, **given: replace(made, **given),
            values,
        )


def spoiled(value: Any) -> st.SearchStrategy:
    """What somebody might pass by mistake where `value` belongs."""
    anything = [None, "x", [], np.nan, -1]
    if isinstance(value, bytes):
        flips = st.integers(0, 8 * len(value) - 1).map(lambda bit: flipped(value, bit))
        return flips | st.integers(0, len(value) - 1).map(lambda end: value[:end])
    if isinstance(value, Path):
        return st.sampled_from(
            [
                Path("none.npz"),
                "trials",
                "README.txt",
                Path("targets/a.png"),
                "cut.npz",
                "x.npy",
            ]
        )
    if isinstance(value, str):
        return st.sampled_from(
            ["felt", "", "../x", "a b", "x-0", 3, ["soft-1"], *anything]
        ) | st.text(max_size=6)
    if isinstance(value, int | float):
        wrong = [
            0,
            2.5,
            np.inf,
            "1",
            True,
            1j,
            np.ones(2),
            np.datetime64("2024-01-01"),
            *anything,
        ]
        return st.sampled_from(wrong) | st.floats(-100, 100) | st.integers(-3, 30)
    array = np.asarray(value)
    if array.dtype.kind == "U":
        return st.sampled_from([("felt",), value[0], value[::-1], *anything])
    bent: list[Any] = [
        array[..., :-1],
        array[:0],
        array[None],
        array.T,
        array.astype(str),
        array + 0j,
        array * 255,
    ]
    bent += [
        array.astype("M8[s]") if array.dtype.kind in "iu" else array * 1e3,
        -array if array.dtype != bool else array,
    ]
    bent += [with_one(array, wrong) for wrong in (np.nan, np.inf, 0.5)]
    return st.sampled_from([*bent, *anything])


def with_one(array: np.ndarray, wrong: float) -> np.ndarray:
    array = array.astype(np.float64)
    array.ravel()[:1] = wrong
    return array


def flipped(content: bytes, bit: int) -> bytes:
    return (
        content[: bit // 8]
        + bytes([content[bit // 8] ^ 1 << bit % 8])
        + content[bit // 8 + 1 :]
    )


def refusal(act: Callable[[], Any]) -> Exception | None:
    try:
        act()
    except (*ERRORS, env.SimulationError) as error:
        return error
    return None


def is_sentence(error: Exception) -> bool:
    """Whether a `raise` of this package wrote it, in one line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    ours = Path(last.filename).is_relative_to(Path(clothlab.__file__).parent)
    written = (
        linecache.getline(last.filename, last.lineno or 0).lstrip().startswith("raise ")
    )
    said = str(error)
    system = isinstance(error, FileNotFoundError) and error.filename
    return bool(
        system or (ours and written and 10 < len(said) < 400 and "\n" not in said)
    )


def content(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A small data folder."""
    folder = tmp_path_factory.mktemp("data")
    trials.save_trial(trial(), folder / "trials" / "short" / "00.npz")
    (folder / "cut.npz").write_bytes(
        (folder / "trials" / "short" / "00.npz").read_bytes()[:-50]
    )
    (folder / "README.txt").write_text("no trial")
    _writing.save_target(square(), "a", data=folder)
    _writing.save_autoencoder(learned().autoencoder, [0.1], "x", data=folder)
    _writing.save(learned(), data=folder)
    _store.write_checksums(folder)
    return folder


@pytest.fixture(autouse=True)
def within(data, monkeypatch):
    monkeypatch.chdir(data)
    monkeypatch.setenv("CLOTHLAB_DATA", str(data))


@pytest.mark.parametrize("door", DOORS)
def test_an_example_is_accepted_as_it_is(door):
    call, given = known(door)
    call(**given)
    for path in (Path("own.npz"), Path("targets/b.png")):
        path.unlink(missing_ok=True)


@pytest.mark.parametrize("door", DOORS)
def test_a_mistake_is_answered_or_refused_in_one_sentence_and_changes_no_file(
    door, data
):
    call, right = known(door)
    before = content(data)

    @settings(
        max_examples=-(-INPUTS // len(DOORS)),
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
        derandomize=INPUTS <= 1000,
    )
    @given(st.data())
    def tried(draw):
        name = draw.draw(st.sampled_from(sorted(right)))
        wrong = draw.draw(spoiled(right[name]), label=name)
        error = refusal(lambda: call(**right | {name: wrong}))
        assert error is None or is_sentence(error), (
            f"{door}({name}={wrong!r:.80}): {type(error).__name__}: {error}"
        )
        if door.startswith("save"):
            Path("own.npz").unlink(missing_ok=True)
            Path("targets/b.png").unlink(missing_ok=True)

    tried()
    assert door.startswith("save") or content(data) == before
