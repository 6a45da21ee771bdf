"""A function with gradients inside as a list of single operations, for the export."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, fx


def traced(function: Callable[..., Any], examples: tuple[Tensor, ...]) -> Any:
    """The function as single operations, those of its gradients among them."""
    from torch.fx.experimental.proxy_tensor import make_fx  # takes a second

    found = make_fx(function)(*examples)
    _derive_at_once(found.graph)
    found.recompile()
    return found


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
    return _output(backward).meta["tensor_meta"].shape
