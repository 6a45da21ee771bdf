"""Settings refuse numbers that mean nothing: a negative mass, no step, half a period."""

import dataclasses
import importlib
import pkgutil

import pytest

import clothlab
from clothlab._validation import Checked
from clothlab.simulation.arm import TorqueArm
from clothlab.simulation.cloth import SHEETS, Cloth

PLACES = {"lower", "upper", "home", "position", "target", "roll"}  # of either sign
MAY_BE_ZERO = {
    *("momentum", "warmup", "bias_size", "burn_in", "settle_time"),
    *("IterativeLearningSettings.iterations", "trust", "difference"),
    *("caution", "least_caution", "tension_weight"),
    *("hinge_damping", "stop_margin", "servo_damping", "biarticular_moment_arms"),
    *("spring_cubic", "motor_damping", "tension_bias"),
    *("Cloth.damping", "bending", "spring_damping"),
}
AT_MOST = {
    "EstimationSettings.momentum": 1.0,
    "Scene.settle_time": 60.0,
    "Scene.picture_size": (4096, 640),
    "Cloth.rows": 100,
    "Cloth.columns": 100,
    "Cloth.mass": 10.0,
    "Camera.fovy": 170.0,
}
AT_LEAST = {
    "AutoencoderTraining.batch_size": 2,
    "ControlSettings.candidates": 2,
    "NewtonSettings.least": 2,
    "Cloth.rows": 2,
    "Cloth.columns": 2,
    "Cloth.mass": 1e-3,
}


def kinds(parent=Checked):
    for kind in parent.__subclasses__():
        if kind.__module__.startswith(("clothlab.method", "clothlab.simulation")):
            yield kind
            yield from kinds(kind)


def examples():
    """One of every kind of settings in the method and the simulation."""
    for module in pkgutil.walk_packages(clothlab.__path__, "clothlab."):
        if module.name.startswith(("clothlab.method", "clothlab.simulation")):
            importlib.import_module(module.name)
    made = {
        "Cloth": Cloth("x"),
        "FoamSheet": SHEETS["soft"],
        "Camera": TorqueArm().camera,
    }
    for kind in kinds():
        needed = [
            each
            for each in dataclasses.fields(kind)
            if each.default is each.default_factory is dataclasses.MISSING
        ]
        if not needed:
            made[kind.__name__] = kind()
    return made


MADE = examples()
NUMBERS = [
    f"{name}.{field.name}"
    for name, example in MADE.items()
    for field in dataclasses.fields(example)
    if isinstance(getattr(example, field.name), int | float | tuple)
    and not isinstance(getattr(example, field.name), bool)
    and getattr(example, field.name) != ()
]


def changed(where, value):
    """The example with another number; of a tuple the first one is changed."""
    name, field = where.split(".")
    example = MADE[name]
    before = getattr(example, field)
    if isinstance(before, tuple) and not isinstance(value, tuple):
        value = (type(before[0])(value), *before[1:])
    if not isinstance(value, tuple):
        value = type(before)(value)
    return dataclasses.replace(example, **{field: value})


def is_refused(where, value):
    field = where.split(".")[1]
    with pytest.raises(ValueError, match=field):
        changed(where, value)


@pytest.mark.parametrize("where", NUMBERS)
def test_below_zero_is_nothing_and_zero_only_where_it_means_something(where):
    field = where.split(".")[1]
    if field in PLACES:
        return
    is_refused(where, -1)
    if {field, where} & MAY_BE_ZERO:
        changed(where, 0)
    else:
        is_refused(where, 0)


@pytest.mark.parametrize("where", NUMBERS)
def test_whatever_is_above_zero_is_taken_unless_a_larger_least_is_named(where):
    name, field = where.split(".")
    before = getattr(MADE[name], field)
    if field in (*PLACES, "tension_range", "tension_max"):  # which have others around
        return
    first = before[0] if isinstance(before, tuple) else before
    small = 1 if isinstance(first, int) else 1e-3
    changed(where, AT_LEAST.get(where, small))


@pytest.mark.parametrize("where", AT_MOST)
def test_what_is_too_large_is_refused_and_the_largest_taken(where):
    most = AT_MOST[where]
    changed(where, most)
    beyond = (most[0] + 1, most[1]) if isinstance(most, tuple) else most * 1.01 + 1
    is_refused(where, beyond)


@pytest.mark.parametrize("where", AT_LEAST)
def test_what_is_too_small_is_refused_and_the_smallest_taken(where):
    least = AT_LEAST[where]
    changed(where, least)
    is_refused(where, least - 1 if isinstance(least, int) else least / 2)
