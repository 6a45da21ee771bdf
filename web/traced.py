"""A function of tensors as a list of single operations, for the export."""

from collections.abc import Callable, Mapping
from operator import getitem
from typing import Any

import torch
from torch import Tensor, fx
from torch.fx.node import map_aggregate
from torch.utils._python_dispatch import TorchDispatchMode

_ATEN = torch.ops.aten
_ARITHMETIC = (_ATEN.add, _ATEN.sub, _ATEN.mul, _ATEN.div, _ATEN.sum)
# Operations that are to be taken apart, and how
Decompositions = Mapping[Any, Callable[..., Any]]


def traced(
    function: Callable[..., Any],
    examples: tuple[Tensor, ...],
    decompositions: Decompositions,
) -> fx.Graph:
    """The function as single operations, those of its gradients among them."""
    # Gradients are taken apart only when their slopes are known
    found = _recorded(function, examples, {})
    _derive_at_once(found.graph)
    found.recompile()
    return _recorded(found, examples, decompositions).graph


def _recorded(
    function: Callable[..., Any],
    examples: tuple[Tensor, ...],
    decompositions: Decompositions,
) -> fx.GraphModule:
    recorder = _Recorder(examples, decompositions)
    with recorder:
        found = function(*examples)
    recorder.graph.output(map_aggregate(found, recorder.node))
    return fx.GraphModule(recorder.constants, recorder.graph)


class _Recorder(TorchDispatchMode):
    """Writes down what is computed of examples, and of constants that these meet.

    It runs the operations themselves, where `make_fx` takes ten times as long.
    """

    def __init__(self, examples: tuple[Tensor, ...], decompositions: Decompositions):
        super().__init__()
        self.graph = fx.Graph()
        self.constants: dict[str, Tensor] = {}
        self._decompositions = decompositions
        # By identity, which only holds while a tensor lives
        self._known: dict[int, tuple[Tensor, fx.Node]] = {}
        for k, example in enumerate(examples):
            self._know(example, self.graph.placeholder(f"input_{k}"))

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        """Compute what is asked for, and write it down."""
        given = (args, kwargs or {})
        depends: list[bool] = []
        _each_tensor(given, lambda each: depends.append(id(each) in self._known))
        if any(depends) and func in self._decompositions:
            with self:
                return self._decompositions[func](*args, **given[1])
        result = func(*args, **given[1])
        if not any(depends):
            return result

        # ONNX does not calculate with truths, or with numbers of several kinds
        if func.overloadpacket in _ARITHMETIC:
            given = _each_tensor(given, lambda each: self._as(each, result.dtype))
        if func._schema.is_mutable:
            func = self._out_of_place(func, result)
        nodes = map_aggregate(given, self.node)
        self._know(result, self.graph.call_function(func, *nodes))
        return result

    def _as(self, tensor: Tensor, kind: torch.dtype) -> Tensor:
        with self:
            same = tensor.dtype == kind
            return tensor if same else _ATEN._to_copy.default(tensor, dtype=kind)

    def _out_of_place(self, func: Any, changed: Tensor) -> Any:
        """The same operation on a new tensor, if nothing else sees the change."""
        memory = changed.untyped_storage().data_ptr()
        known = [each for each, _ in self._known.values()]
        seen = [each for each in known if each.untyped_storage().data_ptr() == memory]
        assert [id(each) for each in seen] == [id(changed)], func
        name = func._schema.name.removeprefix("aten::").removesuffix("_")
        return getattr(getattr(_ATEN, name), func._overloadname)

    def _know(self, result: Any, node: fx.Node) -> None:
        """Remember which node computes a tensor, or several."""
        node.meta["val"] = result
        if isinstance(result, Tensor):
            self._known[id(result)] = (result, node)
            return
        for k, each in enumerate(result):
            self._know(each, self.graph.call_function(getitem, (node, k)))

    def node(self, value: Any) -> Any:
        """The node that computes a tensor; a value that is none remains."""
        if not isinstance(value, Tensor):
            return value
        if id(value) not in self._known:
            name = f"constant_{len(self.constants)}"
            self.constants[name] = value
            self._know(value, self.graph.get_attr(name))
        return self._known[id(value)][1]


def _each_tensor(given: Any, change: Callable[[Tensor], Any]) -> Any:
    """Arguments of an operation, with something else for each tensor."""
    return map_aggregate(
        given, lambda each: change(each) if isinstance(each, Tensor) else each
    )


def _derive_at_once(graph: fx.Graph) -> None:
    """Compute the slopes of all σ and tanh of a gradient in one go.

    A gradient asks for y (1 - y) of each σ, and for 1 - y² of each tanh, layer by layer
    and step by step. That is hundreds of tiny operations, and calling one takes longer
    than what it computes. But all y are known before the gradient begins.
    """
    slopes: dict[Any, Callable[[Any], Any]] = {
        torch.ops.aten.sigmoid_backward.default: lambda y: y * (1 - y),
        torch.ops.aten.tanh_backward.default: lambda y: 1 - y * y,
    }
    for backward, slope in slopes.items():
        for nodes in _by_gradient(graph, backward):
            # All y side by side, where the first is asked for.
            outputs = [_output(node) for node in nodes]
            sizes = [_shape(node)[-1] for node in nodes]
            with graph.inserting_before(nodes[0]):
                beside = graph.call_function(torch.cat, (outputs, -1))
                parts = slope(fx.Proxy(beside)).split(sizes, -1)

            # Each node was a product of what comes back and the slope.
            node: Any
            for k, node in enumerate(nodes):
                with graph.inserting_before(node):
                    product = fx.Proxy(node.args[0]) * parts[k]
                node.replace_all_uses_with(product.node)
                graph.erase_node(node)


def _by_gradient(graph: fx.Graph, backward: Any) -> list[list[fx.Node]]:
    """The nodes that go back through a function, those of one gradient together.

    Together are those whose y is known before the first of them, and is as long.
    """
    place = {node: k for k, node in enumerate(graph.nodes)}
    gradients: list[list[fx.Node]] = []
    for node in graph.find_nodes(op="call_function", target=backward):
        first = gradients[-1][0] if gradients else node
        known = place[_output(node)] < place[first]
        if first is not node and known and _shape(node)[:-1] == _shape(first)[:-1]:
            gradients[-1].append(node)
        else:
            gradients.append([node])
    return gradients


def _output(backward: fx.Node) -> fx.Node:
    """The y of what such a node goes back through, where it was computed."""
    y: Any = backward.args[1]
    while y.target is torch.ops.aten.detach.default:
        y = y.args[0]
    return y


def _shape(backward: fx.Node) -> torch.Size:
    return _output(backward).meta["val"].shape
