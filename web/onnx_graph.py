"""Functions of tensors as ONNX graphs, which onnxruntime runs in a browser.

What is exported is a function that Python runs, with its gradients.
"""

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import onnx_ir as ir
import onnx_ir.passes.common as passes
import torch
from onnxscript import optimizer
from torch import Tensor, nn

from web.traced import traced

# The pass that merges equal weights leaves large ones alone, unless it is told so.
_ANY_SIZE = 2**31


def graph(
    function: Callable[..., Any],
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    *,
    free: Mapping[str, Sequence[int]] | None = None,
) -> bytes:
    """A function as an ONNX graph, whose shapes are those of an example.

    Args:
        function: takes the inputs in this order, and returns a tensor or several.
        inputs: an example of each, by name.
        outputs: names of what is returned.
        free: which dimensions of an input may have another length, `{"s": [0]}`. Then
            torch's exporter follows the function, which takes ten times as long and
            knows no gradients; else loops are unrolled.
    """
    # Of a tensor that came in twice, such as a first memory of zeros, it would take one
    # for the other.
    examples = tuple(each.detach().clone() for each in inputs.values())
    with _quietly():
        if free is None:
            model = _translated(function, examples)
        else:
            model = _exported(function, examples, _shapes(inputs, free))
        _simplify(model, {*inputs, *outputs})
    _name(model.graph.inputs, inputs)
    _name(model.graph.outputs, outputs)
    if free:
        _forget_shapes(model)
    written: bytes = ir.to_proto(model).SerializeToString()
    return written


def _translated(function: Callable[..., Any], examples: tuple[Tensor, ...]) -> Any:
    """A function as a model, by the last step of torch's exporter alone.

    The steps before it would trace the function three times, each time more slowly.
    """
    from torch.onnx._internal.exporter import _core, _ir_passes

    registry, decompositions = _translations()
    model = ir.Model(ir.Graph([], [], nodes=[], name="graph"), ir_version=10)
    _core._translate_fx_graph(
        traced(function, examples, decompositions),
        model,
        graph_like=model.graph,
        owned_graphs={},
        lower="at_conversion",
        registry=registry,
    )
    _ir_passes.add_opset_imports(model)
    return model


@cache
def _translations() -> tuple[Any, Any]:
    """What the exporter can translate, and how it takes apart what it cannot."""
    from torch.onnx._internal.exporter import _decomp, _registration

    registry = _registration.ONNXRegistry.from_torchlib()
    known = set(_decomp.get_onnx_implemented_overloads(registry))
    return registry, _decomp.create_onnx_friendly_decomposition_table(known)


def _exported(
    function: Callable[..., Any], examples: tuple[Tensor, ...], shapes: Any
) -> Any:
    """A function as a model, by the whole of torch's exporter."""
    program = torch.onnx.export(
        _Graph(function),
        examples,
        dynamo=True,
        dynamic_shapes=(shapes,),
        optimize=False,  # a third of the time; onnxruntime has its own
        verbose=False,
    )
    assert program is not None
    return program.model


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
    for node in graph:
        node.name = None  # a tenth of the size
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
