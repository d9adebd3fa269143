"""From a trained actor to the ONNX file that runs everywhere."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from ...formats.core.atomic import atomic_file
from ..locomotion.card import PolicyCard, save_card
from ..locomotion.observation import layout
from ..robots import POLICY_DECIMATION, TIMESTEP_S, RobotSpec
from .config import TrainingConfig
from .gaits import GAITS
from .mirror import Symmetry

Array = NDArray[np.float64]


def actor_to_onnx(actor: torch.nn.Module, mirror: Symmetry | None = None) -> bytes:
    """Serialise `rsl_rl`'s actor (normaliser and ELU network) as `observation` → `action`.

    The observation normalisation is folded into the first layer, so that the file needs nothing
    beside it. With `mirror` the file holds the mean of the network and its mirror image, which is
    exactly symmetric where training only comes near: the two stand side by side in one network of
    twice the width.
    """
    linear = [layer for layer in actor.mlp if isinstance(layer, torch.nn.Linear)]  # type: ignore[attr-defined]
    normalizer = actor.obs_normalizer
    mean = normalizer.mean.numpy().astype(np.float64)  # type: ignore[operator, union-attr]
    std = normalizer.std.numpy().astype(np.float64) + normalizer.eps  # type: ignore[operator, union-attr]
    weights = [layer.weight.detach().numpy().astype(np.float64) for layer in linear]
    biases = [layer.bias.detach().numpy().astype(np.float64) for layer in linear]
    weights[0] = weights[0] / std
    biases[0] = biases[0] - weights[0] @ mean
    if mirror is not None:
        weights, biases = _with_mirror_image(weights, biases, mirror)
    nodes, constants, value = [], [], "observation"
    for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        last = i == len(weights) - 1
        output = "action" if last else f"linear_{i}"
        nodes.append(helper.make_node("Gemm", [value, f"w{i}", f"b{i}"], [output], transB=1))
        constants.append(numpy_helper.from_array(weight.astype(np.float32), f"w{i}"))
        constants.append(numpy_helper.from_array(bias.astype(np.float32), f"b{i}"))
        value = output
        if not last:
            nodes.append(helper.make_node("Elu", [value], [f"hidden_{i}"]))
            value = f"hidden_{i}"
    inputs, outputs = weights[0].shape[1], weights[-1].shape[0]
    graph = helper.make_graph(
        nodes,
        "gait",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", inputs])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", outputs])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _with_mirror_image(
    weights: Sequence[Array], biases: Sequence[Array], mirror: Symmetry
) -> tuple[Sequence[NDArray[np.floating]], Sequence[NDArray[np.floating]]]:
    """Layers of (π(o) + M π(M o)) / 2, from those of π; M mirrors observations and actions."""
    seen = _matrix(mirror.observation_order, mirror.observation_signs)
    done = _matrix(mirror.joint_order, mirror.joint_signs)
    first, *middle, last = weights
    halves = [np.vstack([first, first @ seen])]
    halves += [np.kron(np.eye(2), weight) for weight in middle]
    halves.append(0.5 * np.hstack([last, done @ last]))
    joined = [np.tile(bias, 2) for bias in biases[:-1]]
    return halves, [*joined, 0.5 * (biases[-1] + done @ biases[-1])]


def _matrix(order: torch.Tensor, signs: torch.Tensor) -> Array:
    """The matrix M of (M v)[i] = signs[i] v[order[i]]."""
    return np.eye(len(order))[order.numpy()] * signs.numpy()[:, None]


def motor_speeds(robot: RobotSpec) -> tuple[float | None, ...]:
    """Greatest speed of each joint's motor [rad/s], as a card tells it."""
    speeds = (joint.speed_rad_s for joint in robot.joints)
    return tuple(speed if math.isfinite(speed) else None for speed in speeds)


def write_policy(
    robot: RobotSpec,
    config: TrainingConfig,
    actor: torch.nn.Module,
    training: dict[str, Any],
    folder: Path,
) -> None:
    """Write `<robot>.onnx` and `<robot>.json` (without an evaluation yet) into `folder`."""
    content = actor_to_onnx(actor, Symmetry.of(robot))
    card = PolicyCard(
        robot=robot.name,
        physics_hash=robot.physics_hash(),
        observation=layout(robot.policy_joints),
        joints=robot.policy_joint_names,
        action_scale_rad=robot.action_scale_rad,
        action_clip=config.action_clip,
        default_joint_rad=tuple(joint.default_rad for joint in robot.joints),
        kp=tuple(joint.kp for joint in robot.joints),
        kd=tuple(joint.kd for joint in robot.joints),
        torque_nm=tuple(joint.torque_nm for joint in robot.joints),
        speed_rad_s=motor_speeds(robot),
        rate_hz=1.0 / (TIMESTEP_S * POLICY_DECIMATION),
        gait=GAITS[robot.name],
        onnx_sha256=hashlib.sha256(content).hexdigest(),
        training=training,
        evaluation={},
    )
    with atomic_file(folder / f"{robot.name}.onnx") as temporary:
        temporary.write_bytes(content)
    save_card(card, folder / f"{robot.name}.json")
