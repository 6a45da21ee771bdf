"""What must hold whatever the numbers are: changes that would fool a reader break it.

Of each, a small change of the code is in mind that leaves everything running: a command
early, two axes swapped, a seed that nobody uses, a look at what is to come.
"""

from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
import torch

from clothlab import analysis
from clothlab.lab.map import Plane
from clothlab.method.autoencoder import (
    Autoencoder,
    AutoencoderTraining,
    encode,
    train_autoencoder,
)
from clothlab.method.control import Controller, ControlSettings
from clothlab.method.data import Run
from clothlab.method.estimation import estimate_bias, prediction_loss
from clothlab.method.iterative import nearest_plans
from clothlab.method.model import DPMPB
from clothlab.method.rollout import Policy, rollout
from clothlab.method.training import ModelTraining, train_dpmpb
from clothlab.policies import OperatorPolicy, RandomPolicy
from clothlab.simulation.arm import ARMS, get_arm
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.rendering import onlooker
from clothlab.simulation.stiffness import static_posture, stiffness_ellipse
from clothlab.simulation.vision import cloth_mask
from clothlab.trials import to_run
from studies import held_out

BRIEF = ModelTraining(epochs=1, batch_size=10_000, sequence_length=10)


def random_run(seed: int, name: str, scale: float = 1.0, steps: int = 60) -> Run:
    rng = np.random.default_rng(seed)
    s, u = rng.normal(size=(steps, 3)), rng.normal(size=(steps, 2))
    return Run(scale * s + scale, scale * u - scale, name)


RUNS = [random_run(0, "b"), random_run(1, "a", 3.0), random_run(2, "b", 0.5)]


# Recordings


def test_a_command_stands_beside_the_state_in_which_it_was_sent(trial):
    run = to_run(Autoencoder().eval(), trial)
    assert np.array_equal(run.u, np.float32(trial.commands))
    assert np.array_equal(run.s[:, 3:], np.float32(trial.robot))


def test_what_was_sent_in_a_step_moves_the_arm_in_that_step(env):
    rest, away = env.arm.home_command, env.arm.home_command - [0.4, 0.4]
    sent = iter([rest, rest, away, away, away])
    moved = np.abs(np.diff(rollout(env, lambda _: next(sent), 5).robot, axis=0))
    assert moved[:2].max() < 0.02 < 0.1 < moved[2].max()


def test_a_policy_and_its_environment_get_the_seed_of_a_rollout(env):
    class Noting(Policy):
        def reset(self, seed=0):
            self.seed = seed

        def __call__(self, observation):
            return env.arm.home_command

    policy, random = Noting(), {"random_start": True}
    starts = [
        rollout(env, policy, 1, seed=seed, options=random).robot[0]
        for seed in (7, 7, 8)
    ]
    assert policy.seed == 8
    assert np.array_equal(*starts[:2])
    assert not np.allclose(*starts[1:], atol=1e-2)


@pytest.mark.parametrize("kind", [RandomPolicy, OperatorPolicy])
def test_another_seed_gives_other_commands(kind):
    policy, found = kind("muscle"), []
    for seed in (1, 2):
        policy.reset(seed)
        found.append([policy({}) for _ in range(10)])
    assert (np.ptp(found, axis=0).max(axis=0) > 0).all()  # each number of u


@pytest.mark.parametrize("beyond", [-1.1, 1.1])
def test_a_command_beyond_either_limit_is_noticed(beyond):
    class Still(gymnasium.Env):
        action_space = gymnasium.spaces.Box(-1, 1, (1,))

        def reset(self, *, seed=None, options=None):
            return np.zeros(1), {}

        def step(self, u):
            return np.zeros(1), 0.0, False, False, {}

    with pytest.warns(UserWarning, match="beyond the limits"):
        rollout(Still(), lambda s: [beyond], 2, material="any")


# Training


def test_p_moves_by_its_own_rate_and_the_weights_by_theirs():
    """The first step of Adam is as long as the rate, whatever the gradient."""
    settings = replace(BRIEF, learning_rate=1e-3, bias_learning_rate=5e-2)
    _, biases, _ = train_dpmpb(RUNS, settings, progress=False)
    still = replace(settings, learning_rate=0.0)
    model, biases_alone, _ = train_dpmpb(RUNS, still, progress=False)
    for p in (*biases.values(), *biases_alone.values()):
        assert np.abs(p) == pytest.approx([5e-2, 5e-2], rel=1e-2)
    frozen = replace(settings, bias_learning_rate=0.0)
    trained, biases, _ = train_dpmpb(RUNS, frozen, progress=False)
    assert not np.any([*biases.values()])
    gap = trained.fc_out[0].weight - model.fc_out[0].weight
    assert gap.abs().max().item() == pytest.approx(1e-3, rel=1e-2)


def test_normalisation_is_that_of_all_training_runs_and_of_no_others():
    model, _, _ = train_dpmpb(RUNS, BRIEF, progress=False)
    for name in ("s", "u"):
        values = np.concatenate([getattr(run, name) for run in RUNS])
        assert getattr(model, f"{name}_mean").numpy() == pytest.approx(values.mean(0))
        expected = values.std(0, ddof=1)
        assert getattr(model, f"{name}_std").numpy() == pytest.approx(expected)


def test_each_material_keeps_its_own_p_whatever_the_order_of_the_runs():
    known = {"a": np.float32([0.5, 0.1]), "b": np.float32([-0.5, 0.2])}
    for runs in (RUNS, RUNS[::-1]):
        _, biases, _ = train_dpmpb(runs, BRIEF, known=known, progress=False)
        assert list(biases) == list(dict.fromkeys(run.material for run in runs))
        assert all(np.array_equal(biases[name], known[name]) for name in known)


def test_an_error_counts_by_the_deviation_of_its_sensor(untrained):
    generator = torch.Generator().manual_seed(0)
    s, errors = torch.randn(2, 4, 5, 3, generator=generator)
    expected = errors.square().mean()
    for unit in (1.0, 1000.0):
        untrained.s_std.copy_(torch.tensor([unit, 1.0, 1 / unit]))
        loss = untrained.loss((s + errors) * untrained.s_std, s * untrained.s_std)
        torch.testing.assert_close(loss, expected)
    untrained.s_std.fill_(1)


def test_another_seed_gives_another_training():
    first, same, other = (
        train_dpmpb(RUNS, BRIEF, seed=seed, progress=False)[2] for seed in (0, 0, 1)
    )
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_the_loss_of_an_autoencoder_is_the_mean_of_its_batches():
    """Bits that nobody can guess, seen by a network that does not learn: ln 2 each.

    Of 20 images, those that fill no batch wait for another epoch.
    """
    images = np.random.default_rng(0).random((20, 96, 128)) > 0.5
    still = AutoencoderTraining(epochs=2, batch_size=8, learning_rate=0.0)
    _, losses = train_autoencoder(images, still, progress=False)
    assert losses == pytest.approx([np.log(2)] * 2, abs=0.15)
    _, others = train_autoencoder(images, still, seed=1, progress=False)
    assert losses[0] != others[0]


def test_held_out_runs_are_judged_and_not_learned_from(monkeypatch):
    """Each is told by a material's runs: those learned from, those only looked at."""
    asked = {held_out.RECORDINGS["torque"]: 1.0, held_out.EVALUATION["torque"]: 100.0}
    assert len(asked) == 2
    made = {name: [random_run(0, "a", scale)] for name, scale in asked.items()}
    monkeypatch.setattr(held_out, "_runs", made.__getitem__)
    monkeypatch.setattr(held_out, "_errors_ahead", lambda *given: given[-1][0].s)
    row = held_out._train_one("p", seed=0, updates=10)
    assert (row["held_out"] > 100 * row["training"]).all()
    assert row["error"] == pytest.approx(
        made[held_out.EVALUATION["torque"]][0].s.mean(0), rel=1e-4
    )


# Estimation and control


@pytest.fixture(scope="module")
def untrained() -> DPMPB:
    torch.manual_seed(0)
    return DPMPB(3, 2).eval().requires_grad_(False)


def test_several_p_are_judged_as_each_alone(untrained):
    s, u = torch.as_tensor(RUNS[0].s), torch.as_tensor(RUNS[0].u)
    several = torch.tensor([[0.1, 0.2], [3.0, -1.0], [0.0, 0.0]])
    together = prediction_loss(untrained, s, u, several)
    alone = torch.stack([prediction_loss(untrained, s, u, p) for p in several])
    torch.testing.assert_close(together, alone)
    assert alone.unique().numel() == 3


@pytest.mark.parametrize("method", ["sgd", "newton"])
def test_an_estimate_knows_nothing_of_what_is_to_come(untrained, method):
    run, seen = RUNS[0], 30
    changed = run.s.copy()
    changed[seen:] += 1.0
    _, path = estimate_bias(untrained, run, method=method)
    _, other = estimate_bias(untrained, replace(run, s=changed), method=method)
    assert np.array_equal(path[:seen], other[:seen])
    assert not np.array_equal(path[seen:], other[seen:])


def test_only_a_period_s_first_plan_may_start_from_recorded_ones(untrained):
    asked = []

    def loss(states, commands, t):
        asked.append((t, len(commands)))
        return states.square().sum((1, 2))

    plans = np.random.default_rng(0).uniform(-1, 1, (50, 8, 2))
    controller = Controller(untrained, loss, [0, 0], [-1, -1], [1, 1], plans=plans)
    for s in RUNS[0].s[:17]:
        controller.act(s)
    assert {t for t, count in asked if count == 51} == {0, 8, 16}


def test_step_sizes_are_as_many_as_candidates_from_none_to_the_largest():
    settings = ControlSettings()
    sizes = settings.step_sizes().numpy()
    assert len(sizes) == settings.candidates == 30
    assert sizes[0] == 0
    assert sizes[[1, -1]] == pytest.approx([1e-3, 1.0])
    assert sizes[2:] / sizes[1:-1] == pytest.approx(sizes[2] / sizes[1])


def test_no_two_recorded_plans_of_a_run_overlap_by_more_than_half():
    rng = np.random.default_rng(0)
    u = np.arange(200.0)[:, None] * [1, 1]
    for _ in range(5):
        smooth = np.cumsum(rng.normal(size=(200, 3)), axis=0)  # near ones lie together
        found = nearest_plans([Run(smooth, u, "a")], [0, 0, 0], horizon=8, count=20)
        starts = np.sort(found.u[:, 0, 0])
        assert np.diff(starts).min() >= 4
        best = np.linalg.norm(smooth[8:], axis=1).argmin()
        assert found.u[0, 0, 0] == best


def test_an_image_has_its_z_whatever_it_is_encoded_with():
    images = np.random.default_rng(0).random((5, 96, 128)) > 0.5
    model = Autoencoder().eval()
    together = encode(model, images)
    alone = [encode(model, image) for image in images]
    assert together == pytest.approx(np.array(alone), abs=1e-5)


def test_a_distance_is_to_the_target_that_is_named(trial):
    model = Autoencoder().eval()
    model.encoder[-1].running_var.fill_(1e-4)
    distance = analysis.target_distance(model, trial, trial.images[-1])
    assert distance[-1] == pytest.approx(0, abs=1e-4)
    assert distance[0] > 1e-3


# Axes and places


def test_the_map_of_p_has_the_axis_of_most_variance_across():
    biases = {name: np.array(p) for name, p in zip("abcd", SQUARE, strict=True)}
    plane = Plane(biases, {})
    across, up = np.transpose([dot["at"] for dot in plane.map["dots"]])
    assert np.ptp(across) == pytest.approx(6)
    assert np.ptp(up) == pytest.approx(2)
    assert [axis[:3] for axis in plane.map["axes"]] == ["PC1", "PC2"]
    for name, p in biases.items():
        assert plane.p(plane.at(p)) == pytest.approx(p), name

    # A region that is long in the direction of most variance is long across
    edge = np.array(plane.region(np.zeros(2), np.diag([0.01, 1.0])))
    assert np.ptp(edge[:, 0]) > 5 * np.ptp(edge[:, 1])


SQUARE = [(1.0, 3.0), (1.0, -3.0), (-1.0, 3.0), (-1.0, -3.0)]


@pytest.mark.slow
def test_the_ellipse_is_how_the_hand_gives_way_forward_then_up():
    arm = get_arm("muscle")
    theta, f = np.array([0.5, -1.2]), 30.0
    found = stiffness_ellipse(arm, theta, f, directions=4)
    for k, push in enumerate(([1, 0], [0, 1])):
        pushed = static_posture(arm, [*theta, f], push)
        expected = arm.hand(pushed) - arm.hand(theta)
        assert found[k] == pytest.approx(expected, abs=2e-4)
    assert not np.allclose(found[0], found[1][::-1], atol=2e-4)


def test_names_of_a_state_are_counted_from_one_as_they_lie():
    names = get_arm("torque").layout(3).names
    assert names[:3] == ("z1 [s.d.]", "z2 [s.d.]", "z3 [s.d.]")
    assert [name.split()[0] for name in names[3:]] == ["θ", "θ", "θ'", "θ'"]
    assert ["shoulder" in name for name in names[3:]] == [True, False] * 2


@pytest.mark.parametrize("arm", ["torque", "muscle"])
def test_an_arm_has_stops_and_a_bar_in_its_middle_and_nothing_touches(arm):
    model = ClothEnv(arm, "hard-1" if arm == "muscle" else "damp0.05-mass0.10").model
    arm = ARMS[arm]
    for k, joint in enumerate(("shoulder", "elbow")):
        assert model.joint(joint).limited[0]
        stops = [arm.lower[k] - arm.stop_margin, arm.upper[k] + arm.stop_margin]
        assert model.joint(joint).range == pytest.approx(stops)
    (bar,) = np.flatnonzero(
        (model.geom_bodyid == model.body("hand").id)
        & (model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE)
    )
    assert model.geom_pos[bar] == pytest.approx(np.zeros(3), abs=1e-9)
    assert model.geom_size[bar, 1] == pytest.approx(arm.bar_length / 2)
    moving = model.body_weldid[model.geom_bodyid] > 0
    assert not model.geom_contype[moving].any()
    assert not model.geom_conaffinity[moving].any()


def test_people_look_from_beside_where_the_arm_s_camera_stands_too_near():
    assert onlooker(get_arm("torque")) == "camera"
    assert isinstance(onlooker(get_arm("muscle")), mujoco.MjvCamera)


def test_a_picture_has_the_type_of_a_camera_s():
    with pytest.raises(ValueError, match=r"of uint8, got .* float64"):
        cloth_mask(np.zeros((96, 128, 3)))
