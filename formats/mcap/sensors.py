"""Commands, actions, IMU and foot contacts as JSON messages."""

from collections.abc import Iterator, Mapping
from typing import Any

import foxglove

from ..core.rollout import Action, Rollout
from .recording import Recording, nanoseconds
from .topics import Write

COMMAND_TOPIC = "/command"
ACTION_TOPIC = "/action"
IMU_TOPIC = "/imu"
FOOT_TOPIC = "/foot_contact"


def command_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield the velocity commands."""
    names = ("vx_base_m_s", "vy_base_m_s", "yaw_rate_rad_s")
    channel = _json_channel(
        recording, COMMAND_TOPIC, "vlnpe.Command", dict.fromkeys(names, "number")
    )
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.command[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def imu_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield the measurements of the base's inertial sensor."""
    names = [f"specific_force_{c}_base_m_s2" for c in "xyz"]
    names += [f"angular_rate_{c}_base_rad_s" for c in "xyz"]
    channel = _json_channel(recording, IMU_TOPIC, "vlnpe.Imu", dict.fromkeys(names, "number"))
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.imu[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def foot_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield which feet touch the floor, by name."""
    names = rollout.foot_names
    if not names:
        return
    fields = dict.fromkeys(names, "boolean")
    channel = _json_channel(recording, FOOT_TOPIC, "vlnpe.FootContact", fields)
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.foot_contact[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def action_messages(
    recording: Recording, rollout: Rollout, labels: Mapping[float, int] | None = None
) -> Iterator[Write]:
    """Yield executed discrete actions as they begin; if there are none, the frames' labels.

    Args:
        recording: where to.
        labels: `action.discrete` by the frame's time [s].
    """
    last = len(rollout.time_s) - 1
    spans = [(rollout.time_s[min(s.start_sample, last)], s.action, False) for s in rollout.actions]
    labelled = spans or [(time_s, Action(label), True) for time_s, label in (labels or {}).items()]
    if not labelled:
        return
    fields = {"id": "integer", "name": "string", "derived": "boolean"}
    channel = _json_channel(recording, ACTION_TOPIC, "vlnpe.Action", fields)
    for time_s, action, derived in labelled:
        at = nanoseconds(time_s)
        message = {"id": int(action), "name": action.name, "derived": derived}
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def _json_channel(
    recording: Recording, topic: str, title: str, fields: dict[str, str]
) -> foxglove.Channel:
    properties = {name: {"type": kind} for name, kind in fields.items()}
    schema = {"type": "object", "title": title, "properties": properties}
    return foxglove.Channel(topic, schema=schema, context=recording.context)
