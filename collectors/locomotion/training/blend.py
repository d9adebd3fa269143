"""A gait between two: the weighted mean of an installed network and one that was refined from it.

`python -m vlnpe.collectors.locomotion.training.blend h1 FOLDER OTHER --share 0.5 --out FOLDER`

A network and one that was fine-tuned from it lie in one basin of the loss, and so does all
between them (Wortsman et al. 2022, "Robust fine-tuning of zero-shot models"): what a refinement
gains and what it forgets come in about the same proportion as the weights.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import onnx
import tyro
from onnx import numpy_helper

from ....formats.core.atomic import atomic_file
from ...robots import get_robot
from ..runtime.card import load_card, save_card
from ..runtime.policy import policy_files
from .export import motor_speeds
from .gaits import GAITS


def blended(first: bytes, second: bytes, share: float) -> bytes:
    """Return the ONNX network with weights (1 − share) of the first plus share of the second."""
    model, other = onnx.load_from_string(first), onnx.load_from_string(second)
    weights = {t.name: numpy_helper.to_array(t) for t in other.graph.initializer}
    for tensor in model.graph.initializer:
        mean = (1.0 - share) * numpy_helper.to_array(tensor) + share * weights[tensor.name]
        tensor.CopyFrom(numpy_helper.from_array(mean.astype("float32"), tensor.name))
    return model.SerializeToString()


def main(
    robot: Annotated[str, tyro.conf.Positional],
    first: Annotated[Path, tyro.conf.Positional],
    second: Annotated[Path, tyro.conf.Positional],
    share: float,
    out: Path,
    aim_beyond: tuple[float, float, float] | None = None,
) -> None:
    """Write the blend of two gaits of one robot, and a card without evaluation.

    Args:
        robot: registry name.
        first: folder of `<robot>.onnx` and `<robot>.json` that the second was refined from.
        second: folder of the refined gait.
        share: weight of the second, 0 … 1.
        out: folder to write to.
        aim_beyond: how far beyond the robot's limits its calibration may ask, see `aim.calibrated`.
    """
    spec = get_robot(robot)
    (first_onnx, first_card), (second_onnx, second_card) = (
        policy_files(spec, folder) for folder in (first, second)
    )
    content = blended(first_onnx.read_bytes(), second_onnx.read_bytes(), share)
    cards = load_card(first_card), load_card(second_card)
    training: dict[str, Any] = {
        **cards[1].training,
        "blend": {"share": share, "of": cards[1].onnx_sha256, "with": cards[0].onnx_sha256},
    }
    if aim_beyond is not None:
        training["aim_beyond"] = list(aim_beyond)
    card = replace(
        cards[1],
        physics_hash=spec.physics_hash(),
        gait=GAITS[robot],
        speed_rad_s=motor_speeds(spec),
        onnx_sha256=hashlib.sha256(content).hexdigest(),
        training=training,
        evaluation={},
    )
    out.mkdir(parents=True, exist_ok=True)
    onnx_path, card_path = policy_files(spec, out)
    with atomic_file(onnx_path) as temporary:
        temporary.write_bytes(content)
    save_card(card, card_path)


if __name__ == "__main__":
    tyro.cli(main)
