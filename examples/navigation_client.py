"""Drive a robot by a model: camera and odometry in, a policy server's answers, cmd_vel out.

    python examples/navigation_client.py ws://HOST:8765 "Walk past the sofa and stop at the door."
    python examples/navigation_client.py http://HOST:5801 "Walk past the sofa and stop at the door."

speaks to a vlnpe policy server, or to anything that answers `POST /eval_dual`. Copy this file: it
needs numpy, Pillow, msgpack and websockets, and for a robot rclpy. `Ros2Robot` reads and commands
a robot over ROS 2; any object with its methods will do. Velocities are limited here. The robot
halts if an answer, a picture or the odometry is late, when the program ends, and on STOP.
"""

import argparse
import io
import json
import math
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

STOP, FORWARD, LEFT, RIGHT = 0, 1, 2, 3
ZERO = (0.0, 0.0, 0.0)


@dataclass
class Limits:
    """Bounds of what is sent, and how long anything may take."""

    vx_m_s: tuple = (-0.2, 0.5)
    vy_m_s: tuple = (-0.2, 0.2)
    yaw_rad_s: tuple = (-0.8, 0.8)
    stale_s: float = 0.5  # sensors older than this halt the robot
    hold_s: float = 0.5  # a velocity is not held longer while an answer is awaited
    answer_s: float = 30.0
    motion_s: float = 5.0  # for one action or waypoint
    actions: int = 500


class LateError(Exception):
    """Sensors or the server gave nothing in time; the robot was halted."""


class Client:
    """Carries out a server's actions with a robot."""

    def __init__(self, robot, server, limits=None, tick_s=0.05):
        self.robot, self.server, self.tick_s = robot, server, tick_s
        self.limits = limits or Limits()

    def run(self, instruction, actions="discrete"):
        """Follow an instruction; return the number of answers until STOP.

        Args:
            actions: kind that a WebSocket server is asked for: discrete, velocity or waypoints.

        Raises:
            LateError: something was late, or a motion or the whole took too long.
        """
        try:
            start, count, previous = self.pose(), 0, -1
            self.server.reset(instruction, actions)
            while count < self.limits.actions:
                here = self.pose()
                rgb, depth_m = self.robot.images()
                observation = {
                    "rgb": np.asarray(rgb, np.uint8),
                    "depth_m": np.asarray(depth_m, np.float32),
                    "instruction": instruction,
                    "pose": relative(start, here),
                    "previous_action": previous,
                    "step": count,
                }
                answer = self.wait_for(lambda seen=observation: self.server.act(seen))
                previous, count = answer["action"], count + 1
                for motion in motions(answer):
                    if isinstance(motion, str):
                        return count
                    if answer["kind"] == "velocity":
                        self.hold(motion)
                    else:
                        here = composed(here, motion)
                        self.go_to(here)
            raise LateError(f"no STOP within {count} answers")
        finally:
            self.send(ZERO)

    def pose(self):
        """Return x, y [m] and yaw [rad] of the odometry, (3,)."""
        if self.robot.age_s() > self.limits.stale_s:
            self.send(ZERO)
            raise LateError(f"camera or odometry is {self.robot.age_s():.2f} s old")
        return np.asarray(self.robot.pose(), float)

    def send(self, velocity):
        """Command a velocity within the limits; anything that is no number halts."""
        bounds = (self.limits.vx_m_s, self.limits.vy_m_s, self.limits.yaw_rad_s)
        if not np.isfinite(velocity).all():
            velocity = ZERO
        self.robot.send(
            *(min(max(float(v), lo), hi) for v, (lo, hi) in zip(velocity, bounds, strict=True))
        )

    def wait_for(self, ask):
        """Return what the server answers; meanwhile a velocity lasts `hold_s` at most."""
        start_s, pool = self.robot.now(), ThreadPoolExecutor(1)
        try:
            answer = pool.submit(ask)
            while not answer.done():
                waited_s = self.robot.now() - start_s
                if waited_s > self.limits.hold_s:
                    self.send(ZERO)
                if waited_s > self.limits.answer_s:
                    raise LateError(f"the server gave no answer in {self.limits.answer_s:g} s")
                self.robot.sleep(self.tick_s)
            return answer.result()
        finally:
            pool.shutdown(wait=False)

    def hold(self, velocity, seconds=0.25):
        """Hold a velocity for a while."""
        end_s = self.robot.now() + seconds
        while self.robot.now() < end_s:
            self.pose()  # which halts the robot if sensors are late
            self.send(velocity)
            self.robot.sleep(self.tick_s)

    def go_to(self, goal):
        """Walk to a pose (3,) of the odometry and halt."""
        end_s = self.robot.now() + self.limits.motion_s
        while True:
            ahead, left, turn = relative(self.pose(), goal)
            if abs(ahead) < 0.05 and abs(left) < 0.1 and abs(turn) < 0.05:
                return self.send(ZERO)
            if self.robot.now() > end_s:
                raise LateError(f"{goal} was not reached in {self.limits.motion_s:g} s")
            self.send((slow(ahead, 0.4, 0.15), slow(left, 0.2, 0.1), slow(turn, 0.6, 0.2)))
            self.robot.sleep(self.tick_s)


def motions(answer):
    """Return the motions in an answer: arrays (3,), and "stop" for STOP."""
    step, turn = 0.25, math.radians(15)
    table = {FORWARD: (step, 0, 0), LEFT: (0, 0, turn), RIGHT: (0, 0, -turn)}
    action = answer["action"]
    if answer["kind"] == "discrete" or np.ndim(action) == 0:
        each = np.atleast_1d(action).tolist()
        if not set(each) <= {STOP, *table}:
            raise ValueError(f"the server answered {action}; valid: 0, 1, 2, 3")
        return ["stop" if a == STOP else np.array(table[a]) for a in each]
    return list(np.reshape(np.asarray(action, float), (-1, 3)))


def slow(error, most, least):
    """Return a velocity that falls with the distance left, but not below what a gait can walk."""
    speed = min(max(2.0 * abs(error), least), most) if abs(error) > 0.02 else 0.0
    return math.copysign(speed, error)


def wrap(angle):
    return math.remainder(angle, math.tau)


def turned(vector, angle):
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])


def relative(start, pose):
    """Return a pose as seen from another one."""
    x, y = turned(np.asarray(pose)[:2] - np.asarray(start)[:2], -start[2])
    return np.array([x, y, wrap(pose[2] - start[2])])


def composed(start, motion):
    """Return the pose that is `motion` away from `start`, as seen from there."""
    return np.array([*(start[:2] + turned(motion[:2], start[2])), wrap(start[2] + motion[2])])


class WebSocketServer:
    """A vlnpe policy server, ws://HOST:PORT."""

    def __init__(self, url, timeout_s=30.0):
        from websockets.sync.client import connect

        self.timeout_s = timeout_s
        self.connection = connect(url, open_timeout=timeout_s, max_size=1 << 20, compression=None)
        hello = self.receive()
        if hello.get("protocol") != "vlnpe-policy/1":
            raise ValueError(f"{url} speaks {hello.get('protocol')}; valid: vlnpe-policy/1")

    def reset(self, instruction, actions):
        names = dict.fromkeys(("episode_id", "scene_id", "robot", "controller"), "real")
        self.kind = actions
        self.ask({"type": "reset", "episode": names | {"instruction": instruction,
                                                       "actions": actions}})  # fmt: skip

    def act(self, observation):
        answer = self.ask({"type": "act", "observation": observation})
        return {"action": answer["action"], "kind": self.kind}

    def ask(self, message):
        import msgpack

        self.connection.send(bytes(msgpack.packb(message, default=array_out) or b""))
        return self.receive()

    def receive(self):
        import msgpack

        answer = msgpack.unpackb(self.connection.recv(self.timeout_s), object_hook=array_in)
        if "error" in answer:
            raise RuntimeError(f"the server failed: {answer['error']}")
        return answer

    def close(self):
        self.connection.close()


def array_out(value):
    value = np.asarray(value)
    little = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
    entry = {"dtype": little.dtype.str, "shape": little.shape, "data": little.tobytes()}
    return {"__array__": entry}


def array_in(value):
    array = value.get("__array__")
    if array is None:
        return value
    return np.frombuffer(array["data"], np.dtype(array["dtype"])).reshape(array["shape"])


class DualServer:
    """A model behind POST /eval_dual, http://HOST:PORT."""

    def __init__(self, url, timeout_s=30.0):
        self.url, self.timeout_s = url.rstrip("/").removesuffix("/eval_dual"), timeout_s
        self.opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))

    def reset(self, instruction, actions):
        self.first = True

    def act(self, observation):
        from PIL import Image

        words = {"reset": self.first, "idx": observation["step"],
                 "instruction": observation["instruction"],
                 "pose": observation["pose"].tolist()}  # fmt: skip
        image, depth = io.BytesIO(), io.BytesIO()
        Image.fromarray(observation["rgb"]).save(image, "JPEG", quality=95)
        codes = np.rint(np.clip(observation["depth_m"], 0.0, 6.5535) * 1e4).astype(np.uint16)
        Image.fromarray(codes).save(depth, "PNG")
        parts = [
            ('name="image"; filename="rgb.jpg"', "image/jpeg", image.getvalue()),
            ('name="depth"; filename="depth.png"', "image/png", depth.getvalue()),
            ('name="json"', "application/json", json.dumps(words).encode()),
        ]
        mark, body = "vlnpe-navigation-client", b""
        for name, kind, data in parts:
            head = f"--{mark}\r\nContent-Disposition: form-data; {name}\r\nContent-Type: {kind}"
            body += head.encode() + b"\r\n\r\n" + data + b"\r\n"
        request = urllib.request.Request(
            f"{self.url}/eval_dual",
            body + f"--{mark}--\r\n".encode(),
            {"Content-Type": f"multipart/form-data; boundary={mark}"},
        )
        with self.opener.open(request, timeout=self.timeout_s) as response:
            reply = json.load(response)
        self.first = False
        if "discrete_action" in reply:
            return {"action": reply["discrete_action"], "kind": "discrete"}
        return {"action": along(np.asarray(reply["trajectory"], float)[:, :2]), "kind": "waypoints"}

    def close(self):
        pass


def along(points_m, reach_m=0.5):
    """Return waypoints (K, 3), each seen from the one before, along a trajectory's first part."""
    here, yaw, walked_m, steps = np.zeros(2), 0.0, 0.0, []
    for point in points_m:
        length_m = float(np.hypot(*(point - here)))
        if length_m < 0.05:
            continue
        if walked_m >= reach_m:
            break
        turn = wrap(math.atan2(*(point - here)[::-1]) - yaw)
        steps += [(0.0, 0.0, turn), (length_m, 0.0, 0.0)]
        here, yaw, walked_m = point, yaw + turn, walked_m + length_m
    return np.array(steps or [ZERO])


class Ros2Robot:
    """A robot over ROS 2: colour and aligned depth, odometry, and a Twist out."""

    def __init__(
        self,
        color="/camera/camera/color/image_raw",
        depth="/camera/camera/aligned_depth_to_color/image_raw",
        odometry="/odom",
        command="/cmd_vel",
    ):
        import rclpy  # pyright: ignore[reportMissingImports]
        from geometry_msgs.msg import Twist  # pyright: ignore[reportMissingImports]
        from nav_msgs.msg import Odometry  # pyright: ignore[reportMissingImports]
        from rclpy.qos import qos_profile_sensor_data  # pyright: ignore[reportMissingImports]
        from sensor_msgs.msg import Image  # pyright: ignore[reportMissingImports]

        rclpy.init()
        self.rclpy, self.Twist = rclpy, Twist
        self.node = rclpy.create_node("vlnpe_navigation_client")
        self.last = {}
        for name, kind, topic in (
            ("rgb", Image, color),
            ("depth", Image, depth),
            ("odom", Odometry, odometry),
        ):
            self.node.create_subscription(
                kind, topic, lambda m, n=name: self.take(n, m), qos_profile_sensor_data
            )
        self.publisher = self.node.create_publisher(Twist, command, 1)
        end_s = time.monotonic() + 10.0
        while len(self.last) < 3 and time.monotonic() < end_s:
            self.sleep(0.05)

    def take(self, name, message):
        self.last[name] = (time.monotonic(), message)

    def now(self):
        return time.monotonic()

    def sleep(self, seconds):
        """Let messages arrive for a while."""
        end_s = time.monotonic() + seconds
        while (left := end_s - time.monotonic()) > 0:
            self.rclpy.spin_once(self.node, timeout_sec=left)

    def age_s(self):
        """Return the age of the oldest of picture, depth and odometry; inf before all are there."""
        if len(self.last) < 3:
            return math.inf
        return time.monotonic() - min(arrived for arrived, _ in self.last.values())

    def images(self):
        """Return RGB (H, W, 3) uint8 and depth (H, W) [m], 0 = not measured."""
        color, depth = self.last["rgb"][1], self.last["depth"][1]
        rgb = pixels(color, np.uint8, 3)
        if color.encoding == "bgr8":
            rgb = rgb[..., ::-1]
        elif color.encoding != "rgb8":
            raise ValueError(f"colour is {color.encoding}; valid: rgb8, bgr8")
        if depth.encoding == "16UC1":
            return rgb, 0.001 * pixels(depth, np.uint16, 1)[..., 0]
        if depth.encoding == "32FC1":
            return rgb, np.nan_to_num(pixels(depth, np.float32, 1)[..., 0], posinf=0.0)
        raise ValueError(f"depth is {depth.encoding}; valid: 16UC1 [mm], 32FC1 [m]")

    def pose(self):
        where = self.last["odom"][1].pose.pose
        p, q = where.position, where.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
        return p.x, p.y, yaw

    def send(self, vx, vy, yaw):
        twist = self.Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = vx, vy, yaw
        self.publisher.publish(twist)


def pixels(message, dtype, channels):
    """Return an Image message's pixels (H, W, C); rows may be padded."""
    order = ">" if message.is_bigendian else "<"
    kind = np.dtype(dtype).newbyteorder(order)
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    wide = message.width * channels * kind.itemsize
    values = np.ascontiguousarray(rows[:, :wide]).view(kind)
    return values.reshape(message.height, message.width, channels)


def connect(url):
    return WebSocketServer(url) if url.startswith("ws") else DualServer(url)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("server")
    parser.add_argument("instruction")
    parser.add_argument("--actions", default="discrete", help="discrete, velocity or waypoints")
    parser.add_argument("--odometry", default="/odom")
    given = parser.parse_args()
    client = Client(Ros2Robot(odometry=given.odometry), connect(given.server))
    print("stopped after", client.run(given.instruction, given.actions), "answers")
