"""Our gaits' networks come from safetensors, users' own from ONNX; both give what they hold."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load, save

from vlnpe.collectors.locomotion.runtime.network import Mlp, Network, decode_layers, encode_layers
from vlnpe.collectors.locomotion.runtime.onnx_runtime import OnnxNetwork
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy, policy_files
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError, MissingExtraError

PATH = Path("policy.safetensors")
RNG = np.random.default_rng(7)
Tensors = dict[str, np.ndarray]


def evaluated(network: Network, seen: np.ndarray) -> np.ndarray:
    output = np.zeros((len(seen), network.outputs), np.float32)
    network.run(np.ascontiguousarray(seen, dtype=np.float32), output)
    return output


def expected(weights: list[np.ndarray], biases: list[np.ndarray], seen: np.ndarray) -> np.ndarray:
    value = seen.astype(np.float64)
    for k, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        value = value @ weight.T.astype(np.float64) + bias
        if k < len(weights) - 1:
            value = np.where(value > 0, value, np.expm1(np.minimum(value, 0.0)))
    return value


def array(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("name", list(GAITS))
def test_shipped_gaits_give_what_their_layers_say(name: str):
    path, _ = policy_files(get_robot(name))
    layers = decode_layers(path, path.read_bytes())
    network = Mlp(*layers)
    seen = RNG.normal(0, 3, (200, network.inputs)).astype(np.float32)
    # Hundreds of float32 terms in another order; actions are a few units and clipped at 8.
    np.testing.assert_allclose(evaluated(network, seen), expected(*layers, seen), 1e-5, 2e-4)


def test_one_row_is_the_same_alone_and_among_many():
    network = GaitPolicy.load(get_robot("h1")).network
    seen = array(9, network.inputs)
    alone = np.concatenate([evaluated(network, row[None]) for row in seen])
    np.testing.assert_array_equal(evaluated(network, seen), alone)


def test_layers_come_back_exactly_and_zeros_may_stand_between():
    weights = [np.kron(np.eye(2, dtype=np.float32), array(3, 4)), array(3, 6)]
    biases = [array(6), array(3)]
    content = encode_layers(weights, biases)
    read = decode_layers(PATH, content)
    for given, back in zip((*weights, *biases), (*read[0], *read[1]), strict=True):
        np.testing.assert_array_equal(given, back)
    assert encode_layers(*read) == content
    seen = array(20, 8)
    np.testing.assert_allclose(
        evaluated(Mlp(*read), seen), expected(weights, biases, seen), 1e-5, 1e-5
    )


def nan(tensors: Tensors) -> None:
    tensors["weight_1"][0, 0] = np.nan


MISTAKES: dict[str, tuple[Callable[[Tensors], object], str]] = {
    "a missing bias": (lambda t: t.pop("bias_1"), "its tensors are"),
    "no tensors": (lambda t: t.clear(), "its tensors are"),
    "another name": (lambda t: t.update(w=t.pop("weight_0")), "valid: weight_0, bias_0"),
    "not finite": (nan, "not finite"),
    "doubles": (lambda t: t.update(bias_0=t["bias_0"].astype(np.float64)), "valid: float32"),
    "a bias too long": (lambda t: t.update(bias_0=array(9)), "weight_0 is"),
    "a vector": (lambda t: t.update(weight_0=array(8)), "weight_0 is"),
    "layers that do not fit": (lambda t: t.update(weight_1=array(3, 7)), "takes 7 numbers"),
    "a layer without end": (lambda t: t.update(weight_1=array(3, 9000)), "8,192"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_other_tensors_are_refused(name: str):
    spoil, reason = MISTAKES[name]
    tensors = load(encode_layers([array(8, 6), array(3, 8)], [array(8), array(3)]))
    tensors = {key: value.copy() for key, value in tensors.items()}
    spoil(tensors)
    with pytest.raises(FileFormatError, match=reason):
        decode_layers(PATH, save(tensors))


@pytest.mark.parametrize("content", [b"", b"noise", bytes(range(256)), b"\xff" * 64])
def test_noise_is_no_network(content: bytes):
    with pytest.raises(FileFormatError, match="not a safetensors file"):
        decode_layers(PATH, content)
    with pytest.raises(FileFormatError, match=r"policy\.onnx"):
        OnnxNetwork(Path("policy.onnx"), content)


def test_without_onnxruntime_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"policy.onnx: .*extra `onnxruntime`"):
        OnnxNetwork(Path("policy.onnx"), b"")


def test_walking_imports_no_onnxruntime():
    script = (
        "import sys, mujoco\n"
        "from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy\n"
        "from vlnpe.collectors.robots import get_robot\n"
        "robot = get_robot('h1')\n"
        "GaitPolicy.load(robot).act(mujoco.MjData(robot.build_model()), (0.5, 0.0, 0.0))\n"
        "sys.exit('onnxruntime' in sys.modules or 'onnx' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
