"""The method without PyTorch: prediction, estimation and control as ONNX graphs.

A robot's computer, a web page or a program in another language need no PyTorch to run
what was trained: they need onnxruntime. What is exported are the functions that Python
itself runs, with their gradients, so that there is no second controller to be kept
equal. `pip install 'clothlab[onnx]'` brings what is needed to export and to run.

How to use the three graphs together in a loop is shown in `docs/your_own_robot.md`.
"""

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from clothlab._extras import bring
from clothlab._files import write_bytes
from clothlab._validation import check_kind, check_number
from clothlab.method._inputs import check_model
from clothlab.method._rollouts import rollout_of
from clothlab.method._traced import traced
from clothlab.method.control import Controller, GradientSearch, descend
from clothlab.method.gauss_newton import around_bias
from clothlab.method.model import DPMPB, Memory

_EXTRA = "onnx"
# The pass that merges equal weights leaves large ones alone, unless it is told so.
_ANY_SIZE = 2**31


def export_onnx(
    path: str | Path,
    function: Callable[..., Any],
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    *,
    free: Mapping[str, Sequence[int]] | None = None,
    gradients: bool = False,
) -> None:
    """Write any function of tensors as an ONNX graph; the others here go through it.

    Args:
        path: of the file.
        function: takes the inputs in this order, and returns a tensor or several.
        inputs: an example of each, by name. Their shapes are those of the graph.
        outputs: names of what is returned.
        free: which dimensions of an input may have another length, `{"s": [0]}`. They
            share one length, or differ by a constant, as the function has it.
        gradients: whether the function takes gradients inside. Then its loops are
            unrolled, and no dimension can be free.
    """
    for package in ("onnxscript", "onnx_ir", "onnx"):
        bring("export_onnx", package, _EXTRA)
    if gradients and free:
        raise ValueError("a function with gradients inside has no free dimensions")

    # Follow the function once; then write down what it did. Of a tensor that came in
    # twice, such as a first memory of zeros, it would take one for the other.
    examples = tuple(each.detach().clone() for each in inputs.values())
    with _quietly():
        exported = traced(function, examples) if gradients else function
        program = torch.onnx.export(
            _Graph(exported),
            examples,
            dynamo=True,
            dynamic_shapes=(_shapes(inputs, free),) if free else None,
            optimize=False,  # a third of the time; onnxruntime has its own
            verbose=False,
        )
        assert program is not None
        _simplify(program.model, {*inputs, *outputs})
    _name(program.model.graph.inputs, inputs)
    _name(program.model.graph.outputs, outputs)
    if free:
        _forget_shapes(program.model)
    write_bytes(path, program.model_proto.SerializeToString())


def export_prediction(
    path: str | Path, model: DPMPB, *, batch: int = 1, steps: int = 1
) -> None:
    """Write h, which predicts the next states (eq. 1), and moves the memory on.

    Inputs are states `s` `[B, T, D_s]`, commands `u` `[B, T, D_u]`, one `p` `[D_p]`,
    and the memory before, `h` and `c` `[2, B, 30]`; outputs are `next_s` `[B, T, D_s]`,
    `next_h` and `next_c`. As in training, each next state is predicted from the one
    that was seen before it. A network with another memory has inputs of its names.

    Args:
        path: of the file.
        model: a trained DPMPB, or a network of your own.
        batch: B.
        steps: T.
    """
    check_model(model)
    batch = check_number("batch", batch, int, at_least=1)
    steps = check_number("steps", steps, int, at_least=1)
    memory = model.initial_memory()

    def predicted(
        s: Tensor, u: Tensor, p: Tensor, *parts: Tensor
    ) -> tuple[Tensor, ...]:
        following, after = model(s, u, p, Memory(*parts))
        return following, *after

    # The shapes of what goes in, and the names of what comes out.
    inputs = {
        "s": model.s_mean.new_zeros(batch, steps, model.state_size),
        "u": model.s_mean.new_zeros(batch, steps, model.command_size),
        "p": model.s_mean.new_zeros(model.bias_size),
    }
    before = _named(memory)
    for name, part in before.items():
        inputs[name] = part.repeat_interleave(batch, dim=1)
    outputs = ["next_s", *(f"next_{name}" for name in before)]
    with torch.no_grad():
        export_onnx(path, predicted, inputs, outputs)


def export_estimation(path: str | Path, model: DPMPB, *, warmup: int = 0) -> None:
    """Write how one p predicts a window, and what a small change of p would do.

    Inputs are a window of states `s` `[T + 1, D_s]` and commands `u` `[T + 1, D_u]`, of
    any length, and `p` `[D_p]`. Outputs are the `errors` `[T, D_s]` and their
    `jacobian` `[T, D_s, D_p]`, those of `Linearisation`, in double precision. The step
    of p is the least squares of the two, in which all steps and states stand below each
    other: `numpy.linalg.lstsq(jacobian.reshape(-1, D_p), errors.ravel())[0]`; or
    `Linearisation(errors, jacobian).step()`, in which outliers count little.

    Args:
        path: of the file.
        model: a trained DPMPB, or a network of your own, with D_p of at least 1.
        warmup: first steps, which only fill the memory and are left out.
    """
    check_model(model)
    check_number("bias_size", model.bias_size, int, at_least=1)
    warmup = check_number("warmup", warmup, int, at_least=0)

    def linearised(s: Tensor, u: Tensor, p: Tensor) -> tuple[Tensor, Tensor]:
        return around_bias(model, s, u, p.double(), warmup)

    length = warmup + 30
    inputs = {
        "s": model.s_mean.new_zeros(length, model.state_size),
        "u": model.s_mean.new_zeros(length, model.command_size),
        "p": model.s_mean.new_zeros(model.bias_size),
    }
    free = {"s": [0], "u": [0]}
    export_onnx(path, linearised, inputs, ["errors", "jacobian"], free=free)


def export_solve(
    path: str | Path,
    controller: Controller,
    *,
    loss: Callable[..., Tensor] | None = None,
    inputs: Mapping[str, Tensor] | None = None,
) -> None:
    """Write a whole solve of a controller, with its gradients.

    The graph's inputs are the state `s` `[D_s]`, the plan to begin with `u`
    `[T, D_u]`, `p` `[D_p]` and the memory before, `h` and `c` `[2, 1, 30]`; then the
    control step `t` (a whole number), or the named inputs of a loss of yours. Its
    outputs are the `plan` `[T, D_u]` and the `losses` `[iterations + 1]` on the way.
    Horizon, step sizes and iterations are fixed in the graph, as the limits are.

    Args:
        path: of the file.
        controller: whose solve it is. Its search is the paper's; recorded starts stay
            behind, and the best of them goes in as `u`.
        loss: `loss(states, commands, **inputs)`, `[B]`, in place of the controller's.
            A goal that moves is an input, and what depends on the control step, too.
        inputs: an example of each input of that loss, by name.
    """
    check_kind("controller", controller, Controller)
    check_kind("the controller's search", controller.search, GradientSearch)
    rollout = rollout_of(controller.model)
    more = {"t": torch.tensor(0)} if loss is None else dict(inputs or {})

    # Any state and plan will do as an example, as long as their loss has a gradient.
    problem = controller.problem(controller.model.s_mean)
    memory = _named(problem.memory)
    example = {"s": problem.s, "u": problem.plan, "p": torch.as_tensor(problem.p)}

    def solve(s: Tensor, u: Tensor, p: Tensor, *rest: Tensor) -> tuple[Tensor, Tensor]:
        predict = rollout(controller.model, p)
        parts = rest[: len(memory)]
        named = dict(zip(more, rest[len(memory) :], strict=True))

        def loss_of_plans(plans: Tensor) -> Tensor:
            states = predict(s, plans, Memory(*parts))
            if loss is None:
                return controller.loss(states, plans, named["t"])  # type: ignore
            return loss(states, plans, **named)

        return descend(loss_of_plans, u, controller.limits, controller.settings)

    # All that goes in, in one order.
    inputs = example | memory | more
    export_onnx(path, solve, inputs, ["plan", "losses"], gradients=True)


def _named(memory: tuple[Tensor, ...]) -> dict[str, Tensor]:
    """The parts of a memory by their names; those without one are counted."""
    names = getattr(memory, "_fields", [f"memory_{k}" for k in range(len(memory))])
    return dict(zip(names, memory, strict=True))


class _Graph(nn.Module):
    """A function as the module that the exporter asks for."""

    def __init__(self, function: Callable[..., Any]):
        super().__init__()
        self.function = function

    def forward(self, *inputs: Tensor) -> Any:
        return self.function(*inputs)


def _shapes(
    inputs: Mapping[str, Tensor], free: Mapping[str, Sequence[int]]
) -> tuple[dict[int, Any] | None, ...]:
    """Which dimensions of each input the exporter leaves open."""
    return tuple(
        dict.fromkeys(free[name], torch.export.Dim.AUTO) if name in free else None
        for name in inputs
    )


def _simplify(model: Any, names: set[str]) -> None:
    """Take out what is there twice or not needed; names are for inputs and outputs."""
    optimizer = bring("export_onnx", "onnxscript.optimizer", _EXTRA)
    passes = bring("export_onnx", "onnx_ir.passes.common", _EXTRA)
    optimizer.inline(model)
    optimizer.fold_constants(model)
    optimizer.remove_unused_nodes(model)

    # The weights are in it once for each use, and much is computed twice.
    _clear_names(model, names)
    passes.DeduplicateInitializersPass(_ANY_SIZE)(model)
    passes.CommonSubexpressionEliminationPass()(model)
    passes.ClearMetadataAndDocStringPass()(model)


def _clear_names(model: Any, wanted: set[str]) -> None:
    """Rename what is called like an input or output, as a transposed weight is "t"."""
    graph = model.graph
    values = [*graph.inputs, *graph.initializers.values()]
    values += [value for node in graph for value in node.outputs]
    for value in values:
        if value.name in wanted:
            value.name = f"inner_{value.name}"


def _name(values: Sequence[Any], names: Iterable[str]) -> None:
    """Name the inputs of a graph, or its outputs."""
    for value, name in zip(values, names, strict=True):
        value.name = name


def _forget_shapes(model: Any) -> None:
    """Take out the shapes of all that is computed: an LSTM claims the example's."""
    for node in model.graph:
        for value in node.outputs:
            value.shape = None


@contextmanager
def _quietly() -> Iterator[None]:
    """The exporter warns of its own parts, which is no news to who exports."""
    loggers = [
        logging.getLogger(name) for name in ("torch.onnx", "onnxscript", "onnx_ir")
    ]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
