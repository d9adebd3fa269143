"""The card of a checkpoint: JSON that says what a file of weights is; read without torch.

It holds what is needed to build the model (architecture, vocabulary, image size), what the weights
were made from (data digests, recipe, seed, start), and how the training went (curves).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from pydantic import TypeAdapter, ValidationError

from ..datasets.tokens import Tokens
from ..formats.core.atomic import write_json
from ..formats.core.errors import FileFormatError, InputError, brief
from ..formats.untrusted.documents import read_json_object
from ..formats.vlnce.vocabulary import Vocabulary
from .config import TrainConfig, train_config

CARD_VERSION = 1
SUFFIX = ".safetensors"


@dataclass(frozen=True)
class View:
    """The camera that the training images were taken with.

    Attributes:
        width_px, height_px: size of the images as rendered, before they were resized to `size_px`.
        depth_far_m: where the recorded depth ends; 0 beyond.
        mount: the rig, if all have the same; `ego` is each robot's own camera.
    """

    width_px: int
    height_px: int
    hfov_deg: float
    depth_far_m: float
    mount: str = "ego"

    @property
    def camera(self) -> str:
        """The camera as an option names it, for example `ego:128x128:90`."""
        return f"{self.mount}:{self.width_px}x{self.height_px}:{self.hfov_deg:g}"


@dataclass(frozen=True)
class Card:
    """Description of a checkpoint's weights.

    Attributes:
        words: vocabulary in index order.
        steps: number of steps made so far.
        recipe: title, mixture, and digest of the recipe file.
        data: per source its datasets, episodes, share and digest.
        held_out: scenes or trajectories that the training did not see.
        start: digest of the weights that it started from; empty for new ones.
        stairs: whether a walk took stairs, also one that the start was trained on; None where that
            is not known.
        scenes: where it was trained, also its start; none where that is unknown.
        encoder, language: model, digest and licence of the pretrained encoders of RGB and of
            instructions that it needs, if any.
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
    stairs: bool | None = None
    scenes: tuple[str, ...] = ()
    encoder: Mapping[str, Any] = field(default_factory=dict)
    language: Mapping[str, Any] = field(default_factory=dict)
    curves: tuple[Mapping[str, Any], ...] = ()

    @property
    def tokens(self) -> Tokens:
        """The vocabulary and length of the instructions."""
        return Tokens(Vocabulary(self.words), self.config.tokens)


class _Rest(TypedDict):
    """The types of the card's values that no class of their own checks."""

    robots: tuple[str, ...]
    controllers: tuple[str, ...]
    lights: tuple[str, ...]
    seed: int
    steps: int
    recipe: dict[str, Any]
    data: tuple[dict[str, Any], ...]
    held_out: dict[str, Any]
    start: str
    stairs: NotRequired[bool | None]
    scenes: NotRequired[tuple[str, ...]]
    encoder: NotRequired[dict[str, Any]]
    language: NotRequired[dict[str, Any]]
    curves: tuple[dict[str, Any], ...]


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
    if not place.exists():
        raise FileFormatError(place, f"no such file; a checkpoint is {path.name} and this card")
    value = read_json_object(place)
    if value.get("card") != CARD_VERSION:
        raise FileFormatError(
            place, f"card version {brief(value.get('card'))}; valid: {CARD_VERSION}"
        )
    try:
        config = train_config(value["config"])
        words = tuple(value["words"])
        if len(words) < 2 or not all(isinstance(word, str) for word in words):
            raise ValueError("words are not a vocabulary")
        view = TypeAdapter(View).validate_python(value["view"])
        card = Card(config, words, view)
        rest = TypeAdapter(_Rest).validate_python(value)
        return replace(card, **rest), str(value["weights_sha256"])
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        reason = f"not the card of a checkpoint ({where}: {first['msg']})"
        raise FileFormatError(place, reason) from error
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise FileFormatError(place, f"not the card of a checkpoint ({error!r})") from error
