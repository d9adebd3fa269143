"""A small multilayer perceptron in compiled code: what a gait's network is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float32]

# What follows a layer's sum; `Elu` and `LeakyRelu` have a slope `alpha` below zero.
ACTIVATIONS = ("Identity", "Elu", "Relu", "LeakyRelu", "Tanh", "Sigmoid")


class Network(Protocol):
    """Interface of what turns observations into actions.

    Attributes:
        inputs: width of an observation.
        outputs: width of an action.
    """

    inputs: int
    outputs: int

    def run(self, observation: Array, action: Array) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs); both float32, C order."""
        ...


@dataclass(frozen=True)
class Layer:
    """`activation(weight @ x + bias)`.

    Attributes:
        weight: (outputs, inputs) float64.
        bias: (outputs,) float64.
        activation: one of `ACTIVATIONS`.
        alpha: its slope below zero, where it has one.
    """

    weight: NDArray[np.float64]
    bias: NDArray[np.float64]
    activation: str = "Identity"
    alpha: float = 1.0


class Mlp:
    """Layers one after the other, computed in float32 without a library's cost per call.

    A row of weights is only read from its first to its last number that is not zero, which halves
    the work for a network that stands beside its mirror image.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        """Get ready.

        Args:
            layers: each takes what the one before it gives.
        """
        self.inputs, self.outputs = layers[0].weight.shape[1], layers[-1].weight.shape[0]
        weights = [layer.weight.astype(np.float32) for layer in layers]
        self._sizes = np.array([self.inputs, *(len(weight) for weight in weights)])
        self._spans = np.concatenate([_spans(weight) for weight in weights])
        self._weights = np.concatenate([weight.ravel() for weight in weights])
        self._biases = np.concatenate([layer.bias for layer in layers]).astype(np.float32)
        self._kinds = np.array([ACTIVATIONS.index(layer.activation) for layer in layers])
        self._alphas = np.array([layer.alpha for layer in layers], dtype=np.float32)
        self._work = np.zeros((2, 1, self._sizes.max()), dtype=np.float32)

    def run(self, observation: Array, action: Array) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs); both float32, C order."""
        if len(observation) > self._work.shape[1]:
            self._work = np.zeros((2, len(observation), self._sizes.max()), dtype=np.float32)
        _run(
            observation,
            self._sizes,
            self._spans,
            self._weights,
            self._biases,
            self._kinds,
            self._alphas,
            self._work,
            action,
        )


def _spans(weight: Array) -> NDArray[np.int64]:
    """Return the first and end (outputs, 2) of the columns of each row that are not zero."""
    used = weight != 0
    first = np.where(used.any(axis=1), used.argmax(axis=1), 0)
    end = np.where(used.any(axis=1), weight.shape[1] - used[:, ::-1].argmax(axis=1), 0)
    return np.column_stack([first, end]).astype(np.int64)


# The order of a sum is left to the compiler, which then adds several numbers at once.
@njit(cache=True, fastmath={"reassoc", "nsz", "contract"})
def _run(seen, sizes, spans, weights, biases, kinds, alphas, work, action):
    one, zero = np.float32(1.0), np.float32(0.0)
    count = seen.shape[0]
    here, there = work[0], work[1]
    here[:count, : sizes[0]] = seen
    row, start = 0, 0
    for layer in range(len(kinds)):
        kind, alpha = kinds[layer], alphas[layer]
        for j in range(sizes[layer + 1]):
            first, end = spans[row, 0], spans[row, 1]
            factors, bias = weights[start + first : start + end], biases[row]
            for n in range(count):
                values, total = here[n, first:end], zero
                # Indices that count from zero are what the compiler makes vectors of.
                for i in range(len(factors)):
                    total += factors[i] * values[i]
                total += bias
                if kind == 1:
                    total = total if total > zero else alpha * (np.exp(total) - one)
                elif kind == 2:
                    total = max(total, zero)
                elif kind == 3:
                    total = total if total > zero else alpha * total
                elif kind == 4:
                    total = np.tanh(total)
                elif kind == 5:
                    total = one / (one + np.exp(-total))
                there[n, j] = total
            row += 1
            start += sizes[layer]
        here, there = there, here
    action[:] = here[:count, : action.shape[1]]
