"""Serve a policy over a WebSocket, so that it runs in its own environment, or on another machine.

This file needs numpy, msgpack and websockets, and nothing of vlnpe: copy it beside a model.

    class MyPolicy:
        images = True                       # False: send no images
        version = "my-model step 4000"      # results are reused for the same version only
        def reset(self, episode): ...       # dict with instruction, episode_id, scene_id, robot, …
        def act(self, observation):         # dict with rgb, depth_m, instruction, pose, …
            return 1                        # 0 STOP, 1 FORWARD, 2 LEFT, 3 RIGHT
    serve(MyPolicy, "127.0.0.1", 8765)

Messages are msgpack maps, one per WebSocket message. The server speaks first:

    server  {"protocol": "vlnpe-policy/1", "images": true, "version": "…"}
    client  {"type": "reset", "episode": {…}}          server  {}
    client  {"type": "act", "observation": {…}}        server  {"action": 1, "said": "…"}

`said` is optional, as is a policy's attribute of that name: a text of the last action for the
record. Where the episode asks for `actions` other than `discrete`, an action is an array: (3,) vx,
vy [m/s], yaw rate [rad/s] for `velocity`, (K, 3) Δx, Δy [m], Δyaw [rad] for `waypoints`; 0 stops.

A server that fails answers {"error": "…"}. An array is a map of `dtype` (numpy's, little-endian),
`shape` and `data` (bytes, row-major) under the key `__array__`.
"""

import logging
import re
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

log = logging.getLogger(__name__)

PROTOCOL = "vlnpe-policy/1"
LARGEST_OBSERVATION_BYTES = 1 << 26


def encode(message: Any) -> bytes:
    """Return a message as msgpack."""
    return bytes(msgpack.packb(message, default=_array_out) or b"")


def decode(data: bytes | str) -> Any:
    """Return the message in a packet.

    Raises:
        ValueError: it is none.
    """
    if isinstance(data, str):
        raise ValueError("a text message; valid: binary messages")
    try:
        return msgpack.unpackb(data, object_hook=_array_in)
    except (msgpack.UnpackException, TypeError, KeyError, OverflowError) as error:
        raise ValueError(f"not a msgpack message: {error}") from error


def _array_out(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        described = {"dtype": little.dtype.str, "shape": little.shape, "data": little.tobytes()}
        return {"__array__": described}
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _array_in(value: dict[Any, Any]) -> Any:
    if "__array__" not in value:
        return value
    array = value["__array__"]
    name, shape = array["dtype"], array["shape"]
    # NumPy takes a dtype for an expression, whose errors are of any type.
    if not isinstance(name, str) or not re.fullmatch(r"[<>|=]?[?biuf][1-8]?", name):
        raise ValueError(f"an array of {name!r:.100}; valid: of numbers, such as '<f4'")
    if not isinstance(shape, list) or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError(f"an array of shape {shape!r:.100}")
    return np.frombuffer(array["data"], np.dtype(name)).reshape(shape)


def serve(make_policy: Callable[[], Any], host: str = "127.0.0.1", port: int = 8765) -> None:
    """Serve until interrupted; every connection has a policy of its own.

    Args:
        make_policy: makes an object with `reset(episode)` and `act(observation)`.
        port: port to listen on; 0 takes a free one. It is printed.
    """
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.server import serve as listen

    def handle(connection: Any) -> None:
        policy = make_policy()
        hello = {"protocol": PROTOCOL, "images": getattr(policy, "images", True)}
        connection.send(encode(hello | {"version": getattr(policy, "version", "")}))
        while True:
            try:
                data = connection.recv()
            except ConnectionClosed:
                return  # the client has finished, or is gone
            try:
                message = decode(data)
                if message["type"] == "reset":
                    policy.reset(message["episode"])
                    answer: dict[str, Any] = {}
                elif message["type"] == "act":
                    answer = {"action": policy.act(message["observation"])}
                    if getattr(policy, "said", ""):
                        answer["said"] = str(policy.said)
                else:
                    answer = {"error": f"unknown message type {message['type']!r}"}
            except Exception as error:
                log.exception("the policy failed")
                answer = {"error": f"{type(error).__name__}: {error}"}
            connection.send(encode(answer))

    with listen(handle, host, port, max_size=LARGEST_OBSERVATION_BYTES, compression=None) as server:
        print(f"serving on ws://{host}:{server.socket.getsockname()[1]}", flush=True)  # noqa: T201
        server.serve_forever()
