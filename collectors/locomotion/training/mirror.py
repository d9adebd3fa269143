"""Left-right mirroring of observations and actions of a symmetric legged robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from ...robots import RobotSpec
from ..runtime.observation import layout

# Signs of the vector blocks under a reflection of y; rates are axial vectors.
_BLOCK_SIGNS = {
    "linear_velocity_base_m_s": (1, -1, 1),
    "angular_velocity_base_rad_s": (-1, 1, -1),
    "gravity_base": (1, -1, 1),
    "command_vx_vy_yaw": (1, -1, -1),
    # The other legs lead by half a cycle.
    "gait_phase_sin_cos": (-1, -1),
}


def mirror_joints(robot: RobotSpec) -> tuple[list[int], list[int]]:
    """Return the permutation and signs that mirror vectors of policy joints.

    The first part of a name is its side. A joint about the y axis keeps its sense under a
    reflection of y; joints about x and z reverse theirs.
    """
    names = list(robot.policy_joint_names)
    other = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL", "left": "right", "right": "left"}
    sides = [name.split("_", 1) for name in names]
    order = [names.index(f"{other[side]}_{rest}") for side, rest in sides]
    model = robot.build_model(floor=False)
    return order, [1 if abs(model.joint(name).axis[1]) > 0.5 else -1 for name in names]


def mirror_observation(robot: RobotSpec, past: int = 0) -> tuple[list[int], list[int]]:
    """Return the permutation and signs that mirror whole observations of `layout(…, past)`."""
    order: list[int] = []
    signs: list[int] = []
    joint_order, joint_signs = mirror_joints(robot)
    for name, width in layout(robot.policy_joints, past):
        start = len(order)
        if name in _BLOCK_SIGNS:
            order += range(start, start + width)
            signs += _BLOCK_SIGNS[name]
        else:
            order += [start + i for i in joint_order]
            signs += joint_signs
    return order, signs


@dataclass(frozen=True)
class Symmetry:
    """Mirroring of one robot's observations and actions as index and sign tensors."""

    observation_order: torch.Tensor
    observation_signs: torch.Tensor
    joint_order: torch.Tensor
    joint_signs: torch.Tensor

    @classmethod
    def of(cls, robot: RobotSpec, past: int = 0) -> Symmetry:
        """Look the robot's mirror images up, once, for observations that repeat `past` steps."""
        tensors = []
        for order, signs in (mirror_observation(robot, past), mirror_joints(robot)):
            tensors += [torch.tensor(order), torch.tensor(np.asarray(signs, dtype=np.float32))]
        return cls(*tensors)


def mirrored(
    env: Any, obs: TensorDict | None, actions: torch.Tensor | None
) -> tuple[TensorDict | None, torch.Tensor | None]:
    """Append the mirror images to a batch, as `rsl_rl`'s symmetry extension asks.

    The critic's privileged group is repeated unmirrored: only the actor's mirror loss uses this.
    """
    mirror: Symmetry = env.symmetry
    if obs is not None:
        both = obs["policy"]
        image = both[:, mirror.observation_order] * mirror.observation_signs
        obs = TensorDict(
            {
                "policy": torch.cat([both, image]),
                "privileged": obs["privileged"].repeat(2, 1),
            },
            batch_size=[2 * len(both)],
        )
    if actions is not None:
        image = actions[:, mirror.joint_order] * mirror.joint_signs
        actions = torch.cat([actions, image])
    return obs, actions
