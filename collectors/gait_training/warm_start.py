"""Begin a training with an exported gait instead of with nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from ..locomotion.policy import policy_files
from ..robots import RobotSpec
from .env import GaitEnv

LOOK_STEPS = 200  # policy steps over which the observations' mean and spread are taken


def start_from(robot: RobotSpec, folder: Path, env: GaitEnv, actor: Any) -> None:
    """Give a fresh actor the weights of `<robot>.onnx`, undoing what `export.py` folded in.

    An exported network is the mean of an actor and its mirror image side by side: its first half
    is the actor. What the export folded into the first layer, the observations' normalisation, is
    taken from a walk of the environment under that network and then factored out again.

    Args:
        robot: whose gait.
        folder: of the ONNX file.
        env: walked for 4 s.
        actor: `rsl_rl`'s, with a normaliser and an ELU network of half the exported widths.
    """
    path, _ = policy_files(robot, folder)
    tensors = {t.name: numpy_helper.to_array(t) for t in onnx.load(str(path)).graph.initializer}
    linear = [layer for layer in actor.mlp if isinstance(layer, torch.nn.Linear)]
    weights = [np.array(tensors[f"w{i}"], dtype=np.float64) for i in range(len(linear))]
    biases = [np.array(tensors[f"b{i}"], dtype=np.float64) for i in range(len(linear))]
    for i, layer in enumerate(linear):
        rows, columns = layer.weight.shape
        last = i == len(linear) - 1
        weights[i] = weights[i][:rows, :columns] * (2.0 if last else 1.0)
        biases[i] = biases[i][:rows]
    seen = _walk(env, weights, biases)
    normalizer = actor.obs_normalizer
    normalizer._mean[:] = torch.from_numpy(seen.mean(axis=0)).float()
    normalizer._var[:] = torch.from_numpy(seen.var(axis=0)).float()
    normalizer._std[:] = torch.sqrt(normalizer._var)
    # So much seen that a training's first steps do not move it from under the weights.
    normalizer.count.fill_(len(seen))
    biases[0] = biases[0] + weights[0] @ normalizer.mean.double().numpy()
    weights[0] = weights[0] * (normalizer.std.double().numpy() + normalizer.eps)
    with torch.no_grad():
        for layer, weight, bias in zip(linear, weights, biases, strict=True):
            layer.weight[:] = torch.from_numpy(weight).float()
            layer.bias[:] = torch.from_numpy(bias).float()


def _walk(env: GaitEnv, weights: list[np.ndarray], biases: list[np.ndarray]) -> np.ndarray:
    """Observations (K, D) of a walk of all simulations under a plain network."""
    seen = []
    for _ in range(LOOK_STEPS):
        observation = env.get_observations()["policy"].numpy().astype(np.float64)
        seen.append(observation)
        value = observation
        for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            value = value @ weight.T + bias
            if i < len(weights) - 1:
                value = np.where(value > 0, value, np.expm1(np.minimum(value, 0.0)))
        env.step(torch.from_numpy(value.astype(np.float32)))
    env.statistics.clear()
    return np.concatenate(seen)
