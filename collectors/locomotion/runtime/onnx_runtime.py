"""Networks of users' own robots: ONNX files, evaluated by onnxruntime."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....formats.core.arrays import F32
from ....formats.core.errors import FileFormatError, MissingExtraError, brief

EXTRA = "onnxruntime"


class OnnxNetwork:
    """A graph from `observation` (batch, D) to `action` (batch, J), both float32."""

    def __init__(self, path: Path, content: bytes) -> None:
        """Start a session for the bytes of an ONNX file; `path` is for errors.

        Raises:
            MissingExtraError: onnxruntime is not installed.
            FileFormatError: the file is damaged, unsafe, or has another input or output.
        """
        # It writes a device's number into the user's cache and asks for a host of its maker's as
        # soon as it is imported, unless this is set.
        os.environ["ORT_DISABLE_TELEMETRY"] = "1"
        try:
            import onnx
            import onnxruntime
        except ImportError:
            raise MissingExtraError(f"{path}: running it", EXTRA) from None
        try:
            graph = onnx.load_model_from_string(content).graph
        except Exception as error:  # protobuf's exception types depend on its implementation
            raise FileFormatError(path, "not an ONNX file") from error
        _check_graph(path, graph)
        options = onnxruntime.SessionOptions()
        # One small network per worker: threads only cost, here.
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's own exception types are not public
            reason = " ".join(str(error).split())[:200]
            raise FileFormatError(path, f"onnxruntime cannot read it: {reason}") from error
        self.inputs = _width(path, "input", "observation", self._session.get_inputs())
        self.outputs = _width(path, "output", "action", self._session.get_outputs())

    def run(self, observation: F32, action: F32) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs)."""
        action[:] = np.asarray(self._session.run(["action"], {"observation": observation})[0])


def _check_graph(path: Path, graph: Any) -> None:
    """Refuse, at any depth, weights in another file, endless loops and numbers without end."""
    from onnx.numpy_helper import to_array

    tensors = list(graph.initializer)
    for node in graph.node:
        if node.op_type == "Loop":
            raise FileFormatError(path, "operator Loop is not supported; unroll it")
        for attribute in node.attribute:
            if not math.isfinite(attribute.f):
                name = f"{brief(node.op_type)}: {brief(attribute.name)}"
                raise FileFormatError(path, f"{name} is {attribute.f}; valid: finite numbers")
            tensors += [attribute.t, *attribute.tensors]
            for inner in (attribute.g, *attribute.graphs):
                _check_graph(path, inner)
    for tensor in tensors:
        name = brief(tensor.name)
        if tensor.data_location:
            raise FileFormatError(path, f"weights {name} are in another file; valid: in this one")
        try:
            finite = np.isfinite(to_array(tensor)).all() if tensor.data_type else True
        except Exception as error:  # of many types, one for each way in which sizes can lie
            raise FileFormatError(path, f"weights {name} are damaged") from error
        if not finite:
            raise FileFormatError(path, f"weights {name} hold numbers that are not finite")


def _width(path: Path, kind: str, name: str, ports: Sequence[Any]) -> int:
    """Return the width of a graph's one input or output.

    Raises:
        FileFormatError: there are several, or it has another name, type or shape.
    """
    port = ports[0] if len(ports) == 1 else None
    if (
        port is None
        or (port.name, port.type) != (name, "tensor(float)")
        or len(port.shape) != 2
        or not isinstance(port.shape[1], int)
    ):
        given = ", ".join(f"{brief(p.name)} {p.type} {brief(p.shape)}" for p in ports)
        raise FileFormatError(
            path, f"its {kind} is {given}; valid: {name} tensor(float) ['batch', WIDTH]"
        )
    return port.shape[1]
