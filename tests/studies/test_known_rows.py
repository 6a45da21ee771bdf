"""Rows of every study whose value is known: in closed form, or by trying everything."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import toy

from clothlab import data
from clothlab.analysis import best_per_period, target_distance
from clothlab.method.autoencoder import encode
from clothlab.policies import ReplayPolicy
from clothlab.simulation.arm import MuscleArm, get_arm
from clothlab.simulation.cloth import CLOTHS, FOAMS
from clothlab.simulation.env import ClothEnv
from studies import (
    _runs,
    autoencoder_quality,
    calibration_test,
    control,
    estimation,
    identifiability,
    iterative_control,
    joint_estimation_control,
    oracle,
    self_organisation,
    stiffness,
    table_setting,
    transfer,
)

STUDIES = (_runs, autoencoder_quality, calibration_test, control)
STUDIES += (estimation, joint_estimation_control, self_organisation, stiffness)
STUDIES += (table_setting, transfer)
LIGHT, HEAVY = "damp0.03-mass0.05", "damp0.07-mass0.15"
PIXEL = 1.5 / toy.UNIT  # to which a camera that counts pixels sees z


@pytest.fixture
def world(monkeypatch):
    """The studies in a world that is known; `aim` is the z that every target shows."""
    found = SimpleNamespace(aim=np.zeros(3), learned=toy.learned(), trials=[])
    replaced = {
        "trained": lambda name: found.learned,
        "new_trial": toy.new_trial,
        "random_trial": toy.random_trial,
        "estimate_at_random": _runs.estimate_at_random,
    }
    for module, name in product(STUDIES, replaced):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, replaced[name])
    read = {
        "load_target": lambda name: toy.image_of(found.aim),
        "load_trials": lambda name: found.trials,
        "load_autoencoder": lambda name: (found.learned.autoencoder, None),
    }
    for name, instead in read.items():
        monkeypatch.setattr(data, name, instead)
    return found


# What the camera's numbers are worth


def test_distances_of_outlines_and_of_z_are_those_of_added_rows(world, monkeypatch):
    rows = np.arange(1, 6)  # added below ten rows, each a quarter of a deviation of z
    top = 10 * 128 / toy.UNIT - 4
    world.aim = [top, -4, -4]
    shown = [[top + k * 128 / toy.UNIT, -4, -4] for k in (0, *rows)] + [[-4, -4, -4]]
    monkeypatch.setattr(
        autoencoder_quality, "random_trial", lambda *_, seed: toy.trial_of(shown)
    )
    row = autoencoder_quality._compare("target-1")
    chamfer = rows * (rows + 1) / 2 / (10 + rows) / 2  # there is no way back to go
    assert row["log_chamfer"] == pytest.approx(np.log(chamfer), abs=1e-4)
    assert row["z_distance"] == pytest.approx(0.25 * rows)
    correlation = np.corrcoef(np.log(chamfer), rows)[0, 1]
    assert row["correlation"] == pytest.approx(correlation)


# What p is worth


@pytest.mark.parametrize("cloth", [LIGHT, "between-light"])
def test_p_that_can_be_known_exactly_is_found_and_read(world, cloth):
    held = (CLOTHS | estimation.BETWEEN)[cloth]
    row = estimation._run_one(cloth, 0)
    assert row["trace"].shape == (200, 2)
    assert row["trace"][-1] == pytest.approx(toy.bias_of(held), abs=0.01)
    assert row["read"] == pytest.approx([held.damping, held.mass], rel=0.05)
    assert row["error"] == pytest.approx(row["read"] / [held.damping, held.mass] - 1)
    if cloth == LIGHT:
        assert row["nearest"] == LIGHT
        assert row["distance"] < 0.02
    else:
        assert row["distance"] is None


@pytest.mark.slow
def test_control_from_a_wrong_p_ends_with_the_right_one(world):
    world.aim = [0.4, -0.8, 0.0]
    held = "damp0.03-mass0.10"
    row = joint_estimation_control._run_one(0, steps=120)
    right, wrong = toy.bias_of(held), toy.bias_of(HEAVY)
    last = np.linalg.norm(row["trace"][-1] - right) / np.linalg.norm(wrong - right)
    assert row["ratio"] == pytest.approx(last, abs=1e-3)
    assert row["ratio"] < 0.1
    assert best_per_period(row["distance"])[-3:].max() < 0.05
    first, late = joint_estimation_control.thirds(pd.DataFrame([row]))
    assert late < first


def test_regions_are_those_of_least_squares_and_hold_p(world, monkeypatch):
    known = calibration_test.Calibration(
        floor=1e-4 * np.eye(2),
        lengths=np.array([50.0]),
        scale=np.array([4.0]),
        limit=np.array([9.0]),
        biases=np.array([*world.learned.biases.values()]),
        usual=np.full((9, 7), -30.0),
    )
    monkeypatch.setattr(calibration_test, "_calibration", lambda model: known)
    row = calibration_test._run_one(LIGHT, 0, 0, steps=50)
    assert (row["kind"], row["nearest"]) == ("trained", LIGHT)
    assert row["estimate"][0] == pytest.approx(toy.bias_of(LIGHT), abs=0.01)
    # The floor is so large that it alone is seen: a pixel hardly scatters p.
    assert row["covariance"][0] == pytest.approx(4e-4 * np.eye(2), abs=2e-5)
    assert np.abs(row["bare"]).max() < 1e-5


@pytest.mark.filterwarnings("ignore:limits of command 2")  # one unit a deviation
def test_foams_are_found_where_they_are(world):
    names = ("hard-1", "hard-2", "hard-3")
    world.learned = toy.learned("muscle", ("hard-1", "hard-3", "soft-1"))
    row = stiffness._estimate_moved("hard-2", 0)
    first, right, last = (toy.bias_of(name) for name in names)
    along = (last - first) / np.sum((last - first) ** 2)
    assert row["place"] == pytest.approx((right - first) @ along, abs=0.05)
    assert 0.3 < row["place"] < 0.9


class FakeTable:
    """What a study asks of a table."""

    def __init__(self, arm, cloth, **_):
        self.arm, self.cloth = get_arm(arm), cloth

    def close(self):
        pass


# What control is worth


def nearest_to(aim, p, arm):
    """The least distance to a z of all commands, by trying them on a fine grid."""
    lines = np.linspace(arm.command_lower, arm.command_upper, 400).T[:2]
    z = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1) * (1 + p)
    return np.sqrt(((z - aim[:2]) ** 2).sum(-1) + aim[2] ** 2).min()


@pytest.mark.parametrize(
    "aim", [(0.3, -0.9, 0.0), (1.5, -0.4, 0.5)], ids=["reached", "beyond"]
)
def test_control_comes_as_near_as_any_command_can(world, aim):
    world.aim = np.array(aim)
    row = control._run_one("target-1", LIGHT, 0, steps=32)
    best = nearest_to(world.aim, toy.bias_of(LIGHT), world.learned.arm)
    assert best_per_period(row["control"]) == pytest.approx(best, abs=0.06)
    assert row["still"] == pytest.approx(np.linalg.norm(aim), abs=PIXEL)
    assert row["empty"] == pytest.approx(np.linalg.norm(world.aim + 4), abs=PIXEL)
    z = toy.random_trial("torque", LIGHT, 32, 7000)
    shown = encode(world.learned.autoencoder, z.images)
    assert row["random"] == pytest.approx(np.linalg.norm(shown - aim, axis=1), abs=2e-3)


def test_the_share_of_near_steps_is_counted(world, monkeypatch):
    world.learned = toy.learned("muscle", FOAMS)
    # A trial of no arm can't be sent again
    monkeypatch.setattr(stiffness, "_motion", lambda trial, *, in_full: {})
    distances = np.array([0.2, 0.4, 0.6, 3.0])
    shown = np.pad(distances[:, None], ((0, 0), (0, 2)))
    trial = toy.trial_of(shown, arm="muscle", cloth="hard-1")
    monkeypatch.setattr(stiffness, "random_trial", lambda *_: trial)
    row = stiffness._control_one(stiffness.RANDOM, "hard-1", 1)
    assert row["distance"] == pytest.approx(distances, abs=PIXEL)
    assert row["rate"] == 0.5
    assert row["empty"] == pytest.approx(4 * 3**0.5)


class Told:
    """A controller that notes which p it was given, and sends what it was told."""

    def __init__(self, commands):
        self.commands = commands
        self.given = []

    def __call__(self, learned, mask, *others):
        self.given.append(others[-1])
        return ReplayPolicy(self.commands)


@pytest.mark.parametrize("cloth", [LIGHT, "damp0.045-mass0.07"])
def test_a_throw_is_made_with_the_p_that_its_row_names(world, monkeypatch, cloth):
    """And its distances are those of what was seen, over those of chance."""
    aim = np.array([0.5, -1.0, 0.0])
    world.aim = aim
    told = Told(np.tile(get_arm("torque").home_command, (16, 1)))
    far = np.add(aim, (1.0, 0, 0))
    near = np.add(aim, (0.25, 0, 0))
    shown = np.array([far] * 4 + [near] + [far] * 11)
    monkeypatch.setattr(transfer, "_iterative", told)
    monkeypatch.setattr(transfer, "known_aim", lambda *_: None)
    monkeypatch.setattr(transfer, "new_trial", lambda policy, *_: toy.trial_of(shown))
    estimate = np.array([0.111, 0.222], np.float32)
    monkeypatch.setattr(transfer, "_estimated", lambda *_: estimate)
    chance = np.array([far] + [np.add(far, (1.0, 0, 0))] * 8 + [aim] * 8)
    monkeypatch.setattr(transfer, "_random_z", lambda *_: chance)

    for p in ("right", "estimated", "nearest", "farthest"):
        row = transfer._run_one(transfer.CHOSEN, p, "torque", "target-1", cloth, 0, 0)
        assert row["best"] == pytest.approx([0.25], abs=PIXEL)
        assert row["random"] == pytest.approx(np.median([2.0, 0.0]), abs=PIXEL)

    biases = world.learned.biases
    right = biases.get(cloth, estimate)
    others = [p for name, p in biases.items() if name != cloth]

    def by_distance(centre):
        return sorted(others, key=lambda p: np.linalg.norm(p - centre))

    wanted = [right, estimate, by_distance(right)[0], by_distance(right)[-1]]
    assert np.array(told.given) == pytest.approx(np.array(wanted))


def test_the_controller_of_a_throw_has_the_p_that_it_is_given(world, monkeypatch):
    runs = [world.learned.to_run(toy.random_trial("torque", LIGHT, 40, 0))]
    monkeypatch.setattr(transfer, "recorded_runs", lambda learned: runs)
    mask = toy.image_of([0.3, -0.9, 0.0])
    policy = transfer._iterative(world.learned, mask, np.array([0.3, -0.2]))
    assert policy.controller.p == pytest.approx([0.3, -0.2])


@pytest.mark.filterwarnings("ignore:limits of command 2")  # one unit a deviation
@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_of_every_method_the_first_throw_in_a_known_world_is_known(
    world, monkeypatch, arm
):
    names = CLOTHS if arm == "torque" else ("hard-1", "soft-1")
    world.learned = toy.learned(arm, names)
    world.aim = aim = np.array([0.3, -0.9, 0.0])
    cloth = next(iter(names))
    recorded = [toy.random_trial(arm, name, 60, k) for k, name in enumerate(names)]
    runs = [world.learned.to_run(trial) for trial in recorded]
    replaced = {
        "recorded_runs": lambda learned: runs,
        "known_aim": lambda arm, target: toy.image_of(aim),
        "_random_z": lambda *_: np.ones((24, 3)),
    }
    for name, instead in replaced.items():
        monkeypatch.setattr(transfer, name, instead)

    def first_throw(method):
        row = transfer._run_one(method, "right", arm, "a target", cloth, 0, 0)
        assert row["random"] == pytest.approx(np.linalg.norm(1 - aim), abs=PIXEL)
        return float(row["best"][0])

    least = nearest_to(aim, toy.bias_of(cloth), world.learned.arm)
    assert first_throw(transfer.CHOSEN) == pytest.approx(least, abs=0.06)
    seen = {run.material: np.linalg.norm(run.s[8:, :3] - aim, axis=1) for run in runs}
    nearest = transfer.bias("nearest", arm, cloth, 0, 0)
    (neighbour,) = [n for n in names if np.array_equal(toy.bias_of(n), nearest)]
    found = first_throw("replay, nearest p")
    run = next(run for run in runs if run.material == neighbour)
    best = 8 + int(seen[neighbour].argmin())
    sent = run.u[best - 8 : best, :2].astype(np.float64)
    z = np.pad((1 + toy.bias_of(cloth)) * sent, ((0, 0), (0, 1)))
    assert found == pytest.approx(np.linalg.norm(z - aim, axis=1).min(), abs=PIXEL)


# What the arm can do


@pytest.mark.parametrize(("spring", "f_const"), [("nonlinear", 70.0), ("linear", 30.0)])
def test_an_ellipse_is_the_compliance_of_springs_and_motors(
    monkeypatch, spring, f_const
):
    """C = J (Gᵀ k G)⁻¹ Jᵀ, where spring and motor of each muscle are in series."""
    whole = stiffness.stiffness_ellipse
    few = lambda *given: whole(*given, directions=4)  # noqa: E731
    monkeypatch.setattr(stiffness, "stiffness_ellipse", few)
    row = stiffness._push(spring, f_const)
    arm = stiffness._SPRINGS[spring]
    springs = arm.spring_stiffness(f_const)
    k = springs * arm.motor_stiffness / (springs + arm.motor_stiffness)
    joints = k * arm.moment_arms.T @ arm.moment_arms
    jacobian = arm.hand_jacobian(stiffness.POSTURE)
    compliance = jacobian @ np.linalg.inv(joints) @ jacobian.T
    assert row["area"] == pytest.approx(np.pi * np.linalg.det(compliance), rel=0.03)
    axes = np.linalg.eigvalsh(compliance)[::-1]
    assert row["semi_axes"] == pytest.approx(axes, rel=0.03)


def speeds_of(env, plan):
    """The hand's speed at 50 moments a step, from the joints' own [m/s]."""
    found = []

    def look():
        velocity = [env.data.joint(name).qvel[0] for name in ("shoulder", "elbow")]
        theta = env.arm.angles(env.data)
        found.append(np.linalg.norm(env.arm.hand_jacobian(theta) @ velocity))

    for u in plan:
        env.advance(u, look, 50)
    return np.array(found)


def test_peak_speeds_are_those_of_the_fastest_plan(monkeypatch):
    arm = MuscleArm()
    rng = np.random.default_rng(0)
    plans = rng.uniform(arm.command_lower, arm.command_upper, (2, 3, 3))
    monkeypatch.setattr(data, "load_trials", lambda name: [])
    monkeypatch.setattr(oracle, "recorded_plans", lambda *_, **__: plans)
    only_these = oracle.SearchSettings(rounds=0, elite=2)
    row = oracle._run_speed(0, steps=3, search=only_these)
    assert row["f_const"][:-1].tolist() == [10, 30, 70]
    assert np.isnan(row["f_const"][-1])
    assert (
        row["peak"][-1] == row["peak"][:-1].max()
    )  # it begins with what the others found
    env = ClothEnv("muscle", "hard-1")
    for tension, peak in zip(row["f_const"][:-1], row["peak"][:-1], strict=True):
        found = []
        for plan in plans:
            env.start()
            found.append(speeds_of(env, [(*u[:2], tension) for u in plan]).max())
        assert peak == pytest.approx(max(found), rel=0.02)


def brute_force(env, plan, autoencoder, z_ref):
    """The distance to a target after a plan, from the start of a scene."""
    env.start(seed=0)
    for u in plan:
        env.advance(u)
    return float(np.linalg.norm(encode(autoencoder, env.observe()["image"]) - z_ref))


@pytest.mark.slow
def test_an_oracle_sends_the_best_of_all_plans(world, monkeypatch):
    rng = np.random.default_rng(1)
    arm = get_arm("torque")
    plans = rng.uniform(arm.command_lower, arm.command_upper, (2, 8, 2))
    monkeypatch.setattr(oracle, "recorded_plans", lambda *_, **__: plans)
    world.aim = [-3.0, -2.0, -3.9]
    search = oracle.SearchSettings(starts=2, remembered=0, rounds=0, elite=1)
    row = oracle._run_one("torque", "target-1", HEAVY, None, 0, 2, search)
    env, autoencoder = ClothEnv("torque", HEAVY), world.learned.autoencoder
    found = [brute_force(env, plan, autoencoder, world.aim) for plan in plans]
    assert row["distance"][8] == pytest.approx(min(found), abs=1e-4)
    still = brute_force(env, [], autoencoder, world.aim)
    assert row["distance"][0] == pytest.approx(still, abs=1e-4)
    env.close()


def test_a_search_for_a_new_cloth_has_its_nearest_moment(world, monkeypatch):
    world.aim = aim = np.array([0.5, -1.0, 0.0])
    far = np.add(aim, (1.0, 0, 0))
    near = np.add(aim, (0.25, 0, 0))
    found = toy.trial_of([far] * 4 + [near] + [far] * 11)
    asked = []

    def search(autoencoder, arm, cloth, mask, plans, periods, *, search, overlap):
        asked.append((cloth.name, periods, overlap))
        return found

    monkeypatch.setattr(oracle, "search_trial", search)
    monkeypatch.setattr(oracle, "recorded_plans", lambda *_: None)
    row = oracle._run_transfer("torque", "target-1", HEAVY, True, 2)
    assert asked == [(HEAVY, 2, True)]
    assert row["best"] == pytest.approx([0.25], abs=PIXEL)
    pixels = sum((aim + 4) * toy.UNIT)
    assert row["iou"] == pytest.approx([pixels / (pixels + 128)], abs=1e-3)


@pytest.fixture
def in_the_toy(world, monkeypatch):
    """Iterative control in a world that is known."""
    starts = []

    def rollout(env, policy, steps, *, seed, options):
        starts.append(options["random_start"])
        return toy.new_trial(policy, env.arm, env.cloth, steps, seed)

    for name, instead in {
        "trained": lambda name: world.learned,
        "ClothEnv": FakeTable,
        "rollout": rollout,
        "recorded_runs": lambda learned: world.runs,
    }.items():
        monkeypatch.setattr(iterative_control, name, instead)
    recorded = [
        toy.random_trial("torque", name, 60, k) for k, name in enumerate(CLOTHS)
    ]
    world.runs = [world.learned.to_run(trial) for trial in recorded]
    world.starts = starts
    return world


def test_of_every_controller_the_distance_in_a_known_world_is_known(in_the_toy):
    in_the_toy.aim = np.array([0.3, -0.9, 0.0])
    best = {}
    for name in iterative_control.CONTROLLERS:
        if name == iterative_control.STARTS:
            in_the_toy.trials = [toy.random_trial("torque", LIGHT, 60, 0)]
        row = iterative_control._run_one(
            name, "right", "all", "torque", "target-1", LIGHT, 0, 0, 32
        )
        best[name] = row["best"]
        assert row["still"] == pytest.approx(np.linalg.norm(in_the_toy.aim), abs=PIXEL)
    assert in_the_toy.starts == [False] * 5
    run = next(run for run in in_the_toy.runs if run.material == LIGHT)
    recorded = np.linalg.norm(run.s[8:, :3] - in_the_toy.aim, axis=1).min()
    assert best[iterative_control.REPLAY].max() <= recorded + PIXEL
    for name in (iterative_control.PAPERS, iterative_control.STARTS):
        assert best[name].max() < 0.06
    assert best[iterative_control.ITERATIVE].max() < 0.06
    chance = toy.new_trial(
        iterative_control.RandomPolicy("torque"), "torque", LIGHT, 32, 20_000
    )
    autoencoder, mask = in_the_toy.learned.autoencoder, toy.image_of(in_the_toy.aim)
    by_chance = best_per_period(target_distance(autoencoder, chance, mask))
    assert best[iterative_control.RANDOM] == pytest.approx(by_chance, abs=1e-4)


@pytest.mark.slow
def test_a_run_begins_with_the_p_that_its_row_names(in_the_toy, monkeypatch):
    told = Told(np.tile(get_arm("torque").home_command, (32, 1)))
    monkeypatch.setitem(iterative_control.CONTROLLERS, "told", told)
    for p in ("right", "wrong"):
        iterative_control._run_one(
            "told", p, "all", "torque", "target-1", LIGHT, 0, 1, 32
        )
    assert in_the_toy.starts == [True] * 2
    wanted = np.array([toy.bias_of(LIGHT), toy.bias_of(HEAVY)])
    assert np.array(told.given) == pytest.approx(wanted)


# What there is to know


def test_information_is_that_of_a_linear_sensor(monkeypatch):
    """z = S x + noise, so that F is the sum of Sᵀ Σ⁻¹ S; joints say nothing."""
    steps, deviations = 200, np.array([0.1, 0.2, 0.4])
    slopes = np.random.default_rng(0).normal(size=(steps + 1, 3, 2))

    class Scene(FakeTable):
        def hold(self, cloth):
            self.cloth = cloth

    def rollout(env, policy, count, seed):
        x = np.log([env.cloth.damping, env.cloth.mass])
        noise = np.random.default_rng(100 + seed).normal(size=(count, 3)) * deviations
        return SimpleNamespace(images=slopes @ x + noise, robot=np.zeros((count, 4)))

    nothing = SimpleNamespace(autoencoder=None)
    unknown = identifiability.Noise(np.diag([4.0, 4.0, 4.0]))
    for name, instead in {
        "ClothEnv": Scene,
        "rollout": rollout,
        "encode": lambda autoencoder, images: images,
        "trained": lambda name: nothing,
        "_prediction_noise": lambda: unknown,
    }.items():
        monkeypatch.setattr(identifiability, name, instead)
    row = identifiability._run_one("damp0.05-mass0.10", "random", 3, steps)
    assert row["noise"] == pytest.approx(deviations, rel=0.1)
    seen = slopes[1:]  # the first look is before the first command
    by_network = np.cumsum(np.einsum("tdp,tdq->tpq", seen, seen) / 4, axis=0)
    index = np.round(row["time"] / 0.2).astype(int) - 1
    assert row[identifiability.PREDICTED] == pytest.approx(by_network[index], abs=2e-3)
    scaled = seen / deviations[:, None]
    alone = np.einsum("tdp,tdq->pq", scaled, scaled)
    assert row["z"][-1] == pytest.approx(alone, rel=0.15, abs=0.05 * alone.max())
    assert np.abs(row["joints"]).max() == 0


def test_the_border_is_where_laying_and_throwing_stop_working(monkeypatch):
    """A cloth is spread by margins from 0.12 to 0.14 m, and by the throws 7, 8 and 9."""
    tried = SimpleNamespace(works=False)

    class Table(FakeTable):
        def start(self, seed):
            tried.works = False

        def advance(self, u):
            pass

        def cloth_pose(self):
            return SimpleNamespace(spread=tried.works)

    class Throw:
        def __init__(self, arm):
            pass

        def reset(self, seed):
            tried.works = seed - table_setting.FIRST_SEED in (7, 8, 9)

        def __call__(self, observation):
            return None

    def lay(driver, margin):
        tried.works = 0.119 < margin < 0.141

    for name, instead in {
        "TableEnv": Table,
        "OperatorThrow": Throw,
        "RobotDriver": lambda env, samples: None,
        "lay_slowly": lay,
    }.items():
        monkeypatch.setattr(table_setting, name, instead)
    row = table_setting._run_border("hard-1", 0.3)
    right = [0.119 < margin < 0.141 for margin in table_setting.MARGINS]
    assert row["slow"].all(axis=1).tolist() == right
    assert 0 < sum(right) < len(right)
    assert np.flatnonzero(row["thrown"]).tolist() == [7, 8, 9]
    assert row["best_slow"].all()
    assert row["best_thrown"].all()
    assert row["best_thrown"].shape == row["best_slow"].shape == (20,)


def swings(delay=0.0, period=1.6, depth=1.0, samples=400):
    """Joint angles [samples, 2] of an arm in swing, its shoulder so much later [s]."""
    seconds = np.arange(samples) * 0.02
    turns = 2 * np.pi * np.stack([seconds - delay, seconds], axis=1) / period
    return depth * np.sin(turns)


@pytest.mark.parametrize("delay", [-0.1, 0.0, 0.06, 0.2])
def test_the_delay_of_the_shoulder_is_found(delay):
    assert stiffness._delay_of_shoulder(swings(delay)) == pytest.approx(delay)
    assert stiffness._delay_of_shoulder(np.ones((400, 2))) == 0


def test_an_arm_in_swing_comes_down_in_a_third_of_its_period_however_wide():
    # The range of a sine is 2, and its highest speed 2 pi / T
    for depth in (0.2, 1.0):
        times = stiffness._lowering_times(swings(depth=depth))
        assert times == pytest.approx(np.full(4, 1.6 / np.pi), rel=0.01)


def test_the_fall_of_tension_begins_where_the_shoulder_is_highest():
    shoulder = np.tile([0.5, 0.2, -0.4, -0.9, 0.0, 0.4, 0.8, 1.0], 3)
    tension = np.tile([10, 20, 40, 60, 50, 40, 30, 15], 3)
    commands = np.stack([shoulder, 0 * shoulder, tension], axis=1)
    assert list(stiffness._falls_of_tension(commands)) == [45, 45]
