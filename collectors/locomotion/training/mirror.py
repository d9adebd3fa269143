"""Left-right mirroring of observations and actions of a symmetric legged robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
from tensordict import TensorDict

from ....formats.core.errors import InputError
from ...robots import RobotHandles, RobotSpec
from ..runtime.footing import Footing
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

    Each joint's partner is the one that lies at its mirror image in the default pose. An axis is an
    axial vector, of which a reflection of y reverses x and z.

    Raises:
        InputError: a joint has no partner; the robot is not symmetric.
    """
    model = robot.build_model(floor=False)
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_kinematics(model, data)
    joints = [model.joint(name).id for name in robot.policy_joint_names]
    place, axis = data.xanchor[joints], data.xaxis[joints]
    image, turned = place * (1.0, -1.0, 1.0), axis * (-1.0, 1.0, -1.0)
    off = np.linalg.norm(image[:, None] - place[None], axis=2)
    along = np.einsum("ik,jk->ij", turned, axis)
    off += 1.0 - np.abs(along)
    order = off.argmin(axis=1)
    # Bodies of real robots are symmetric to a millimetre or so.
    lonely = np.flatnonzero(off.min(axis=1) > 0.01)
    if len(lonely):
        raise InputError(
            f"robot {robot.name}: joint {robot.policy_joint_names[lonely[0]]} has no mirror image; "
            "valid: a robot that is symmetric about y = 0 in its default pose"
        )
    signs = np.sign(along[np.arange(len(joints)), order]).astype(int)
    return order.tolist(), signs.tolist()


def mirror_observation(
    robot: RobotSpec, past: int = 0, footing: Footing | None = None
) -> tuple[list[int], list[int]]:
    """Return the permutation and signs that mirror whole observations of `layout(…, past)`."""
    order: list[int] = []
    signs: list[int] = []
    joint_order, joint_signs = mirror_joints(robot)
    for name, width in layout(robot.policy_joints, past, footing):
        start = len(order)
        if name in _BLOCK_SIGNS:
            order += range(start, start + width)
            signs += _BLOCK_SIGNS[name]
        elif name == "slope":
            order.append(start)
            signs.append(1)
        elif footing is not None and name == "height_scan_m":
            # Columns lie from right to left.
            columns = np.arange(width).reshape(len(footing.scan_y_m), -1)[::-1]
            order += (start + columns.ravel()).tolist()
            signs += [1] * width
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
    def of(cls, robot: RobotSpec, past: int = 0, footing: Footing | None = None) -> Symmetry:
        """Look the robot's mirror images up, once, for observations that repeat `past` steps."""
        tensors = []
        for order, signs in (mirror_observation(robot, past, footing), mirror_joints(robot)):
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
        image = both[:, mirror.observation_order] * mirror.observation_signs.to(both.device)
        obs = TensorDict(
            {
                "policy": torch.cat([both, image]),
                "privileged": obs["privileged"].repeat(2, 1),
            },
            batch_size=[2 * len(both)],
        )
    if actions is not None:
        image = actions[:, mirror.joint_order] * mirror.joint_signs.to(actions.device)
        actions = torch.cat([actions, image])
    return obs, actions
