"""Recognise a multilayer perceptron in an ONNX graph."""

import numpy as np
from numpy.typing import NDArray

from ....formats.core.errors import FileFormatError, brief
from .network import ACTIVATIONS, Layer, Mlp
from .onnx_file import Node, OnnxFile

Array = NDArray[np.float64]

# Slopes below zero, where an activation has one.
_ALPHAS = {"Elu": 1.0, "LeakyRelu": 0.01}
MAX_WIDTH = 8192
_KINDS = (*ACTIVATIONS, "Add", "Sub", "Mul", "Div", "Gemm", "MatMul")


class NotAnMlpError(FileFormatError):
    """A graph that is more than layers one after the other."""


def read_mlp(file: OnnxFile) -> Mlp:
    """Return the layers between the graph's one input and its one output.

    Products and sums with constants that follow each other, as a normaliser before the first layer
    does, are joined into one layer.

    Args:
        file: with one input of fixed width and one output.

    Raises:
        FileFormatError: weights that are damaged, or of sizes that do not fit.
        NotAnMlpError: another graph, and what is in the way.
    """
    if not file.inputs or not file.outputs:
        raise FileFormatError(file.path, "its graph has no input or no output")
    value, width = file.inputs[0].name, (None, *file.inputs[0].shape)[-1]
    if not isinstance(width, int):
        raise FileFormatError(file.path, f"the width of input {file.inputs[0]} is not fixed")
    if not 1 <= width <= MAX_WIDTH:
        raise FileFormatError(
            file.path, f"input {file.inputs[0]} is {width:,} wide; valid: 1 to {MAX_WIDTH:,}"
        )
    known = {value, *(node.output for node in file.nodes)}
    layers: list[Layer] = []
    weight, bias = np.eye(width), np.zeros(width)
    for node in file.nodes:
        if node.kind not in _KINDS:
            raise NotAnMlpError(
                file.path, f"operator {brief(node.kind)}; known: {', '.join(_KINDS)}"
            )
        for name in node.inputs:
            if name not in known and not file.is_constant(name):
                raise FileFormatError(
                    file.path, f"{node.kind} takes {name!r}, which nothing in the file defines"
                )
        constants = [name for name in node.inputs if file.is_constant(name)]
        if len(node.inputs) - len(constants) != 1 or value not in node.inputs:
            raise NotAnMlpError(file.path, f"{node.kind} of more than the value before it")
        if not constants and node.kind not in ACTIVATIONS:
            raise FileFormatError(file.path, f"{node.kind} without a constant")
        if node.kind in ACTIVATIONS:
            if node.kind != "Identity":
                alpha = node.attributes.get("alpha", _ALPHAS.get(node.kind, 0.0))
                layers.append(Layer(weight, bias, node.kind, alpha))
                weight, bias = np.eye(len(bias)), np.zeros(len(bias))
        elif node.inputs[0] != value and node.kind != "Add" and node.kind != "Mul":
            raise NotAnMlpError(file.path, f"{node.kind} of a constant first")
        elif node.kind in ("Gemm", "MatMul"):
            factor, added = _product(file, node, constants, len(bias))
            weight, bias = factor @ weight, factor @ bias + added
        else:
            scale, added = _elementwise(file, node, constants[0], len(bias))
            weight, bias = scale[:, None] * weight, scale * bias + added
        value = node.output
    if value != file.outputs[0].name:
        raise NotAnMlpError(
            file.path, f"its last layer gives {value!r}, which is not the output of the graph"
        )
    if file.outputs[0].shape[-1:] != (len(bias),):
        raise FileFormatError(
            file.path,
            f"its output is declared as {file.outputs[0]}, but its layers give {len(bias)} numbers",
        )
    return Mlp([*layers, Layer(weight, bias)])


def _product(file: OnnxFile, node: Node, constants: list[str], width: int) -> tuple[Array, Array]:
    """Return the matrix (outputs, width) and what is added (outputs,) of a Gemm or MatMul."""
    factor = file.constant(constants[0])
    if factor.ndim != 2 or node.attributes.get("transA"):
        raise NotAnMlpError(file.path, f"{node.kind} with {constants[0]!r} is not part of a layer")
    # ONNX multiplies rows: x W. A Gemm may have stored W the other way round.
    if not node.attributes.get("transB"):
        factor = factor.T
    if len(factor) > MAX_WIDTH:
        raise FileFormatError(
            file.path,
            f"weights {constants[0]!r} give {len(factor):,} numbers; valid: {MAX_WIDTH:,}",
        )
    if factor.shape[1] != width:
        raise FileFormatError(
            file.path, f"weights {constants[0]!r} take {factor.shape[1]} numbers, given {width}"
        )
    added = np.zeros(len(factor))
    if len(constants) > 1:
        added = node.attributes.get("beta", 1.0) * _row(file, constants[1], len(factor))
    return node.attributes.get("alpha", 1.0) * factor, added


def _elementwise(file: OnnxFile, node: Node, name: str, width: int) -> tuple[Array, Array]:
    """Return the factors and what is added, both (width,), of a sum or product with a constant."""
    row, ones, zeros = _row(file, name, width), np.ones(width), np.zeros(width)
    if node.kind == "Add":
        return ones, row
    if node.kind == "Sub":
        return ones, -row
    if node.kind == "Mul":
        return row, zeros
    if not row.all():
        raise FileFormatError(file.path, f"Div by {name!r}, which contains a zero")
    return 1.0 / row, zeros


def _row(file: OnnxFile, name: str, width: int) -> Array:
    """Return a constant of one number or one row, as a row."""
    values = file.constant(name)
    if values.size != 1 and not values.size == values.shape[-1] == width:
        shape = "×".join(map(str, values.shape))
        raise FileFormatError(file.path, f"{name!r} is {shape}; valid: {width} in a row, or one")
    return np.broadcast_to(values.ravel(), width)
