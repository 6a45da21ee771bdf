"""What is exported computes what Python computes, in onnxruntime, without PyTorch."""

import inspect

import numpy as np
import pytest
import torch

from clothlab import data
from clothlab._extras import bring
from clothlab.method._traced import traced
from clothlab.method.cloth_task import control_loss, period_mask
from clothlab.method.control import (
    Controller,
    ControlSettings,
    GradientSearch,
    optimise_commands,
)
from clothlab.method.gauss_newton import Linearisation
from clothlab.method.model import DPMPB, Memory
from clothlab.method.onnx_export import (
    export_estimation,
    export_onnx,
    export_prediction,
    export_solve,
)

RECORDED = 40  # solves of the cloth's controller
SMALL = ControlSettings(horizon=2, candidates=3, iterations=2)


@pytest.fixture(scope="module")
def onnxruntime():
    for package in ("onnx", "onnxscript"):
        pytest.importorskip(package)
    return pytest.importorskip("onnxruntime")


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    made = DPMPB(2, 1, bias_size=1).eval().requires_grad_(False)
    made.s_std.mul_(3)
    made.u_mean.add_(0.5)
    return made


@pytest.fixture
def run(onnxruntime, tmp_path):
    """A graph as a function: of arrays by name, to arrays by name."""

    def loaded(path):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        session = onnxruntime.InferenceSession(path, options)
        names = [each.name for each in session.get_outputs()]

        def call(**inputs):
            arrays = {name: np.asarray(each) for name, each in inputs.items()}
            return dict(zip(names, session.run(None, arrays), strict=True))

        call.inputs = {each.name: each.shape for each in session.get_inputs()}
        return call

    return loaded


class Residual(DPMPB):
    """A network of one's own: it predicts the change."""

    def forward(self, s, u, p, memory=None):
        change, memory = super().forward(s, u, p, memory)
        return s + 0.1 * change, memory


@pytest.mark.slow
@pytest.mark.parametrize("kind", [DPMPB, Residual])
def test_predictions_are_the_models(kind, run, tmp_path):
    torch.manual_seed(1)
    model = kind(2, 1, bias_size=1).eval().requires_grad_(False)
    export_prediction(tmp_path / "h.onnx", model, batch=3, steps=2)
    exported = run(tmp_path / "h.onnx")
    s = torch.randn(3, 2, 2)
    u = torch.randn(3, 2, 1)
    p = torch.randn(1)
    h = torch.randn(2, 3, 30)
    c = torch.randn(2, 3, 30)
    expected, memory = model(s, u, p, Memory(h, c))
    found = exported(s=s, u=u, p=p, h=h, c=c)
    assert found["next_s"] == pytest.approx(expected.numpy(), abs=1e-5)
    assert found["next_h"] == pytest.approx(memory.h.numpy(), abs=1e-5)
    assert found["next_c"] == pytest.approx(memory.c.numpy(), abs=1e-5)


def test_no_step_of_a_window_is_left_out_unless_it_is_told():
    named = inspect.signature(export_estimation).parameters
    assert named["warmup"].default == 0


@pytest.mark.slow
def test_a_window_of_any_length_is_linearised(model, run, tmp_path):
    export_estimation(tmp_path / "window.onnx", model, warmup=3)
    exported = run(tmp_path / "window.onnx")
    for length in (9, 40):
        torch.manual_seed(length)
        s = torch.randn(length, 2)
        u = torch.randn(length, 1)
        p = torch.randn(1)
        expected = Linearisation.of(model, s, u, p.numpy(), 3)
        found = exported(s=s, u=u, p=p)
        assert found["errors"].shape == (length - 4, 2)
        assert found["errors"] == pytest.approx(expected.errors, abs=1e-5)
        assert found["jacobian"] == pytest.approx(expected.jacobian, abs=1e-4)
        step = Linearisation(found["errors"], found["jacobian"]).step()
        assert step == pytest.approx(expected.step(), rel=1e-2)


@pytest.mark.slow
def test_a_solve_has_its_gradients(model, run, tmp_path):
    def loss(states, commands, t):
        # It depends on the control step, on states and on commands.
        wanted = torch.sin(torch.as_tensor(0.3 * t))
        return (states[..., 0] - wanted).square().sum(-1) + 0.1 * commands.norm(dim=1)[
            :, 0
        ]

    controller = Controller(model, loss, [0.0], [-1], [1], SMALL)
    export_solve(tmp_path / "solve.onnx", controller)
    exported = run(tmp_path / "solve.onnx")
    assert list(exported.inputs) == ["s", "u", "p", "h", "c", "t"]
    torch.manual_seed(2)
    for t in (0, 5):
        s = torch.randn(2)
        u = 2 * torch.rand(2, 1) - 1
        p = torch.randn(1)
        memory = Memory(torch.randn(2, 1, 30), torch.randn(2, 1, 30))
        controller.set_bias(p)
        rollout = controller.problem(s).rollout
        plan, trace = optimise_commands(
            lambda plans, at=t, s=s, memory=memory, rollout=rollout: loss(
                rollout(s, plans, memory), plans, at
            ),
            u,
            controller.limits,
            SMALL,
        )
        found = exported(s=s, u=u, h=memory.h, c=memory.c, p=p, t=np.int64(t))
        assert found["plan"] == pytest.approx(plan.numpy(), abs=1e-5)
        assert found["losses"] == pytest.approx(trace, abs=1e-5)
        assert trace[-1] < trace[0]


@pytest.mark.nightly
def test_a_network_of_ones_own_is_solved_with_as_itself(run, tmp_path):
    torch.manual_seed(3)
    model = Residual(2, 1, bias_size=1).eval().requires_grad_(False)

    def loss(states, commands, goal):
        return (states - goal).square().sum((1, 2))

    settings = ControlSettings(horizon=2, candidates=3, iterations=1)
    controller = Controller(model, loss, [0.2], [-1], [1], settings)
    export_solve(
        tmp_path / "solve.onnx", controller, loss=loss, inputs={"goal": torch.zeros(2)}
    )
    exported = run(tmp_path / "solve.onnx")
    problem = controller.problem([0.3, -0.1])
    goal = torch.tensor([2.0, 1.0])
    plan, _ = optimise_commands(
        lambda plans: loss(problem.predict(plans), plans, goal),
        problem.plan,
        controller.limits,
        settings,
    )
    found = exported(
        s=problem.s,
        u=problem.plan,
        h=problem.memory.h,
        c=problem.memory.c,
        p=problem.p,
        goal=goal,
    )
    assert found["plan"] == pytest.approx(plan.numpy(), abs=1e-5)
    assert np.abs(found["plan"]).max() > 1e-3


@pytest.mark.slow
def test_what_is_called_like_an_input_inside_does_not_take_its_place(run, tmp_path):
    weight = torch.randn(3, 2)
    export_onnx(
        tmp_path / "any.onnx",
        lambda t, x: (x @ weight.t()).mul(t),
        {"t": torch.ones(()), "x": torch.ones(1, 2)},
        ["mul"],
        gradients=True,
    )
    x = torch.randn(1, 2)
    found = run(tmp_path / "any.onnx")(t=np.float32(2), x=x)
    assert found["mul"] == pytest.approx(2 * (x @ weight.T).numpy(), abs=1e-6)


def test_a_loss_that_leaves_pytorch_is_refused(onnxruntime, model, tmp_path):
    def loss(states, commands, t):
        return (states[..., 0] - [0.1, 0.2, 0.3][t]).square().sum(-1)

    controller = Controller(model, loss, [0.0], [-1], [1], SMALL)
    with pytest.raises(ValueError, match="make what depends on t an input: loss="):
        export_solve(tmp_path / "solve.onnx", controller)
    assert list(tmp_path.iterdir()) == []


def test_only_the_papers_search_is_exported(onnxruntime, model, tmp_path):
    class Other:
        name = "other"

        def begin(self, home, settings, learned=None):
            return None

        def __call__(self, problem, learned):
            raise NotImplementedError

    controller = Controller(
        model, lambda s, u, t: s.sum((1, 2)), [0.0], [-1], [1], SMALL, search=Other()
    )
    with pytest.raises(ValueError, match="search is a GradientSearch, got Other"):
        export_solve(tmp_path / "solve.onnx", controller)


@pytest.mark.filterwarnings("ignore:TF32 acceleration")
def test_slopes_of_a_gradient_are_computed_together():
    """Each gradient has its own; numbers are those of the function itself."""
    weight = torch.tensor([[0.3, -0.5], [0.7, 0.2]])

    def loss(u):
        x = (u @ weight).sigmoid()
        x = torch.cat([x @ weight, x @ weight.T], 1).tanh()
        return (x @ x.T).sigmoid().sum()

    def twice(u):
        for _ in range(2):
            u = u.detach().requires_grad_()
            (gradient,) = torch.autograd.grad(loss(u), u)
            u = u - gradient
        return u

    u = torch.tensor([[0.4, -1.0]])
    single = traced(twice, (u,))
    assert torch.equal(single(u), twice(u))
    called = [str(node.target) for node in single.graph.nodes]
    assert not any("sigmoid_backward" in name for name in called)
    assert not any("tanh_backward" in name for name in called)
    # Of each gradient two: those of σ, and that of tanh.
    assert sum(node.target == "split" for node in single.graph.nodes) == 4


def test_gradients_and_free_dimensions_do_not_go_together(onnxruntime, tmp_path):
    with pytest.raises(ValueError, match="has no free dimensions"):
        export_onnx(
            tmp_path / "x.onnx",
            torch.square,
            {"x": torch.ones(2)},
            ["y"],
            free={"x": [0]},
            gradients=True,
        )


def test_a_missing_package_says_which_extra_brings_it():
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'clothlab\[onnx\]'"):
        bring("export_onnx", "no_such_package.inside", "onnx")


def recorded_solves(learned, settings):
    """Inputs of solves as they come: states of recorded trials, memories before them."""
    rng = np.random.default_rng(0)
    runs = [learned.to_run(trial) for trial in data.load_trials("evaluation")[:3]]
    biases = list(learned.biases.values())
    for k in range(RECORDED):
        run = runs[k % len(runs)]
        t = int(rng.integers(20, len(run.s) - 10))
        p = torch.as_tensor(biases[rng.integers(len(biases))])
        before = slice(t - 10, t)
        _, memory = learned.model(
            torch.as_tensor(run.s[None, before]),
            torch.as_tensor(run.u[None, before]),
            p,
        )
        yield {
            "s": torch.as_tensor(run.s[t]),
            "u": torch.as_tensor(run.u[t : t + settings.horizon]),
            "h": memory.h,
            "c": memory.c,
            "p": p,
            "mask": torch.as_tensor(period_mask(t, settings)),
        }


@pytest.mark.nightly
def test_forty_recorded_solves_of_the_cloth_agree(run, tmp_path):
    learned = data.load("torque-0")
    mask = data.load_target("target-1")
    policy = learned.controller(mask, next(iter(learned.biases)))
    controller = policy.controller
    settings = controller.settings
    tensions = policy.layout.tensions
    z_ref = policy.loss.z_ref

    def loss(states, commands, z_ref, mask):
        weight = settings.tension_weight
        return control_loss(states, z_ref, mask, tensions, weight)

    wanted = {"z_ref": z_ref, "mask": torch.ones(settings.horizon)}
    export_solve(tmp_path / "solve.onnx", controller, loss=loss, inputs=wanted)
    exported = run(tmp_path / "solve.onnx")
    gaps = []
    ties = []
    for case in recorded_solves(learned, settings):
        controller.set_bias(case["p"])
        rollout = controller.problem(case["s"]).rollout

        def of_plans(plans, case=case, rollout=rollout):
            memory = Memory(case["h"], case["c"])
            states = rollout(case["s"], plans, memory)
            return loss(states, plans, z_ref, case["mask"])

        plan, _ = optimise_commands(of_plans, case["u"], controller.limits, settings)
        found = exported(**case, z_ref=z_ref)
        gap = np.abs(found["plan"] - plan.numpy()).max()
        # Of two steps that are as good but for rounding, either may be taken.
        ours, theirs = of_plans(torch.stack([plan, torch.as_tensor(found["plan"])]))
        tie = gap > 1e-4 and abs(ours - theirs) < 1e-5 * ours
        ties.append(bool(tie))
        gaps.append(0 if tie else gap)
    print(f"largest gap of {len(gaps)} plans: {max(gaps):.2g} rad; ties: {sum(ties)}")
    assert len(gaps) == RECORDED
    assert max(gaps) <= 1e-4
    assert sum(ties) <= 2
    assert isinstance(controller.search, GradientSearch)
