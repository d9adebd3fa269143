"""Messages of ROS 2 from arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bag import NANOSECONDS, STORE, full_name

# Stamps begin here: to tf2 a stamp of 0 is no time, but "the latest".
START_NS = NANOSECONDS


def make(kind: str, *values: Any, **fields: Any) -> Any:
    """Return a message of a type such as `std_msgs/String`."""
    return STORE.types[full_name(kind)](*values, **fields)


def nanoseconds(time_s: float) -> int:
    """Return the stamp [ns] of a time [s] of a simulation."""
    return START_NS + round(float(time_s) * NANOSECONDS)


def time(at_ns: int) -> Any:
    """Return a stamp."""
    return make("builtin_interfaces/Time", *divmod(at_ns, NANOSECONDS))


def header(at_ns: int, frame: str) -> Any:
    """Return a header."""
    return make("std_msgs/Header", time(at_ns), frame)


def vector(values: NDArray[np.float64]) -> Any:
    """Return a Vector3."""
    return make("geometry_msgs/Vector3", *values.tolist())


def quaternion(quat_wxyz: NDArray[np.float64]) -> Any:
    """Return a Quaternion."""
    w, x, y, z = quat_wxyz.tolist()
    return make("geometry_msgs/Quaternion", x, y, z, w)


def pose(position_m: NDArray[np.float64], quat_wxyz: NDArray[np.float64]) -> Any:
    """Return a Pose."""
    point = make("geometry_msgs/Point", *position_m.tolist())
    return make("geometry_msgs/Pose", point, quaternion(quat_wxyz))


def twist(linear_m_s: NDArray[np.float64], angular_rad_s: NDArray[np.float64]) -> Any:
    """Return a Twist."""
    return make("geometry_msgs/Twist", vector(linear_m_s), vector(angular_rad_s))


def transforms(
    at_ns: int, *placed: tuple[str, str, NDArray[np.float64], NDArray[np.float64]]
) -> Any:
    """Return a TFMessage of (parent, child, position [m], quat_wxyz of the child in it)."""
    messages = [
        make(
            "geometry_msgs/TransformStamped",
            header(at_ns, parent),
            child,
            make("geometry_msgs/Transform", vector(position), quaternion(quat)),
        )
        for parent, child, position, quat in placed
    ]
    return make("tf2_msgs/TFMessage", messages)
