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

import tyro

from ....formats.core.atomic import atomic_file
from ...robots import get_robot
from ..runtime.card import load_card, save_card
from ..runtime.network import encode_layers
from ..runtime.policy import policy_files
from .export import Array, layers_of, motor_speeds
from .gaits import GAITS

Layers = tuple[list[Array], list[Array]]


def blended(first: Layers, second: Layers, share: float) -> Layers:
    """Return the layers with (1 − share) of the first network plus share of the second."""
    weights, biases = (
        [(1.0 - share) * a + share * b for a, b in zip(*pair, strict=True)]
        for pair in zip(first, second, strict=True)
    )
    return weights, biases


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
        first: folder of `<robot>.safetensors` and `<robot>.json` that the second was refined from.
        second: folder of the refined gait.
        share: weight of the second, 0 … 1.
        out: folder to write to.
        aim_beyond: how far beyond the robot's limits its calibration may ask, see `aim.calibrated`.
    """
    spec = get_robot(robot)
    content = encode_layers(*blended(layers_of(spec, first), layers_of(spec, second), share))
    cards = [load_card(policy_files(spec, folder)[1]) for folder in (first, second)]
    training: dict[str, Any] = {
        **cards[1].training,
        "blend": {"share": share, "of": cards[1].network_sha256, "with": cards[0].network_sha256},
    }
    if aim_beyond is not None:
        training["aim_beyond"] = list(aim_beyond)
    card = replace(
        cards[1],
        physics_hash=spec.physics_hash(),
        gait=GAITS[robot],
        speed_rad_s=motor_speeds(spec),
        network_sha256=hashlib.sha256(content).hexdigest(),
        training=training,
        evaluation={},
    )
    out.mkdir(parents=True, exist_ok=True)
    path, card_path = policy_files(spec, out)
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
    save_card(card, card_path)


if __name__ == "__main__":
    tyro.cli(main)
