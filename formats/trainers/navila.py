"""NaVILA: one record for each merged action, with all frames from the start to it."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.rollout import FORWARD_STEP_M, TURN_STEP_RAD
from ..rendered.discrete_steps import DiscreteSteps
from .answers import KIND_OF, Answer, runs
from .subset import Layout, folder_of, write_answers
from .walks import Walk

LONGEST_RUN = 3  # 75 cm or 45°


class _Navila:
    turn_rad = TURN_STEP_RAD

    def write_pictures(self, out: Path, key: str, walk: Walk, steps: DiscreteSteps) -> None:
        folder = folder_of(out / "train" / key)
        walk.write_jpegs(steps.frame, [folder / f"frame_{k}.jpg" for k in range(len(steps.frame))])

    def answers(self, actions: NDArray[np.int64]) -> list[Answer]:
        return [
            Answer(step, KIND_OF[action], f"The next action is {_phrase(KIND_OF[action], count)}.")
            for step, action, count in runs(actions, LONGEST_RUN)
        ]

    def record(self, name: str, key: str, text: str, answer: Answer) -> dict[str, Any]:
        frames = [f"{key}/frame_{k}.jpg" for k in range(answer.step + 1)]
        return {"video_id": name, "q": text, "a": answer.text, "frames": frames}


def _phrase(kind: str, count: int) -> str:
    if kind == "stop":
        return kind
    if kind == "forward":
        return f"move forward {round(100 * FORWARD_STEP_M * count)} cm"
    return f"turn {kind} {round(np.rad2deg(TURN_STEP_RAD) * count)} degrees"


NAVILA = Layout(
    "navila",
    "NaVILA",
    lambda out, sources, subset: write_answers(_Navila(), out, sources, subset),
    balance="navila",
)
