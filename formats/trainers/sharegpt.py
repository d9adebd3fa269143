"""ShareGPT, as Qwen-VL's trainers, LLaMA-Factory and JanusVLN read it: one record for each step."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.rollout import TURN_STEP_RAD
from ..rendered.discrete_steps import DiscreteSteps
from .answers import KIND_OF, Answer
from .subset import Layout, folder_of, write_answers
from .walks import Walk

HISTORY = 8  # images before the current one
_WORDS = {"forward": "MOVE_FORWARD", "left": "TURN_LEFT", "right": "TURN_RIGHT", "stop": "STOP"}
_PROMPT = (
    "You steer a robot through a building by its camera. These are images of its way so far, as "
    "historical observation:{history}\n This is its current observation:<image>\n Your task is to "
    "{instruction}\n Answer with the next action, one of MOVE_FORWARD TURN_LEFT TURN_RIGHT STOP."
)


class _ShareGpt:
    turn_rad = TURN_STEP_RAD

    def write_pictures(self, out: Path, key: str, walk: Walk, steps: DiscreteSteps) -> None:
        folder = folder_of(out / "images" / key)
        walk.write_jpegs(steps.frame, [folder / f"{k:03d}.jpg" for k in range(len(steps.frame))])

    def answers(self, actions: NDArray[np.int64]) -> list[Answer]:
        kinds = [KIND_OF[action] for action in actions.tolist()]
        return [Answer(step, kind, _WORDS[kind]) for step, kind in enumerate(kinds)]

    def record(self, name: str, key: str, text: str, answer: Answer) -> dict[str, Any]:
        shown = np.unique(np.linspace(0, answer.step, HISTORY + 1, dtype=int)).tolist()
        images = [f"images/{key}/{k:03d}.jpg" for k in shown]
        question = _PROMPT.replace("{history}", "<image>" * (len(shown) - 1))
        return {
            "id": name,
            "conversations": [
                {"from": "human", "value": question.replace("{instruction}", text)},
                {"from": "gpt", "value": answer.text},
            ],
            "images": images,
            "image": images,  # as Qwen-VL's own trainer names them
        }


SHAREGPT = Layout(
    "sharegpt",
    "ShareGPT",
    lambda out, sources, subset: write_answers(_ShareGpt(), out, sources, subset),
    balance="natural",
    labels=True,
)
