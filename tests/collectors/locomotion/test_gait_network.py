"""Gait networks are evaluated without onnxruntime, and give what their ONNX file says."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.network import Network
from vlnpe.collectors.locomotion.runtime.onnx_file import OnnxFile
from vlnpe.collectors.locomotion.runtime.onnx_mlp import NotAnMlpError, read_mlp
from vlnpe.collectors.locomotion.runtime.onnx_runtime import RuntimeNetwork, load_network
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy, policy_files
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError, MissingExtraError

pytest.importorskip("onnx", reason="extra `train` is not installed")

import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

PATH = Path("policy.onnx")
RNG = np.random.default_rng(7)
# Hundreds of float32 terms in another order; actions are a few units and clipped at 8.
ROUNDING = 5e-5


def evaluated(network: Network, seen: np.ndarray) -> np.ndarray:
    output = np.zeros((len(seen), network.outputs), np.float32)
    network.run(np.ascontiguousarray(seen, dtype=np.float32), output)
    return output


def reference(model: onnx.ModelProto, seen: np.ndarray) -> np.ndarray:
    (output,) = ReferenceEvaluator(model).run(None, {"observation": seen})
    return np.asarray(output)


def loaded(content: bytes) -> Network:
    return load_network(OnnxFile(PATH, content), content)


def model(
    nodes: Sequence[onnx.NodeProto],
    constants: dict[str, np.ndarray],
    inputs: int = 6,
    outputs: int = 3,
) -> onnx.ModelProto:
    graph = helper.make_graph(
        nodes,
        "gait",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", inputs])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", outputs])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    made.ir_version = 8
    onnx.checker.check_model(made)
    return made


def array(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape).astype(np.float32)


def node(kind: str, inputs: str, output: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(kind, inputs.split(), [output], **attributes)


@pytest.mark.parametrize("name", list(GAITS))
def test_shipped_gaits_equal_the_onnx_reference(name: str):
    path, _ = policy_files(get_robot(name))
    content = path.read_bytes()
    network = read_mlp(OnnxFile(path, content))
    seen = RNG.normal(0, 3, (200, network.inputs)).astype(np.float32)
    expected = reference(onnx.load_from_string(content), seen)
    np.testing.assert_allclose(evaluated(network, seen), expected, rtol=1e-5, atol=ROUNDING)


@pytest.mark.parametrize("name", list(GAITS))
def test_shipped_gaits_equal_onnxruntime(name: str):
    pytest.importorskip("onnxruntime", reason="extra `onnxruntime` is not installed")
    path, _ = policy_files(get_robot(name))
    content = path.read_bytes()
    network = read_mlp(OnnxFile(path, content))
    other = RuntimeNetwork(OnnxFile(path, content), content)
    assert (other.inputs, other.outputs) == (network.inputs, network.outputs)
    seen = RNG.normal(0, 3, (200, network.inputs)).astype(np.float32)
    expected = np.zeros((200, network.outputs), np.float32)
    other.run(seen, expected)
    np.testing.assert_allclose(evaluated(network, seen), expected, rtol=1e-5, atol=ROUNDING)


def test_one_row_is_the_same_alone_and_among_many():
    network = GaitPolicy.load(get_robot("h1")).network
    seen = array(9, network.inputs)
    alone = np.concatenate([evaluated(network, row[None]) for row in seen])
    np.testing.assert_array_equal(evaluated(network, seen), alone)


CHAINS = {
    "what torch exports": (
        [
            node("Gemm", "observation w0 b0", "a", transB=1),
            node("Elu", "a", "b", alpha=0.7),
            node("Gemm", "b w1 b1", "action", transB=1),
        ],
        {"w0": array(8, 6), "b0": array(8), "w1": array(3, 8), "b1": array(3)},
    ),
    "a normaliser before it": (
        [
            node("Sub", "observation mean", "a"),
            node("Div", "a std", "b"),
            node("MatMul", "b w0", "c"),
            node("Add", "b0 c", "d"),
            node("Tanh", "d", "e"),
            node("Gemm", "e w1 b1", "f", transB=0, alpha=2.0, beta=0.5),
            node("Mul", "f scale", "action"),
        ],
        {
            "mean": array(1, 6),
            "std": np.abs(array(6)) + 0.5,
            "w0": array(6, 8),
            "b0": array(8),
            "w1": array(8, 3),
            "b1": array(1, 3),
            "scale": array(1),
        },
    ),
    "no bias, and every activation": (
        [
            node("Gemm", "observation w0", "a", transB=1),
            node("Relu", "a", "b"),
            node("MatMul", "b w1", "c"),
            node("LeakyRelu", "c", "d", alpha=0.2),
            node("MatMul", "d w1", "e"),
            node("Sigmoid", "e", "f"),
            node("MatMul", "f w1", "g"),
            node("Identity", "g", "h"),
            node("Elu", "h", "i"),
            node("Gemm", "i w2", "j", transB=1),
            node("Tanh", "j", "action"),
        ],
        {"w0": array(8, 6), "w1": array(8, 8), "w2": array(3, 8)},
    ),
    "an activation first": (
        [node("Tanh", "observation", "a"), node("MatMul", "a w", "action")],
        {"w": array(6, 3)},
    ),
    "zeros off two blocks": (
        [node("MatMul", "observation w0", "a"), node("MatMul", "a w1", "action")],
        {"w0": np.kron(np.eye(2, dtype=np.float32), array(3, 4)), "w1": array(8, 3)},
    ),
}


@pytest.mark.parametrize("chain", CHAINS)
def test_chains_equal_the_onnx_reference(chain: str):
    made = model(*CHAINS[chain])
    network = read_mlp(OnnxFile(PATH, made.SerializeToString()))
    seen = array(20, 6)
    expected = reference(made, seen)
    np.testing.assert_allclose(evaluated(network, seen), expected, rtol=1e-5, atol=1e-5)


def test_constant_nodes_and_float_data_are_read():
    weight = array(6, 3)
    tensor = helper.make_tensor("value", TensorProto.FLOAT, weight.shape, weight.ravel().tolist())
    made = model(
        [
            helper.make_node("Constant", [], ["w"], value=tensor),
            node("MatMul", "observation w", "action"),
        ],
        {},
    )
    network = read_mlp(OnnxFile(PATH, made.SerializeToString()))
    seen = array(4, 6)
    np.testing.assert_allclose(evaluated(network, seen), seen @ weight, rtol=1e-5, atol=1e-6)


W = {"w": array(6, 3)}
NOT_MLPS = {
    "a branch": (
        [
            node("MatMul", "observation w", "a"),
            node("Sigmoid", "a", "b"),
            node("Mul", "a b", "action"),
        ],
        "Mul of more than the value before it",
    ),
    "another operator": (
        [node("MatMul", "observation w", "a"), node("Softmax", "a", "action")],
        "operator 'Softmax'",
    ),
}


@pytest.mark.parametrize("case", NOT_MLPS)
def test_other_graphs_are_distinguished_from_mlps(case: str):
    nodes, reason = NOT_MLPS[case]
    with pytest.raises(NotAnMlpError, match=reason):
        read_mlp(OnnxFile(PATH, model(nodes, W).SerializeToString()))


@pytest.mark.parametrize("case", NOT_MLPS)
def test_other_graphs_run_by_onnxruntime(case: str):
    pytest.importorskip("onnxruntime", reason="extra `onnxruntime` is not installed")
    made = model(NOT_MLPS[case][0], W)
    network = loaded(made.SerializeToString())
    assert isinstance(network, RuntimeNetwork)
    seen = array(1, 6)
    expected = reference(made, seen)
    output = np.zeros((1, 3), np.float32)
    network.run(seen, output)
    np.testing.assert_allclose(output, expected, rtol=1e-5, atol=1e-5)


def test_without_onnxruntime_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    made = model(NOT_MLPS["another operator"][0], W)
    with pytest.raises(
        MissingExtraError, match=r"policy.onnx: .*operator 'Softmax'.*extra `onnxruntime`"
    ) as caught:
        loaded(made.SerializeToString())
    assert "\n" not in str(caught.value)


def spoiled(change: str) -> bytes:
    made = model([node("MatMul", "observation w", "action")], {"w": array(6, 3)})
    (tensor,) = made.graph.initializer
    if change == "external":
        tensor.ClearField("raw_data")
        tensor.data_location = TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="/etc/passwd")
    elif change == "short":
        tensor.raw_data = tensor.raw_data[:-4]
    elif change == "nan":
        tensor.raw_data = np.full(18, np.nan, np.float32).tobytes()
    elif change == "huge":
        tensor.dims[:] = [2**40, 2**40]
    elif change == "integers":
        tensor.data_type = TensorProto.INT32
    elif change == "missing":
        del made.graph.initializer[:]
    elif change == "narrow":
        tensor.CopyFrom(numpy_helper.from_array(array(5, 3), "w"))
    elif change == "wide":
        tensor.CopyFrom(numpy_helper.from_array(array(6, 4), "w"))
    return made.SerializeToString()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("external", "'w' are in another file"),
        ("short", "'w' have 17 numbers.*6×3"),
        ("nan", "'w' hold numbers that are not finite"),
        ("huge", "'w' have 18 numbers"),
        ("integers", "'w' have ONNX type 6; valid: 1"),
        ("missing", "takes 'w', which nothing in the file defines"),
        ("narrow", "take 5 numbers, given 6"),
        ("wide", "its layers give 4 numbers"),
    ],
)
def test_broken_networks_are_refused_in_one_line(change: str, reason: str):
    with pytest.raises(FileFormatError, match=reason) as caught:
        loaded(spoiled(change))
    assert "policy.onnx" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"noise", bytes(range(256))])
def test_noise_is_no_network(content: bytes):
    with pytest.raises(FileFormatError, match="ONNX"):
        loaded(content)


def test_walking_imports_no_onnxruntime():
    script = (
        "import sys, mujoco\n"
        "from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy\n"
        "from vlnpe.collectors.robots import get_robot\n"
        "robot = get_robot('h1')\n"
        "GaitPolicy.load(robot).act(mujoco.MjData(robot.build_model()), (0.5, 0.0, 0.0))\n"
        "sys.exit('onnxruntime' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
