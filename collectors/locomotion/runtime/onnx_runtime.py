"""Networks of users' own robots: plain MLPs run in our code, all others in onnxruntime."""

import os

import numpy as np
from numpy.typing import NDArray

from ....formats.core.errors import FileFormatError, MissingExtraError
from .network import Network
from .onnx_file import OnnxFile
from .onnx_mlp import NotAnMlpError, read_mlp

Array = NDArray[np.float32]

EXTRA = "onnxruntime"


def load_network(file: OnnxFile, content: bytes) -> Network:
    """Return what evaluates a policy's network.

    Args:
        file: parsed, with one input and one output of fixed width.
        content: the same, as it lies on disk.

    Raises:
        FileFormatError: The file is damaged.
        MissingExtraError: It is not a plain chain of layers, and onnxruntime is not installed.
    """
    try:
        return read_mlp(file)
    except NotAnMlpError as error:
        try:
            return RuntimeNetwork(file, content)
        except ImportError:
            user = f"{file.path}: not a plain chain of layers ({error.reason}); running it"
            raise MissingExtraError(user, EXTRA) from None


class RuntimeNetwork:
    """Any graph, evaluated by onnxruntime."""

    def __init__(self, file: OnnxFile, content: bytes) -> None:
        """Start a session.

        Raises:
            ImportError: onnxruntime is not installed.
            FileFormatError: onnxruntime refuses the file.
        """
        # It writes a device's number into the user's cache and asks for a host of its maker's as
        # soon as it is imported, unless this is set.
        os.environ["ORT_DISABLE_TELEMETRY"] = "1"
        import onnxruntime

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
            reason = " ".join(str(error).split())
            raise FileFormatError(file.path, f"onnxruntime cannot read it: {reason}") from error
        self.inputs, self.outputs = (int(p[0].shape[-1]) for p in (file.inputs, file.outputs))
        self._names = file.inputs[0].name, file.outputs[0].name

    def run(self, observation: Array, action: Array) -> None:
        """Fill `action` (N, outputs) from `observation` (N, inputs)."""
        taken, given = self._names
        action[:] = np.asarray(self._session.run([given], {taken: observation})[0])
