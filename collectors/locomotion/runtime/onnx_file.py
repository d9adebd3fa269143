"""Parse an ONNX file with Protobuf alone: nodes, weights, inputs and outputs.

Field and type numbers: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto. Only what
a plain chain of layers needs is known here; a Protobuf reader skips the rest.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from ....formats.core.errors import FileFormatError, brief

# Message → field → (number, type). A `*` marks a repeated field; capitals are messages from here.
_MESSAGES: Mapping[str, Mapping[str, tuple[int, str]]] = {
    "Model": {"graph": (7, "Graph")},
    "Graph": {
        "node": (1, "Node*"),
        "initializer": (5, "Tensor*"),
        "input": (11, "Value*"),
        "output": (12, "Value*"),
    },
    "Node": {
        "input": (1, "string*"),
        "output": (2, "string*"),
        "op_type": (4, "string"),
        "attribute": (5, "Attribute*"),
        "domain": (7, "string"),
    },
    "Attribute": {
        "name": (1, "string"),
        "f": (2, "float"),
        "i": (3, "int64"),
        "t": (5, "Tensor"),
        "g": (6, "Graph"),
        "tensors": (10, "Tensor*"),
        "graphs": (11, "Graph*"),
    },
    "Tensor": {
        "dims": (1, "int64*"),
        "data_type": (2, "int32"),
        "float_data": (4, "float*"),
        "name": (8, "string"),
        "raw_data": (9, "bytes"),
        "data_location": (14, "int32"),
    },
    "Value": {"name": (1, "string"), "type": (2, "Type")},
    "Type": {"tensor_type": (1, "TensorType")},
    "TensorType": {"elem_type": (1, "int32"), "shape": (2, "Shape")},
    "Shape": {"dim": (1, "Dimension*")},
    "Dimension": {"dim_value": (1, "int64"), "dim_param": (2, "string")},
}
_FLOAT, _EXTERNAL = 1, 1
_ENDLESS = ("Loop",)


@dataclass(frozen=True)
class Port:
    """An input or output of a graph.

    Attributes:
        name: of the value.
        is_float: whether it holds float32.
        shape: its dimensions; a free one is given by its name.
    """

    name: str
    is_float: bool
    shape: tuple[int | str, ...]

    def __str__(self) -> str:
        kind = "float" if self.is_float else "other"
        return f"{brief(self.name)} tensor({kind}) {brief(list(self.shape))}"


@dataclass(frozen=True)
class Node:
    """One operation of a graph.

    Attributes:
        kind: the operator, with its domain where it is not ONNX's own.
        inputs, output: names of values.
        attributes: numbers by name.
    """

    kind: str
    inputs: tuple[str, ...]
    output: str
    attributes: Mapping[str, float]


class OnnxFile:
    """What an ONNX file holds.

    Attributes:
        path: of the file, for messages.
        inputs, outputs: what the graph takes and gives.
        nodes: its operations in order, without constants.
    """

    def __init__(self, path: Path, content: bytes) -> None:
        """Parse `content`.

        Raises:
            FileFormatError: no ONNX, or weights that lie in another file.
        """
        model = _message_class("Model")()
        try:
            model.ParseFromString(content)
        except DecodeError as error:
            raise FileFormatError(path, "not an ONNX file") from error
        if not model.graph.node:
            raise FileFormatError(path, "not an ONNX file: it holds no graph")
        self.path = path
        self._check_graph(model.graph)
        self._tensors = {tensor.name: tensor for tensor in model.graph.initializer}
        nodes = []
        for node in model.graph.node:
            tensors = [a.t for a in node.attribute if a.name == "value" and a.HasField("t")]
            if node.op_type == "Constant" and tensors and node.output:
                self._tensors[node.output[0]] = tensors[0]
            else:
                nodes.append(_node(node))
        self.nodes = tuple(nodes)
        # Old files list their weights among the inputs.
        self.inputs = [_port(v) for v in model.graph.input if v.name not in self._tensors]
        self.outputs = [_port(v) for v in model.graph.output]

    def _check_graph(self, graph: Any) -> None:
        """Refuse, at any depth, weights in another file, endless loops and wild attributes."""
        tensors = list(graph.initializer)
        for node in graph.node:
            if node.op_type in _ENDLESS:
                raise FileFormatError(
                    self.path,
                    f"operator {node.op_type} is not supported, as it may never end; unroll it",
                )
            for attribute in node.attribute:
                if not math.isfinite(attribute.f):
                    raise FileFormatError(
                        self.path,
                        f"{brief(node.op_type)}: {brief(attribute.name)} is {attribute.f}",
                    )
                tensors += [attribute.t, *attribute.tensors]
                for inner in (attribute.g, *attribute.graphs):
                    if inner.ByteSize():
                        self._check_graph(inner)
        for tensor in tensors:
            if tensor.data_location == _EXTERNAL:
                raise FileFormatError(
                    self.path,
                    f"weights {brief(tensor.name)} are in another file; store them in this one",
                )

    def is_constant(self, name: str) -> bool:
        """Return whether `constant` knows it."""
        return name in self._tensors

    def constant(self, name: str) -> NDArray[np.float64]:
        """Return weights or another constant by name.

        Raises:
            FileFormatError: not float32, damaged, or with numbers that are not finite.
        """
        tensor = self._tensors[name]
        if tensor.data_type != _FLOAT:
            raise FileFormatError(
                self.path,
                f"weights {name!r} have ONNX type {tensor.data_type}; valid: {_FLOAT} (float32)",
            )
        raw = np.frombuffer(tensor.raw_data[: len(tensor.raw_data) // 4 * 4], "<f4")
        values = raw if tensor.raw_data else np.array(tensor.float_data, np.float32)
        shape = tuple(tensor.dims)
        if math.prod(shape) != values.size or min(shape, default=1) < 1:
            sizes = "×".join(map(str, shape)) or "1"
            raise FileFormatError(
                self.path, f"weights {name!r} have {values.size} numbers, their shape is {sizes}"
            )
        if not np.isfinite(values).all():
            raise FileFormatError(self.path, f"weights {name!r} hold numbers that are not finite")
        return values.astype(np.float64).reshape(shape)


def _node(node: Any) -> Node:
    domain = node.domain.removeprefix("ai.onnx")
    return Node(
        kind=f"{domain}.{node.op_type}" if domain else node.op_type,
        inputs=tuple(name for name in node.input if name),
        output=node.output[0] if node.output else "",
        attributes={a.name: a.f or float(a.i) for a in node.attribute},
    )


def _port(value: Any) -> Port:
    kind = value.type.tensor_type
    shape = tuple(dim.dim_param or int(dim.dim_value) for dim in kind.shape.dim)
    return Port(value.name, kind.elem_type == _FLOAT, shape)


@cache
def _message_class(name: str) -> Any:
    file = FileDescriptorProto(name="vlnpe/onnx.proto", package="vlnpe.onnx", syntax="proto3")
    for message_name, fields in _MESSAGES.items():
        message = file.message_type.add(name=message_name)
        for field_name, (number, kind) in fields.items():
            label = "REPEATED" if kind.endswith("*") else "OPTIONAL"
            field = message.field.add(
                name=field_name,
                number=number,
                label=FieldDescriptorProto.Label.Value(f"LABEL_{label}"),
            )
            kind = kind.rstrip("*")
            if kind in _MESSAGES:
                field.type, field.type_name = (
                    FieldDescriptorProto.TYPE_MESSAGE,
                    f".vlnpe.onnx.{kind}",
                )
            else:
                field.type = FieldDescriptorProto.Type.Value(f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"vlnpe.onnx.{name}"))
