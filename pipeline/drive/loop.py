"""Real time: physics, the robot's camera and the person's words, in one thread."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ...collectors.driving.drive import Drive
from ...evaluation.observation import Eye
from ...formats.core.errors import InputError
from ...formats.core.rollout import EndReason
from .desk import Desk

STEP_S = 0.02
FRAME_S = 0.08  # 12.5 pictures a second
BEHIND_S = 0.2  # what is later than this is not caught up with
UNDO_S = 3.0
JPEG_QUALITY = 85
KEPT, LEFT = "kept", "left"
SAID = {
    EndReason.SUCCESS: "Arrived.",
    EndReason.STOPPED_FAR: "Stopped, farther than {success_m:g} m from the goal.",
    EndReason.FALL: "The robot fell.",
    EndReason.STUCK: "Stuck: it got nowhere for a while.",
    EndReason.TIMEOUT: "Out of time: 500 actions.",
    EndReason.DIVERGED: "Physics diverged.",
}


@dataclass
class Seat:
    """A drive in front of a person.

    Attributes:
        title: such as `2 of 7`.
        free: without an instruction.
    """

    drive: Drive
    eye: Eye
    title: str
    free: bool


def drive_live(seat: Seat, desk: Desk, clock: Callable[[], float] = time.monotonic) -> str:
    """Drive in real time until the drive is kept, or the person leaves.

    Returns:
        `KEPT` or `LEFT`. A drive that was left can be gone on with.
    """
    drive, run = seat.drive, seat.drive.run
    paused, moved, note, jpeg, drawn = False, False, "", b"", None
    pace: deque[tuple[float, float]] = deque(maxlen=round(2.0 / STEP_S))
    due_s = frame_s = clock()
    heard, answer_ms = desk.heard, 0.0
    while True:
        for word in desk.words():
            note = ""
            if word == "pause":
                paused = not paused
            elif word == "close":
                return LEFT
            elif word == "keep" and drive.end is not None:
                try:
                    drive.keep(drive.own_episode if seat.free else run.episode)
                except InputError as error:
                    note = str(error)
                    continue
                return KEPT
            elif word in ("undo", "reset"):
                before_s = drive.time_s
                drive.undo(UNDO_S if word == "undo" else before_s)
                note = f"{before_s - drive.time_s:.1f} s taken back"
                paused = False
        due_s = max(due_s, clock() - BEHIND_S)
        for _ in range(round(BEHIND_S / STEP_S)):  # all that is due, before the next picture
            moved = not paused and drive.step()
            due_s += STEP_S
            if due_s > clock():
                break
        now_s = clock()
        if desk.heard != heard:
            heard = desk.heard
            answer_ms = round(1e3 * (now_s - heard[1]), 1)
        if moved:
            pace.append((now_s, drive.time_s))
        else:
            pace.clear()
        if now_s >= frame_s:
            if drawn != run.tick:
                jpeg, drawn = encoded(seat.eye.look()[0]), run.tick
            state = "ended" if drive.end else "paused" if paused else "moving" if moved else "waits"
            shown = _state(seat) | {"state": state, "note": note, "pace": _pace(pace)}
            desk.show(jpeg, shown | {"number": heard[0], "answer_ms": answer_ms})
            frame_s = max(frame_s + FRAME_S, now_s)
        time.sleep(max(due_s - clock(), 0.0))


def encoded(rgb: np.ndarray) -> bytes:
    """Return a picture (H, W, 3) uint8 as JPEG."""
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _state(seat: Seat) -> dict[str, Any]:
    drive, run = seat.drive, seat.drive.run
    pose = run.world.pose
    contacts = [event.detail for event in run.events[-3:] if event.kind == "contact"]
    return {
        "title": seat.title,
        "instruction": run.episode.instruction,
        "robot": run.world.robot.name,
        "time_s": round(drive.time_s, 2),
        "pose": [round(pose.x_m, 3), round(pose.y_m, 3), round(pose.yaw_rad, 3)],
        "speed_m_s": round(run.watch.speed_m_s(), 2),
        "command": [round(value, 3) for value in run.command],
        "touched": contacts[-1] if contacts else "",
        "end": _end(seat),
    }


def _end(seat: Seat) -> str:
    end = seat.drive.end
    if end is None:
        return ""
    if seat.free and end in (EndReason.SUCCESS, EndReason.STOPPED_FAR):
        return "Stopped."
    return SAID.get(end, str(end)).format(success_m=seat.drive.run.config.outcome.success_m)


def _pace(pace: deque[tuple[float, float]]) -> float | None:
    """Return how much faster than real time the robot moves; None unless it has for a while."""
    if len(pace) < 10:
        return None
    (wall_0, time_0), (wall_1, time_1) = pace[0], pace[-1]
    return round((time_1 - time_0) / max(wall_1 - wall_0, 1e-6), 2)
