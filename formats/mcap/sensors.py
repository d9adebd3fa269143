"""Commands, actions, IMU and foot contacts as JSON messages."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import foxglove
import numpy as np

from ..core.rollout import Action, Rollout
from .recording import Recording
from .topics import Write, logged

COMMAND_TOPIC = "/command"
ACTION_TOPIC = "/action"
IMU_TOPIC = "/imu"
FOOT_TOPIC = "/foot_contact"
COMMANDS = ("vx_base_m_s", "vy_base_m_s", "yaw_rate_rad_s")
IMU = (
    *(f"specific_force_{axis}_base_m_s2" for axis in "xyz"),
    *(f"angular_rate_{axis}_base_rad_s" for axis in "xyz"),
)


def command_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield the velocity command of every `every`-th sample."""
    samples = _samples(rollout, every, COMMANDS, rollout.command)
    return _messages(recording, COMMAND_TOPIC, "vlnpe.Command", _all(COMMANDS, "number"), samples)


def imu_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield every `every`-th measurement of the base's inertial sensor."""
    samples = _samples(rollout, every, IMU, rollout.imu)
    return _messages(recording, IMU_TOPIC, "vlnpe.Imu", _all(IMU, "number"), samples)


def foot_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield which feet touch the floor at every `every`-th sample, by name."""
    names = rollout.foot_names
    samples = _samples(rollout, every, names, rollout.foot_contact) if names else ()
    return _messages(recording, FOOT_TOPIC, "vlnpe.FootContact", _all(names, "boolean"), samples)


def action_messages(
    recording: Recording, rollout: Rollout, labels: Mapping[float, int] | None = None
) -> Iterator[Write]:
    """Yield executed discrete actions as they begin; if there are none, the frames' labels.

    Args:
        labels: `action.discrete` by the frame's time [s].
    """
    last = len(rollout.time_s) - 1
    spans = [(rollout.time_s[min(s.start_sample, last)], s.action, False) for s in rollout.actions]
    actions = spans or [(time_s, Action(label), True) for time_s, label in (labels or {}).items()]
    fields = {"id": "integer", "name": "string", "derived": "boolean"}
    values = [
        (time_s, {"id": int(action), "name": action.name, "derived": derived})
        for time_s, action, derived in actions
    ]
    return _messages(recording, ACTION_TOPIC, "vlnpe.Action", fields, values)


def _all(names: Sequence[str], kind: str) -> dict[str, str]:
    return dict.fromkeys(names, kind)


def _samples(
    rollout: Rollout, every: int, names: Sequence[str], values: np.ndarray
) -> Iterator[tuple[float, dict[str, Any]]]:
    for i in range(0, len(rollout.time_s), every):
        yield rollout.time_s[i], dict(zip(names, values[i].tolist(), strict=True))


def _messages(
    recording: Recording,
    topic: str,
    title: str,
    fields: dict[str, str],
    values: Iterable[tuple[float, dict[str, Any]]],
) -> Iterator[Write]:
    """Yield messages of times [s] and values, if there are any; `fields` has JSON's types."""
    properties = {name: {"type": kind} for name, kind in fields.items()}
    schema = {"type": "object", "title": title, "properties": properties}
    channel = None
    for time_s, value in values:
        channel = channel or foxglove.Channel(topic, schema=schema, context=recording.context)
        yield logged(channel, time_s, value)
