"""One recorded walk, prepared for the viewer: link poses, parts of the text, marks in time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from ..formats.core.arrays import F32, I64, U8, Array
from ..formats.core.camera import CameraModel
from ..formats.core.rollout import Rollout
from ..formats.core.text_parts import subtasks
from .robot import links_of


@dataclass(frozen=True)
class Shots:
    """What a camera of the robot saw.

    Attributes:
        samples: (N,) of the rollout, ascending.
        position_world_m, quat_wxyz: (N, 3) [m], (N, 4) of the optical frame.
        picture: returns the RGB picture (H, W, 3) of the n-th.
    """

    camera: CameraModel
    samples: I64
    position_world_m: Array
    quat_wxyz: Array
    picture: Callable[[int], U8]

    def at(self, sample: int) -> int:
        """Return the number of the last picture before or at a sample."""
        return max(0, int(np.searchsorted(self.samples, sample, side="right")) - 1)


@dataclass(frozen=True)
class Walk:
    """A rollout with its robot.

    Attributes:
        name: `<robot>/<controller>/<episode>`.
        model: the robot alone.
        shots: pictures, None where there are none.
    """

    name: str
    rollout: Rollout
    model: mujoco.MjModel
    shots: Shots | None = None

    def __len__(self) -> int:
        return len(self.rollout.time_s)

    @cached_property
    def poses(self) -> tuple[F32, F32, F32]:
        """Return where links and feet are in the world.

        Positions (T, L, 3) [m] and orientations (T, L, 4) of the links (`links_of`), positions
        (T, F, 3) of the feet's sites, NaN where the model has none of a foot's name.

        Raises:
            KeyError: the model lacks a joint of the rollout.
        """
        rollout, model = self.rollout, self.model
        bodies = [model.body(link).id for link in links_of(model)]
        free = int(np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0])
        base = int(model.jnt_qposadr[free])
        joints = [int(model.jnt_qposadr[model.joint(n).id]) for n in rollout.joint_names]
        sites = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f) for f in rollout.foot_names]
        data = mujoco.MjData(model)
        position = np.empty((len(self), len(bodies), 3), np.float32)
        rotation = np.empty((len(self), len(bodies), 4), np.float32)
        feet = np.empty((len(self), len(sites), 3), np.float32)
        for k in range(len(self)):
            data.qpos[base : base + 3] = rollout.position_world_m[k]
            data.qpos[base + 3 : base + 7] = rollout.quat_wxyz[k]
            data.qpos[joints] = rollout.joint_position_rad[k]
            mujoco.mj_kinematics(model, data)
            position[k], rotation[k] = data.xpos[bodies], data.xquat[bodies]
            feet[k] = data.site_xpos[sites]
        feet[:, np.array(sites, int) < 0] = np.nan
        return position, rotation, feet

    @cached_property
    def levels(self) -> I64:
        """The level (T,) that the robot is on."""
        return self.rollout.episode.levels_along(self.rollout.position_world_m)

    @cached_property
    def parts(self) -> tuple[list[str], list[float]]:
        """The parts of the instruction and the time [s] since which each is followed."""
        words, since_s = subtasks(self.rollout, np.arange(len(self)))
        return (words, since_s) if words else ([self.rollout.episode.instruction], [0.0])

    @cached_property
    def all_parts(self) -> list[str]:
        """All parts of the instruction, also those that the robot never came to."""
        record = self.rollout.episode.extra.get("instruction") or {}
        for text in record.get("texts") or []:
            if text.get("text") == self.rollout.episode.instruction and text.get("from_m"):
                return [str(step["words"]) for step in text["claims"]]
        return [self.rollout.episode.instruction]

    @cached_property
    def speed_m_s(self) -> Array:
        """(T,) horizontal speed of the base."""
        return np.linalg.norm(self.rollout.linear_velocity_base_m_s[:, :2], axis=1)

    @cached_property
    def tilt_deg(self) -> Array:
        """(T,) angle between the base's up axis and the vertical."""
        _, x, y, _ = self.rollout.quat_wxyz.T
        return np.degrees(np.arccos(np.clip(1 - 2 * (x**2 + y**2), -1, 1)))

    def chosen(self, sample: int) -> str:
        """Return the discrete action being carried out, or the command, in words."""
        for span in self.rollout.actions:
            if span.start_sample <= sample < span.stop_sample:
                return span.action.name.lower()
        forward, left, turn = self.rollout.command[sample]
        return f"{forward:z.2f} m/s ahead, {left:z.2f} m/s left, {np.degrees(turn):z.0f} °/s left"
