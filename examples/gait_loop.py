"""Run a gait from sensor values, with numpy alone: the loop to port to a robot's computer.

    vlnpe robots --card h1 --out card
    python examples/gait_loop.py card/h1.json card/h1-walk.npz

reads the card, the network beside it and a recorded walk, and prints how many of its joint targets
it reproduced exactly. Call `GaitLoop.step` 50 times a second; docs/guides/real-robot.md says what
else a robot needs. Nothing here is fast: 2 ms a step.
"""

import json
import math
import sys
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

FACTORS = [f for n in (1, 2, 3) for f in combinations_with_replacement(range(3), n)]


class GaitLoop:
    """One robot's gait: remembers its clock, its last action and the steps before."""

    def __init__(self, card_file):
        card = self.card = json.loads(Path(card_file).read_text())
        self.layers = read_layers(Path(card_file).with_suffix(".safetensors"))
        if any(name == "height_scan_m" for name, _ in card["observation"]):
            raise ValueError(f"{card_file}: the gait sees stairs; this loop does not")
        limits = card["deployment"]["safety"]["command"]
        self.limits = [limits[axis] for axis in ("vx_m_s", "vy_m_s", "yaw_rad_s")]
        self.default = np.array(card["default_joint_rad"])
        self.joints = len(card["joints"])  # those that the network moves; they come first
        self.motion = {
            key: np.array(card["gait"][key] or np.zeros_like(card["gait"]["swing_rad"]))
            for key in ("swing_rad", "stance_rad", "forward_rad", "left_rad", "turn_rad")
        }
        # The observation ends with the joints and the actions of so many steps before.
        self.past = sum(name.startswith("previous_action_") for name, _ in card["observation"])
        self.reset()

    def reset(self):
        """Forget everything; call before the first step."""
        self.command, self.phase, self.steps_left = [0.0, 0.0, 0.0], 0.0, 0
        self.moving, self.catching = False, 0
        self.action, self.recent = np.zeros(self.joints), None

    def step(self, quat_wxyz, gyro_rad_s, velocity_base_m_s, joint_rad, joint_rad_s, command):
        """Return the joint targets (J,) [rad] for the next 20 ms, in the card's order.

        Args:
            quat_wxyz, gyro_rad_s: the IMU's attitude and angular velocity, turned into the base.
            velocity_base_m_s: estimate of the base's velocity in its own frame.
            joint_rad, joint_rad_s: (J,) positions and velocities, in the card's order.
            command: vx, vy [m/s] and yaw rate [rad/s]; nearly zero means "stand still".
        """
        command = self.catch(velocity_base_m_s, command)
        wanted = [
            min(max(float(c), lo), hi) for c, (lo, hi) in zip(command, self.limits, strict=True)
        ]
        moving = self.moving = self.tick(wanted)
        asked = self.aim(self.command)
        angle = 2.0 * math.pi * self.phase
        w, x, y, z = (float(q) for q in quat_wxyz)
        gravity = (2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0)
        phase = (math.sin(angle), math.cos(angle)) if moving else (0.0, 0.0)
        n = self.joints
        now = np.concatenate(
            [np.asarray(joint_rad)[:n] - self.default[:n], np.asarray(joint_rad_s)[:n], self.action]
        )
        self.recent = [now, *(self.recent or [now] * self.past)][: self.past + 1]
        seen = [velocity_base_m_s, gyro_rad_s, gravity, asked, phase, *self.recent]
        output = self.network(np.concatenate(seen).astype(np.float32))
        clip = self.card["action_clip"]
        self.action = np.clip(output.astype(np.float64), -clip, clip)
        targets = self.default + self.reference(asked, moving)
        targets[:n] += self.card["action_scale_rad"] * self.action
        return targets

    def walks(self, command):
        """Return whether a command asks for walking."""
        vx, vy, yaw = command
        linear_m_s, yaw_rad_s = (
            self.card["gait"][f"stand_{k}"] for k in ("linear_m_s", "yaw_rad_s")
        )
        return math.hypot(vx, vy) > linear_m_s or abs(yaw) > yaw_rad_s

    def catch(self, velocity_base_m_s, command):
        """Return the command; a standing robot that was pushed walks after its base instead."""
        gait, (vx, vy, _) = self.card["gait"], velocity_base_m_s
        if self.walks(command):
            self.catching = 0
        elif self.catching > 0:
            self.catching -= 1
            return list(self.command)
        elif not self.moving and math.hypot(vx, vy) > (gait.get("catch_m_s") or math.inf):
            self.catching = round(gait["catch_s"] * self.card["rate_hz"]) - 1
            self.command = [0.0, 0.0, 0.0]
            return [gait["catch_share"] * vx, gait["catch_share"] * vy, command[2]]
        return command

    def tick(self, wanted):
        """Follow the command no faster than the gait brakes; return whether the robot steps."""
        gait, rate_hz = self.card["gait"], self.card["rate_hz"]
        brakes = [gait["brake_m_s2"], gait["brake_m_s2"], gait["brake_rad_s2"]]
        for axis, brake in enumerate(brakes):
            most = math.inf if brake is None else brake / rate_hz
            old, new = self.command[axis], wanted[axis]
            if abs(new) < abs(old) or new * old < 0.0:
                new = old + min(max(new - old, -most), most)
            self.command[axis] = new
        phase = self.phase + gait["frequency_hz"] / rate_hz
        moving = self.walks(self.command)
        if moving:
            self.steps_left = gait["last_steps"]
        elif self.steps_left > 0:
            self.steps_left -= math.floor(2.0 * phase) > math.floor(2.0 * self.phase)
            moving = self.steps_left > 0
        self.phase = phase % 1.0 if moving else 0.0
        return moving

    def aim(self, command):
        """Return what must be asked for to reach a command, by the card's calibration."""
        asked, gait = list(command), self.card["gait"]
        if not gait["aim"]:
            return asked
        terms = []
        for factors in FACTORS:
            term = 1.0
            for axis in factors:
                term *= command[axis]
            terms.append(term)
        for axis in range(3):
            for coefficient, term in zip(gait["aim"][axis], terms, strict=True):
                asked[axis] += coefficient * term
            low, high = gait["aim_limits"][axis]
            asked[axis] = min(max(asked[axis], low), high)
        return asked

    def reference(self, asked, moving):
        """Return the joint offsets (J,) [rad] of the stepping motion, which actions add to."""
        gait, motion = self.card["gait"], self.motion
        offsets = np.array(gait["stand_rad"])
        if not moving:
            return offsets
        vx, vy, yaw = asked
        ahead = gait["turn_lead_s"] * yaw
        for f, (x, y) in enumerate(gait["foot_xy_m"]):
            lead = gait["foot_offsets"][f] + gait["lead_cycles"]
            angle = 2.0 * math.pi * (self.phase + lead)
            sine, cosine = math.sin(angle), math.cos(angle)
            bump = sine * sine
            swing = bump if sine > 0.0 else 0.0
            forward = cosine * (vx - ahead * vy - yaw * y)
            left = cosine * (vy + ahead * vx + yaw * x)
            offsets = offsets + (
                swing * motion["swing_rad"][f]
                + (bump - swing) * motion["stance_rad"][f]
                + forward * motion["forward_rad"][f]
                + left * motion["left_rad"][f]
                + cosine * yaw * motion["turn_rad"][f]
            )
        return offsets

    def network(self, values):
        """Return the network's output; every sum in float32, the bias first, in order of inputs."""
        for k, (columns, bias) in enumerate(self.layers):
            total = bias
            for column, value in zip(columns, values, strict=True):
                total = total + column * value
            if k < len(self.layers) - 1:
                total = np.array(
                    [np.float32(math.exp(v) - 1.0) if v < 0.0 else v for v in total.tolist()],
                    np.float32,
                )
            values = total
        return values

    def to_motors(self, values, unused=0.0):
        """Return values (J,) in the order of the maker's motors; the others get `unused`."""
        sdk = self.card["deployment"]["sdk"]
        if sdk is None:
            raise ValueError(f"the card of {self.card['robot']} knows no motor indices")
        motors = np.full(sdk["slots"], unused)
        for joint, value in zip(self.card["deployment"]["joints"], values, strict=True):
            motors[joint["motor"]] = value
        return motors


class VelocityInterface:
    """Between cmd_vel and the gait: limits, and zero when commands fail to come."""

    def __init__(self, card, timeout_s=0.5):
        safety = card["deployment"]["safety"]
        limits = [safety["command"][axis] for axis in ("vx_m_s", "vy_m_s", "yaw_rad_s")]
        self.low, self.high = np.array(limits).T
        self.roll_rad, self.pitch_rad = safety["roll_rad"], safety["pitch_rad"]
        self.timeout_s, self.command, self.since_s = timeout_s, np.zeros(3), -math.inf

    def put(self, vx_m_s, vy_m_s, yaw_rad_s, now_s):
        """Take a command; one that is not finite counts as zero."""
        command = np.array([vx_m_s, vy_m_s, yaw_rad_s], float)
        finite = np.isfinite(command).all()
        self.command = np.clip(command, self.low, self.high) if finite else np.zeros(3)
        self.since_s = now_s

    def get(self, now_s):
        """Return the command (3,) for the gait: zero once the last one is too old."""
        late = not 0.0 <= now_s - self.since_s <= self.timeout_s
        return np.zeros(3) if late else self.command

    def upright(self, quat_wxyz):
        """Return whether roll and pitch are within the card's limits; cut the motors if not."""
        w, x, y, z = quat_wxyz
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = math.asin(min(max(2.0 * (w * y - x * z), -1.0), 1.0))
        return abs(roll) <= self.roll_rad and abs(pitch) <= self.pitch_rad


def read_layers(path):
    """Return the columns (inputs, outputs) and the bias of each layer in a safetensors file."""
    content = Path(path).read_bytes()
    start = 8 + int.from_bytes(content[:8], "little")
    tensors = {}
    for name, entry in json.loads(content[8:start]).items():
        if name != "__metadata__":
            first, end = entry["data_offsets"]
            values = np.frombuffer(content[start + first : start + end], "<f4")
            tensors[name] = values.reshape(entry["shape"])
    return [
        (np.ascontiguousarray(tensors[f"weight_{k}"].T), tensors[f"bias_{k}"])
        for k in range(len(tensors) // 2)
    ]


def main(card, recording):
    loop, walk = GaitLoop(card), np.load(recording, allow_pickle=False)
    inputs = ("quat_wxyz", "gyro_rad_s", "velocity_base_m_s", "joint_rad", "joint_rad_s", "command")
    rows = zip(*(walk[key] for key in inputs), strict=True)
    targets = np.array([loop.step(*row) for row in rows])
    same = (targets == walk["target_rad"]).all(axis=1)
    print(f"{loop.card['robot']}: {same.sum()} of {len(same)} steps bit-identical")
    return 0 if same.all() else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
