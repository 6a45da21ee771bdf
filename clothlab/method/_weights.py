"""Files of weights: named tensors in safetensors' format, and what is said of them.

What is said is JSON under the one key "clothlab". No pickle: reading a file runs no
code that came with it.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor, nn

from clothlab._files import OtherKindError, reading

FORMAT = 1
SUFFIX = ".safetensors"

_M = TypeVar("_M", bound=nn.Module)


def packed(kind: str, about: dict[str, Any], tensors: Mapping[str, Tensor]) -> bytes:
    """The content of a file of this kind.

    A ValueError for numbers that are not finite, and for words that are not JSON.
    """
    _check_numbers(tensors)
    said = {"format": FORMAT, "kind": kind, **about}
    try:
        text = json.dumps(said, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"what is said of weights is plain data: {error}") from None
    return to_bytes(
        {name: tensor.contiguous() for name, tensor in tensors.items()},
        metadata={"clothlab": text},
    )


def unpacked(
    path: Path, kind: str, title: str
) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """What a file of this kind says, and its tensors.

    Errors call it by its title. It is a ValueError if the file is damaged, and an
    `OtherKindError` if it is whole, but of another kind or version.
    """
    with reading(path, title):
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            names = list(file.keys())
            tensors = {name: file.get_tensor(name) for name in names}

        # What it is comes before what is in it.
        if "clothlab" not in metadata:
            raise OtherKindError("clothlab did not write it")
        about = json.loads(metadata["clothlab"])
        if about["format"] != FORMAT:
            raise OtherKindError(
                f"its format is {about['format']}, this version reads {FORMAT}"
            )
        if about["kind"] != kind:
            raise OtherKindError(f"it holds {about['kind']} weights")

        _check_numbers(tensors)
    return about, tensors


def filled(network: _M, tensors: Mapping[str, Tensor]) -> _M:
    """A network with weights from a file, to be used and not trained."""
    # What was saved in double precision stays so.
    for tensor in tensors.values():
        if tensor.is_floating_point():
            network.to(tensor.dtype)
            break
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise OtherKindError(
            f"its layers are not those of {type(network).__name__}: {reason:.200}"
        ) from None
    return network.eval().requires_grad_(False)


def check_suffix(path: Path) -> None:
    """A ValueError for a name that no file of weights has."""
    if path.suffix != SUFFIX:
        raise ValueError(f"a checkpoint's file ends in {SUFFIX}, got {str(path)!r}")


def above(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same tensors, their names after a prefix."""
    return {prefix + name: tensor for name, tensor in tensors.items()}


def below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors after whose prefix a network's own names stand."""
    return {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }


def named_biases(materials: list[str], p: Tensor) -> dict[str, np.ndarray]:
    """p of each material by its name, from one row each `[K, D_p]`."""
    return dict(zip(materials, p.numpy(), strict=True))


def _check_numbers(tensors: Mapping[str, Tensor]) -> None:
    """Refuse numbers with which a network would compute nonsense, in silence."""
    for name, tensor in tensors.items():
        if not torch.isfinite(tensor).all():
            raise ValueError(f"numbers of {name} are not finite")
        if name.endswith("_std") and not (tensor > 0).all():
            raise ValueError(f"standard deviations {name} are not all above 0")
