"""The card of a checkpoint: JSON that says what a file of weights is; read without torch.

It holds what is needed to build the model (architecture, vocabulary, image size), what the weights
were made from (data digests, recipe, seed, start), and how the training went (curves).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ..datasets.tokens import Tokens
from ..formats.core.atomic import write_json
from ..formats.core.errors import FileFormatError, InputError
from ..formats.vlnce.vocabulary import Vocabulary
from .config import TrainConfig, train_config

CARD_VERSION = 1
SUFFIX = ".safetensors"


@dataclass(frozen=True)
class View:
    """The camera that the training images were taken with.

    Attributes:
        width_px, height_px: of the images as rendered, before they were resized to `size_px`.
        depth_far_m: where the recorded depth ends; 0 beyond.
    """

    width_px: int
    height_px: int
    hfov_deg: float
    depth_far_m: float

    def camera(self, kind: str) -> str:
        """Return the camera as an option names it, for example `ego:128x128:90`."""
        return f"{kind}:{self.width_px}x{self.height_px}:{self.hfov_deg:g}"


@dataclass(frozen=True)
class Card:
    """What a checkpoint's weights are.

    Attributes:
        words: vocabulary in index order.
        steps: number of steps made so far.
        recipe: title, mixture, and digest of the recipe file.
        data: per source its datasets, episodes, share and digest.
        held_out: scenes or trajectories that the training did not see.
        start: digest of the weights that it started from; empty for new ones.
        curves: scores by step.
    """

    config: TrainConfig
    words: tuple[str, ...]
    view: View
    robots: tuple[str, ...] = ()
    controllers: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    seed: int = 0
    steps: int = 0
    recipe: Mapping[str, Any] = field(default_factory=dict)
    data: tuple[Mapping[str, Any], ...] = ()
    held_out: Mapping[str, Any] = field(default_factory=dict)
    start: str = ""
    curves: tuple[Mapping[str, Any], ...] = ()

    @property
    def tokens(self) -> Tokens:
        """The vocabulary and length of the instructions."""
        return Tokens(Vocabulary(self.words), self.config.tokens)


def card_path(path: Path) -> Path:
    """Return where the card of the weights in `path` lies."""
    return path.with_suffix(".json")


def write_card(path: Path, card: Card, weights_sha256: str) -> None:
    """Write the card of the weights in `path`."""
    value = {f.name: getattr(card, f.name) for f in fields(card)}
    value |= {
        "card": CARD_VERSION,
        "config": card.config.to_json(),
        "view": vars(card.view),
        "weights_sha256": weights_sha256,
    }
    write_json(card_path(path), value)


def read_card(path: Path) -> tuple[Card, str]:
    """Return the card of the weights in `path`, and the weights' SHA-256 by it.

    Raises:
        FileFormatError: missing, damaged or of another version.
    """
    place = card_path(path)
    try:
        value = json.loads(place.read_text())
    except OSError as error:
        raise FileFormatError(
            place, f"not readable ({error.strerror}); a checkpoint is {path.name} and this card"
        ) from error
    except ValueError as error:
        raise FileFormatError(place, f"not JSON ({error})") from error
    if not isinstance(value, dict) or value.get("card") != CARD_VERSION:
        version = value.get("card") if isinstance(value, dict) else None
        raise FileFormatError(place, f"card version {version}; valid: {CARD_VERSION}")
    try:
        config = train_config(value["config"])
        words = tuple(value["words"])
        if len(words) < 2 or not all(isinstance(word, str) for word in words):
            raise ValueError("words are not a vocabulary")
        view = View(**value["view"])
        card = Card(config, words, view, steps=int(value["steps"]), seed=int(value["seed"]))
        lists = ("robots", "controllers", "lights", "data", "curves")
        rest: dict[str, Any] = {name: tuple(value[name]) for name in lists}
        rest |= {name: value[name] for name in ("recipe", "held_out", "start")}
        return replace(card, **rest), str(value["weights_sha256"])
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise FileFormatError(place, f"not the card of a checkpoint ({error!r})") from error
