"""A gait's network: a small multilayer perceptron in compiled code, read from safetensors."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from ....formats.core.arrays import F32, I64, Floats
from ....formats.core.errors import FileFormatError, brief
from ....formats.process.kernel import kernel

Layers = tuple[list[F32], list[F32]]

MAX_WIDTH = 8192


class Network(Protocol):
    """Interface of what turns observations into actions.

    Attributes:
        inputs: width of an observation.
        outputs: width of an action.
    """

    inputs: int
    outputs: int

    def run(self, observation: F32, action: F32) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs); both float32, C order."""
        ...


def encode_layers(weights: Sequence[Floats], biases: Sequence[Floats]) -> bytes:
    """Return layers as a safetensors file: `weight_0` (outputs, inputs), `bias_0`, and so on."""
    layers = enumerate(zip(weights, biases, strict=True))
    return save(
        {
            f"{kind}_{k}": np.ascontiguousarray(values, dtype=np.float32)
            for k, pair in layers
            for kind, values in zip(("weight", "bias"), pair, strict=True)
        }
    )


def decode_layers(path: Path, content: bytes) -> Layers:
    """Return the weights and biases in a file of `encode_layers`; `path` is for errors.

    Raises:
        FileFormatError: no safetensors, or tensors that are not the layers of one network.
    """
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, ValueError) as error:
        raise FileFormatError(path, f"not a safetensors file: {brief(error)}") from error
    count = max(1, len(tensors) // 2)
    names = [f"{kind}_{k}" for k in range(count) for kind in ("weight", "bias")]
    if sorted(tensors) != sorted(names):
        raise FileFormatError(
            path, f"its tensors are {brief(sorted(tensors))}; valid: weight_0, bias_0, weight_1, …"
        )
    weights, biases = ([tensors[name] for name in names[at::2]] for at in (0, 1))
    for k, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        sizes = weight.ndim == 2 and bias.shape == weight.shape[:1] and min(weight.shape) >= 1
        if not sizes or max(weight.shape) > MAX_WIDTH:
            raise FileFormatError(
                path,
                f"weight_{k} is {weight.shape} and bias_{k} {bias.shape}; valid: "
                f"(outputs, inputs) and (outputs,), up to {MAX_WIDTH:,}",
            )
        if {weight.dtype, bias.dtype} != {np.dtype(np.float32)}:
            raise FileFormatError(path, f"layer {k} holds {weight.dtype}; valid: float32")
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise FileFormatError(path, f"layer {k} holds numbers that are not finite")
    for k, (first, second) in enumerate(pairwise(weights), start=1):
        if second.shape[1] != len(first):
            raise FileFormatError(
                path,
                f"weight_{k} takes {second.shape[1]} numbers, given {len(first)}",
            )
    return weights, biases


class Mlp:
    """Linear layers with ELU between them, computed in float32 without a library's cost per call.

    The order of every sum is fixed (the bias, then one input after the other), so that any program
    with float32 gets the same bits: `examples/gait_loop.py` is one. Blocks of weights that are
    zero are skipped, which halves the work for a network that stands beside its mirror image.
    """

    def __init__(self, weights: Sequence[F32], biases: Sequence[F32]) -> None:
        """Prepare layers of weights (outputs, inputs) and biases (outputs,)."""
        self.inputs, self.outputs = weights[0].shape[1], weights[-1].shape[0]
        self._sizes = np.array([self.inputs, *(len(weight) for weight in weights)])
        columns = [
            np.pad(weight.T, ((0, -weight.shape[1] % _GROUP), (0, 0))).reshape(
                -1, _GROUP, len(weight)
            )
            for weight in weights
        ]
        self._spans = np.concatenate([_spans(groups) for groups in columns])
        self._weights = np.concatenate([groups.ravel() for groups in columns])
        self._biases = np.concatenate(biases)
        self._work = self._rows(1)

    def _rows(self, count: int) -> F32:
        """Return memory for the values of two layers, a group wider than the widest."""
        return np.zeros((2, count, self._sizes.max() + _GROUP), dtype=np.float32)

    def run(self, observation: F32, action: F32) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs); both float32, C order."""
        if len(observation) > self._work.shape[1]:
            self._work = self._rows(len(observation))
        _run(observation, self._sizes, self._spans, self._weights, self._biases, self._work, action)


_GROUP = 4  # inputs whose weights are read together; `_run` is written for so many


def _spans(groups: F32) -> I64:
    """Return the first and end (K, 2) of the outputs that K groups of inputs contribute to."""
    used = (groups != 0).any(axis=1)
    first = np.where(used.any(axis=1), used.argmax(axis=1), 0)
    end = np.where(used.any(axis=1), used.shape[1] - used[:, ::-1].argmax(axis=1), 0)
    return np.column_stack([first, end]).astype(np.int64)


@kernel(3)
def _run(seen, sizes, spans, weights, biases, work, action):
    zero = np.float32(0.0)
    count = seen.shape[0]
    here, there = work[0], work[1]
    for n in range(count):
        for i in range(here.shape[1]):
            here[n, i] = seen[n, i] if i < sizes[0] else zero
    group, start, bias, last = 0, 0, 0, len(sizes) - 2
    for layer in range(last + 1):
        width = sizes[layer + 1]
        for n in range(count):
            for j in range(there.shape[1]):
                there[n, j] = biases[bias + j] if j < width else zero
        for i in range(0, sizes[layer], 4):
            first, end = spans[group, 0], spans[group, 1]
            a = weights[start + first : start + end]
            b = weights[start + width + first : start + width + end]
            c = weights[start + 2 * width + first : start + 2 * width + end]
            d = weights[start + 3 * width + first : start + 3 * width + end]
            for n in range(count):
                p, q, r, s = here[n, i], here[n, i + 1], here[n, i + 2], here[n, i + 3]
                total = there[n, first:end]
                for j in range(len(total)):
                    total[j] = (((total[j] + a[j] * p) + b[j] * q) + c[j] * r) + d[j] * s
            group += 1
            start += 4 * width
        if layer < last:
            for n in range(count):
                for j in range(width):
                    # In double precision, where libraries' exponentials agree after rounding.
                    if there[n, j] < zero:
                        there[n, j] = np.float32(np.exp(np.float64(there[n, j])) - 1.0)
        bias += width
        here, there = there, here
    for n in range(count):
        for j in range(action.shape[1]):
            action[n, j] = here[n, j]
