"""What the instruction room makes, and how it is configured."""

from __future__ import annotations

from dataclasses import dataclass

from ..formats.core.errors import UnknownNameError

STYLES = ("mixed", "concise", "detailed")


@dataclass(frozen=True)
class Mention:
    """A thing of the scene that an instruction names.

    Attributes:
        name: of the object in the scene.
        category: the word used for it.
        role: `pass`, `turn` or `stop`.
        side: `left`, `right` or "".
        along_m: distance along the path where it is nearest [m].
    """

    name: str
    category: str
    role: str
    side: str
    along_m: float


@dataclass(frozen=True)
class Instruction:
    """An instruction and what it is made from.

    Attributes:
        text: what the robot is told.
        landmarks: the things it names, in order.
        actions: what it asks for, in order, e.g. `turn left`, `enter kitchen`, `pass sofa`.
        composer: registry name of its maker.
        style: `concise` or `detailed`.
    """

    text: str
    landmarks: tuple[Mention, ...]
    actions: tuple[str, ...]
    composer: str
    style: str


@dataclass(frozen=True)
class InstructConfig:
    """How instructions are made.

    Attributes:
        composer: name in `COMPOSERS`.
        style: one of `STYLES`; `mixed` draws one for each episode.
        replace: also rewrite instructions that are there already.
        attempts: how often a text that fails its checks is composed anew.
    """

    composer: str = "offline"
    style: str = "mixed"
    replace: bool = False
    attempts: int = 8

    def __post_init__(self):
        if self.style not in STYLES:
            raise UnknownNameError("instruction style", self.style, STYLES)
