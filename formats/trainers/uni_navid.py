"""Uni-NaVid: one record for each step of 0.25 m or 30°, with a video of all frames up to it."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lerobot.layout import RGB_KEY
from ..rendered.discrete_steps import DiscreteSteps
from ..video.codecs import RGB_CODECS
from ..video.mp4 import write_decoded_video
from ..video.mux import copy_beginnings
from ..video.stream import decode_frames
from .answers import KIND_OF, Answer
from .subset import Layout, folder_of, write_answers
from .walks import Walk

TURN_RAD = math.radians(30.0)
AHEAD = 4  # actions in an answer
VIDEO_RATE = 1  # frames/s, at which loaders sample, so that they take every frame
# Trainers tell navigation from other videos by "a video … of the current observation".
_PROMPT = (
    "You steer a robot through a building. You are given a video of historical observations and "
    "an image of the current observation <image>. Your task is: '{instruction}' Answer with the "
    "next four actions, each one of forward, left, right or stop."
)


class _UniNavid:
    turn_rad = TURN_RAD

    def write_pictures(self, out: Path, key: str, walk: Walk, steps: DiscreteSteps) -> None:
        """Encode the steps once; the video of each record is a copy of its first packets."""
        folder = folder_of(out / "nav_videos")
        repeats = np.bincount(steps.frame).tolist()
        frames = decode_frames(walk.unit.video(RGB_KEY))
        shown = (f for times, f in zip(repeats, frames, strict=False) for _ in range(times))
        last = len(steps.frame) - 1
        whole = folder / f"{key}_{last}.mp4"
        write_decoded_video(whole, shown, VIDEO_RATE, RGB_CODECS["h264"])
        copy_beginnings(whole, [folder / f"{key}_{step}.mp4" for step in range(last)])

    def answers(self, actions: NDArray[np.int64]) -> list[Answer]:
        kinds = [KIND_OF[action] for action in actions.tolist()]
        return [
            Answer(step, kind, " ".join(kinds[step : step + AHEAD]))
            for step, kind in enumerate(kinds)
        ]

    def record(self, name: str, key: str, text: str, answer: Answer) -> dict[str, Any]:
        return {
            "id": f"NAV_ID_VLN_{name}",
            "video": f"nav_videos/{key}_{answer.step}.mp4",
            "conversations": [
                {"from": "human", "value": _PROMPT.replace("{instruction}", text)},
                {"from": "gpt", "value": answer.text},
            ],
        }


UNI_NAVID = Layout(
    "uni-navid",
    "Uni-NaVid",
    lambda out, sources, subset: write_answers(_UniNavid(), out, sources, subset),
    balance="uni-navid",
)
