"""Functions of tensors as ONNX graphs, which onnxruntime runs in a browser.

What is exported is a function that Python runs, with its gradients.
"""

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

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
    gradients: bool = False,
) -> bytes:
    """A function as an ONNX graph, whose shapes are those of an example.

    Args:
        function: takes the inputs in this order, and returns a tensor or several.
        inputs: an example of each, by name.
        outputs: names of what is returned.
        free: which dimensions of an input may have another length, `{"s": [0]}`.
        gradients: whether the function takes gradients inside. Then its loops are
            unrolled, and no dimension can be free.
    """
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
    written: bytes = program.model_proto.SerializeToString()
    return written


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
