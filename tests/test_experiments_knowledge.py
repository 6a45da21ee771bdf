"""What can be known: the scenes that are compared, the noise that is measured, and what the record says."""

from dataclasses import replace

import numpy as np
import pytest

from clothlab.experiments import knowledge
from clothlab.experiments.knowledge import (
    QUANTITIES,
    SENSORS,
    Case,
    Known,
    Plan,
    Record,
    Run,
    Settings,
    commands_of,
    left_over,
    mask_moments,
    measure,
    most_informative,
    strong_arm,
    turned,
    vary,
)
from clothlab.learning.autoencoder import Autoencoder
from clothlab.learning.control import recorded_plans
from clothlab.policies import OperatorPolicy
from clothlab.simulation.arm import TorqueArm
from clothlab.simulation.cloth import get_cloth
from clothlab.simulation.env import ClothEnv
from clothlab.trials import rollout

CLOTH = get_cloth("damp0.05-mass0.10")
ALL = (*SENSORS, knowledge.PREDICTED)
TINY = {"steps": 5, "times": (0.6, 1.0), "repeats": 4, "step": 0.2}


def points(cloth, arm, commands):
    """Where the cloth is in the course of a motion `[T, rows, columns, 3]` [m]."""
    env, found = ClothEnv(arm, cloth), []
    for u in commands:
        env.advance(u)
        found.append(env.cloth_points())
    return np.array(found)


@pytest.fixture(scope="module")
def swings():
    return commands_of("random", 3, 12)


def product_over_ratio(arm, swings, *, springs_scale):
    """How much the product moves the cloth, of what the ratio does."""

    def scene(damping, mass):
        cloth = vary(CLOTH, "damping", damping)
        return points(vary(cloth, "mass", mass, springs_scale=springs_scale), arm, swings)

    ratio, both = (scene(0.1, b) - scene(-0.1, -b) for b in (-0.1, 0.1))
    return np.linalg.norm(both) / np.linalg.norm(ratio)


def test_with_springs_scaled_the_product_moves_nothing_but_an_arm_that_feels_the_weight(swings):
    usual = product_over_ratio(TorqueArm(), swings, springs_scale=False)
    scaled = product_over_ratio(TorqueArm(), swings, springs_scale=True)
    unmoved = product_over_ratio(strong_arm(), swings, springs_scale=True)
    assert unmoved < 1e-3 < scaled < usual


def test_the_strong_arm_moves_as_the_usual_one(swings):
    usual, strong = (points(CLOTH, arm, swings)[:, 0] for arm in (TorqueArm(), strong_arm()))
    assert np.abs(usual - strong).max() < 0.05 * np.ptp(usual[..., 2])


@pytest.fixture(scope="module")
def measured(swings):
    """What the same motion tells in the usual scene and in the control."""
    settings, autoencoder = Settings(**TINY), Autoencoder().eval()
    return {
        name: measure(settings, autoencoder, CLOTH, swings[:5], settings.times, variant=name)
        for name in ("as it is", "springs scaled, strong arm")
    }


def test_the_bound_of_the_product_diverges_when_springs_scale_with_mass_and_only_torques_feel_the_weight(measured):
    usual, control = measured.values()
    values, directions = control.directions("mask")
    assert values[1] < 1e-3 * values[0]
    assert abs(directions[0] @ (1, -1)) / np.sqrt(2) > 0.999
    assert control.bound("mask")["C_damp · C_mass"][-1] > 30 * control.bound("mask")["C_damp / C_mass"][-1]
    assert usual.bound("mask")["C_damp · C_mass"][-1] < 20 * usual.bound("mask")["C_damp / C_mass"][-1]
    assert np.trace(control.information["joints"][-1]) < 1e-2 * np.trace(usual.information["joints"][-1])
    assert (1, 1) @ control.information["torques"][-1] @ (1, 1) > 1


def test_what_is_measured_has_a_value_for_each_sensor_and_time(measured):
    for known in measured.values():
        assert {sensor: f.shape for sensor, f in known.information.items()} == dict.fromkeys(ALL, (2, 2, 2))
        assert [len(known.noise[sensor]) for sensor in SENSORS] == [3, 10, 4, 2]
        assert known.noise["torques"] == pytest.approx([0.1, 0.1], rel=1e-3), "stated, and no chaos beside it"
        assert known.chaos < 1e-4
        for sensors in knowledge.SENSOR_SETS:
            assert not np.isnan(list(known.bound(sensors).values())).any()


def test_more_sensors_know_more(measured):
    known = measured["as it is"]
    for quantity in QUANTITIES:
        bounds = [known.bound(sensors)[quantity][-1] for sensors in ("z", "z + joints", "z + joints + torques")]
        assert bounds == sorted(bounds, reverse=True)


def test_a_constant_is_changed_by_a_factor_and_the_springs_only_where_asked():
    heavier = vary(CLOTH, "mass", 0.1)
    assert heavier == replace(CLOTH, mass=CLOTH.mass * np.exp(0.1))
    scaled = vary(CLOTH, "mass", 0.1, springs_scale=True)
    for name in ("mass", "stiffness", "bending", "spring_damping"):
        assert getattr(scaled, name) == pytest.approx(getattr(CLOTH, name) * np.exp(0.1))
    assert vary(CLOTH, "damping", -0.1, springs_scale=True) == vary(CLOTH, "damping", -0.1)
    with pytest.raises(KeyError, match="unknown unknown 'colour'; choose from damping, mass"):
        vary(CLOTH, "colour", 0.1)


def test_a_camera_turned_by_pixels_moves_its_image_by_them():
    centres = []
    for across, up in ((0, 0), (5, 3)):
        arm = TorqueArm()
        env = ClothEnv(replace(arm, camera=turned(arm.camera, across, up)), CLOTH)
        centres.append(np.argwhere(env.observe()["image"]).mean(axis=0))
        env.close()
    assert centres[1] - centres[0] == pytest.approx([3, -5], rel=0.2)  # pixels away from the middle are wider


def test_the_networks_errors_are_those_behind_its_warmup(trial, monkeypatch):
    monkeypatch.setattr(knowledge.artifacts, "load_trials", lambda name: [trial, trial[:11]])
    with pytest.raises(ValueError, match="two steps at the least"):
        knowledge.prediction_noise.__wrapped__("torque-0", "these")
    monkeypatch.setattr(knowledge.artifacts, "load_trials", lambda name: [longer(trial)] * 2)
    noise = knowledge.prediction_noise.__wrapped__("torque-0", "these")
    assert noise.deviations.shape == (3,)
    assert (noise.deviations > 1e-3).all()


def longer(trial):
    """The same again and again, as a recording that the network has not seen."""
    names = ("images", "robot", "commands")
    return replace(trial, **{name: np.concatenate([getattr(trial, name)] * 3) for name in names})


def test_what_moves_with_the_camera_is_no_noise_and_what_scatters_is_measured_in_full():
    rng = np.random.default_rng(0)
    turns, slopes, level = (
        rng.uniform(-0.5, 0.5, (4, 2)),
        rng.normal(size=(2, 4, 50, 3)),
        rng.normal(size=(4, 1, 50, 3)),
    )
    smooth = level + np.tensordot(turns, slopes, axes=1).swapaxes(0, 1)  # steeper in one scene than in another
    assert left_over(smooth, turns) == pytest.approx(np.zeros((16, 50, 3)), abs=1e-12)
    assert left_over(smooth + rng.normal(0, 0.3, smooth.shape), turns).std() == pytest.approx(0.3, rel=0.1)


def test_moments_say_how_much_cloth_there_is_and_where(square):
    area, y, *_ = mask_moments([square, ~square, square & False]).T
    assert area == pytest.approx([square.mean(), 1 - square.mean(), 0])
    rows = np.linspace(-1, 1, 96)
    assert y[0] / area[0] == pytest.approx(rows[30:50].mean())
    assert mask_moments([square]).shape == (1, 10)
    assert mask_moments([square], order=1).shape == (1, 3)


def test_commands_are_those_that_the_policy_sends_when_it_sees(env):
    assert np.array_equal(commands_of("operator", 5, 4), rollout(env, OperatorPolicy("torque"), 4, seed=5).commands)


def test_plans_are_measured_to_their_ends_and_ranked(monkeypatch):
    swings = [commands_of("random", seed, 6) for seed in range(3)]
    sizes = {swing.tobytes(): size for swing, size in zip(swings, (2.0, 0.0, 3.0), strict=True)}

    def measured(settings, autoencoder, cloth, commands, times, *, predicting):
        assert times == pytest.approx([1.2])
        return known(sizes[commands.tobytes()], 1)

    monkeypatch.setattr(knowledge, "measure", measured)
    monkeypatch.setattr(knowledge, "_network", lambda settings: (None, None))
    order, log_det = most_informative(swings, "mask")
    assert order.tolist() == [2, 0, 1]
    assert log_det == pytest.approx([np.log(4 * 3), -np.inf, np.log(9 * 3)])


@pytest.mark.parametrize(
    ("use", "error", "message"),
    [
        (lambda: commands_of("dance", 0, 3), KeyError, "unknown motion 'dance'; choose from random, operator"),
        (lambda: most_informative([], "z"), ValueError, r"plans is \[N, T, 2\]"),
        (
            lambda: most_informative(np.zeros((1, 3, 2)), "ears"),
            KeyError,
            "unknown set of sensors 'ears'; choose from z",
        ),
        (lambda: Settings(steps=10), ValueError, "Settings.times end with the run, after 2 s"),
        (lambda: Settings(step=0), ValueError, "Settings.step must be above 0"),
        (lambda: Settings(repeats=3), ValueError, "Settings.repeats must be at least 4"),
        (lambda: Settings(torque_noise=0), ValueError, "Settings.torque_noise must be above 0"),
    ],
)
def test_what_cannot_be_measured_is_refused(use, error, message):
    with pytest.raises(error, match=message):
        use()


@pytest.mark.parametrize(
    ("times", "variant", "error", "message"),
    [
        ((0.0,), "as it is", ValueError, "times are within the motion's 0.6 s"),
        ((0.8,), "as it is", ValueError, "times are within the motion's 0.6 s"),
        ((0.6,), "wet", KeyError, "unknown variant 'wet'; choose from as it is, springs scaled"),
    ],
)
def test_measurements_that_cannot_be_are_refused_before_anything_is_simulated(times, variant, error, message):
    with pytest.raises(error, match=message):
        measure(Settings(**TINY), Autoencoder(), CLOTH, np.zeros((3, 2)), times, variant=variant)


def known(size, times=2):
    f = np.stack([size * (k + 1) * np.array([[2.0, -1.0], [-1.0, 2.0]]) for k in range(times)])
    return Known(dict.fromkeys(ALL, f), {}, {}, 0.0, np.zeros(3))


@pytest.fixture
def record():
    settings = Settings(**TINY, plans=3, plan_steps=6)
    first = Case(CLOTH.name, "random", 7000, 0.2, 1e-6)
    runs = (
        Run(first, known(1.0)),
        Run(replace(first, seed=7001), known(4.0)),
        Run(replace(first, motion="operator"), known(9.0)),
        Run(replace(first, step=0.1), known(2.0)),
        Run(replace(first, disturbance=1e-3), known(3.0)),
        Run(replace(first, variant="springs scaled"), known(5.0)),
    )
    plans = tuple(Plan(np.zeros((6, 2)), known(size, 1)) for size in (2.0, 8.0, 4.0))
    return Record(settings, runs, plans)


def test_runs_are_found_by_what_they_are(record):
    assert [run.case.seed for run in record.cases("random")] == [7000, 7001]
    assert len(record.cases()) == len(record.cases(cloth=CLOTH.name)) == 3
    assert [run.known for run in record.cases(step=0.1)] == [record.runs[3].known]
    assert [run.known for run in record.cases(disturbance=1e-3)] == [record.runs[4].known]
    assert [run.known for run in record.cases(variant="springs scaled")] == [record.runs[5].known]
    assert record.cases("operator", "felt") == []


def test_bounds_follow_from_the_information_of_the_sensors_together(record):
    usual = record.runs[0].known
    assert usual.bound("z + joints")["C_damp"] == pytest.approx(usual.bound("z")["C_damp"] / np.sqrt(2))
    inverse = np.linalg.inv([[2.0, -1.0], [-1.0, 2.0]])
    assert usual.bound("z")["C_damp / C_mass"][0] == pytest.approx(np.sqrt([1, -1] @ inverse @ [1, -1]))
    assert record.median("z", "random")["C_mass"] == pytest.approx(
        np.mean([run.known.bound("z")["C_mass"] for run in record.cases("random")], axis=0)
    )
    values, directions = usual.directions("z")
    assert values == pytest.approx([6, 2])
    assert np.abs(directions[0] @ (1, -1)) == pytest.approx(np.sqrt(2))
    with pytest.raises(KeyError, match="unknown set of sensors 'ears'; choose from z, z"):
        usual.total("ears")


def test_plans_are_ranked_by_what_they_tell(record):
    assert record.order("z").tolist() == [1, 2, 0]


def test_cases_are_every_motion_and_then_what_is_tried_with_one_cloth():
    settings = Settings(cloths=(CLOTH.name, "between-light"), seeds=(1, 2), other_steps=(0.1,), other_disturbances=())
    found = knowledge.cases(settings)
    assert len(found) == len(set(found)) == 2 * 2 * 2 + 2 * (2 + 1)
    assert {case.variant for case in found} == set(knowledge.VARIANTS)


def test_what_was_measured_is_not_measured_again(tmp_path, monkeypatch, trial):
    settings = Settings(
        **TINY,
        cloths=(CLOTH.name,),
        motions=("random",),
        seeds=(1,),
        controls=(),
        other_steps=(),
        other_disturbances=(),
        plans=1,
        plan_steps=6,
    )
    calls = []
    monkeypatch.setattr(knowledge.artifacts, "load_trials", lambda name: [trial])
    monkeypatch.setattr(knowledge, "measure", lambda *_, **__: calls.append(0) or known(1.0))
    monkeypatch.setattr(knowledge, "_network", lambda settings: (None, None))
    first = knowledge.run(settings, folder=tmp_path)
    assert len(calls) == len(first.runs) + len(first.plans) == 2
    assert np.array_equal(first.plans[0].commands, recorded_plans([trial], 6, 1)[0])
    again = knowledge.run(settings, folder=tmp_path)
    assert len(calls) == 2
    assert again.runs[0].known.total("z") == pytest.approx(first.runs[0].known.total("z"))
    knowledge.run(replace(settings, torque_noise=1.0), folder=tmp_path)
    assert len(calls) == 4
