"""The navigation client drives a simulated robot by our servers, over the real wire."""

import math
import runpy
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

pytest.importorskip("websockets")

from vlnpe.collectors.locomotion.contract import write_deployment
from vlnpe.collectors.locomotion.runtime.observation import states_of
from vlnpe.collectors.robots import POLICY_DECIMATION, RobotHandles, get_robot
from vlnpe.evaluation.http.server import DualServer, listen
from vlnpe.evaluation.server import serve

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
GOAL_M = np.array([0.75, 0.35])


@pytest.fixture(scope="module")
def client() -> SimpleNamespace:
    return SimpleNamespace(**runpy.run_path(str(EXAMPLES / "navigation_client.py")))


class Walker:
    """An Aliengo in MuJoCo behind cmd_vel, walked by the example's loop from its sensors."""

    def __init__(self, folder: Path) -> None:
        loop = runpy.run_path(str(EXAMPLES / "gait_loop.py"))
        robot = get_robot("aliengo")
        if not (folder / "aliengo.json").exists():
            write_deployment(robot, folder)
        self.loop = loop["GaitLoop"](folder / "aliengo.json")
        self.interface = loop["VelocityInterface"](self.loop.card)
        self.model = robot.build_model()
        self.data, self.handles = mujoco.MjData(self.model), RobotHandles.find(robot, self.model)
        self.handles.spawn(self.data)
        self.commands: list[tuple[float, ...]] = []
        self.delay_s = 0.0
        self.sleep(0.5)

    def now(self) -> float:
        return float(self.data.time)

    def age_s(self) -> float:
        return self.delay_s

    def sleep(self, seconds: float) -> None:
        data, h = self.data, self.handles
        for _ in range(max(1, round(seconds / 0.02))):
            state = states_of(data.qpos[None], data.qvel[None], h)
            data.ctrl[h.actuators] = self.loop.step(
                data.qpos[3:7],
                state.angular_velocity_rad_s[0],
                state.linear_velocity_m_s[0],
                data.qpos[h.joint_qpos],
                data.qvel[h.joint_dof],
                self.interface.get(data.time),
            )
            mujoco.mj_step(self.model, data, nstep=POLICY_DECIMATION)
        time.sleep(0.002)  # the server's turn

    def pose(self) -> tuple[float, float, float]:
        x, y, _, w, _, _, k = self.data.qpos[:7]
        return x, y, 2.0 * math.atan2(k, w)

    def images(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full((8, 8, 3), 90, np.uint8), np.full((8, 8), 1.5)

    def send(self, *velocity: float) -> None:
        self.commands.append(velocity)
        self.interface.put(*velocity, self.data.time)


@pytest.fixture
def walker(tmp_path_factory: pytest.TempPathFactory) -> Walker:
    return Walker(tmp_path_factory.getbasetemp())


class ToGoal:
    """Turns to the goal and walks there, by the pose that the client sends."""

    images, version, blind = True, "to goal", False

    def reset(self, assignment: Any) -> None:
        known = assignment if isinstance(assignment, dict) else vars(assignment)
        self.kind = known["actions"]

    def act(self, observation: Any) -> Any:
        if not isinstance(observation, dict):
            observation = vars(observation)
        assert observation["rgb"].shape == (8, 8, 3)
        assert abs(float(np.median(observation["depth_m"])) - 1.5) < 1e-3
        x, y, yaw = observation["pose"]
        ahead = GOAL_M - (x, y)
        if np.hypot(*ahead) < 0.2:
            return 0
        turn = math.remainder(math.atan2(ahead[1], ahead[0]) - yaw, math.tau)
        if self.kind == "velocity":
            return np.array([0.4 if abs(turn) < 0.4 else 0.0, 0.0, 1.5 * turn])
        if self.kind == "waypoints":
            return np.array([[0.0, 0.0, turn], [min(0.4, float(np.hypot(*ahead))), 0.0, 0.0]])
        return 1 if abs(turn) < math.radians(8) else 2 if turn > 0 else 3


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Serve a policy on a free port and return its address."""
    from websockets.sync import server as module

    servers, listen = [], module.serve

    def kept(*args: Any, **options: Any) -> Any:
        servers.append(listen(*args, **options))
        return servers[-1]

    monkeypatch.setattr(module, "serve", kept)

    def start(policy: Callable[[], Any]) -> str:
        count = len(servers)
        threading.Thread(target=serve, args=(policy, "127.0.0.1", 0), daemon=True).start()
        while len(servers) == count:
            time.sleep(0.01)
        return f"ws://127.0.0.1:{servers[-1].socket.getsockname()[1]}"

    yield start
    for server in servers:
        server.shutdown()


def at_rest(walker: Walker) -> bool:
    walker.sleep(1.0)
    return bool(np.abs(walker.data.qvel[:6]).max() < 0.1)


@pytest.mark.parametrize("kind", ["discrete", "velocity", "waypoints"])
def test_it_walks_to_the_goal_of_a_socket_policy(kind: str, client, walker, serving) -> None:
    server = client.connect(serving(ToGoal))
    count = client.Client(walker, server).run("Go to the door.", kind)
    server.close()
    assert walker.commands[-1] == client.ZERO
    assert at_rest(walker)
    assert np.hypot(*(walker.pose()[:2] - GOAL_M)) < 0.25
    assert count >= 3


def test_it_walks_to_the_goal_of_eval_dual(client, walker) -> None:
    server = listen(DualServer(ToGoal()), "127.0.0.1", 0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        address = f"http://127.0.0.1:{server.server_port}/eval_dual"
        client.Client(walker, client.connect(address)).run("Go to the door.")
    finally:
        server.shutdown()
        server.server_close()
    assert at_rest(walker)
    assert np.hypot(*(walker.pose()[:2] - GOAL_M)) < 0.25


def test_a_trajectory_is_followed_for_half_a_metre(client) -> None:
    here = np.zeros(3)
    for step in client.along(np.array([[0.01, 0], [0.3, 0], [0.3, 0.3], [3, 3]])):
        here = client.composed(here, step)
    np.testing.assert_allclose(here, [0.3, 0.3, math.pi / 2], atol=1e-9)


def test_a_late_answer_halts_the_robot_and_then_fails(client, walker, serving) -> None:
    released = threading.Event()

    class Slow(ToGoal):
        def act(self, observation: Any) -> Any:
            if observation["step"] == 5:
                released.wait(60)
            return super().act(observation)

    server = client.connect(serving(Slow))
    limits = client.Limits(answer_s=2.0)
    with pytest.raises(client.LateError, match="no answer in 2 s"):
        client.Client(walker, server, limits).run("Go.", "velocity")
    released.set()
    # It walked before, and stood while it waited.
    assert max(v for v, _, _ in walker.commands) == 0.4
    assert at_rest(walker)


def test_late_sensors_halt_the_robot(client, walker, serving) -> None:
    server, send = client.connect(serving(ToGoal)), walker.send

    def stalls(*velocity: float) -> None:
        send(*velocity)
        walker.delay_s = 0.6 * (len(walker.commands) > 8)

    walker.send = stalls
    with pytest.raises(client.LateError, match=r"odometry is 0\.60 s old"):
        client.Client(walker, server).run("Go.")
    assert walker.commands[-1] == client.ZERO and at_rest(walker)


def test_velocities_are_limited_and_numbers(client, walker) -> None:
    driver = client.Client(walker, None)
    driver.send((9.0, -9.0, 9.0))
    assert walker.commands[-1] == (0.5, -0.2, 0.8)
    driver.send((math.nan, 0.0, 0.0))
    assert walker.commands[-1] == client.ZERO


def test_the_velocity_interface_forgets_old_commands(walker) -> None:
    interface = walker.interface
    interface.put(5.0, 0.1, math.inf, 10.0)
    assert not interface.get(10.1).any()
    interface.put(5.0, 0.1, 0.0, 10.0)
    np.testing.assert_array_equal(interface.get(10.4), [1.0, 0.1, 0.0])
    assert not interface.get(10.6).any() and not interface.get(9.9).any()
    assert interface.upright((1.0, 0.0, 0.0, 0.0))
    assert not interface.upright((math.cos(0.2), math.sin(0.2), 0.0, 0.0))  # 23° of roll


def test_messages_of_ros_become_pixels(client) -> None:
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    padded = np.concatenate([rgb.reshape(2, 12), np.zeros((2, 4), np.uint8)], axis=1)
    message = SimpleNamespace(
        height=2, width=4, step=16, is_bigendian=0, encoding="bgr8", data=padded.tobytes()
    )
    np.testing.assert_array_equal(client.pixels(message, np.uint8, 3), rgb)
    depth = np.array([[1500, 0], [700, 65535]], ">u2")
    message = SimpleNamespace(
        height=2, width=2, step=4, is_bigendian=1, encoding="16UC1", data=depth.tobytes()
    )
    np.testing.assert_array_equal(client.pixels(message, np.uint16, 1)[..., 0], depth)
    robot = client.Ros2Robot.__new__(client.Ros2Robot)
    now = time.monotonic()
    color = SimpleNamespace(
        height=2, width=2, step=6, is_bigendian=0, encoding="bgr8", data=bytes(range(12))
    )
    robot.last = {"rgb": (now, color), "depth": (now, message)}
    assert robot.age_s() == math.inf
    seen, depth_m = robot.images()
    assert seen[0, 0].tolist() == [2, 1, 0]
    np.testing.assert_allclose(depth_m, [[1.5, 0.0], [0.7, 65.535]])
