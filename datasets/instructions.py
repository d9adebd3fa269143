"""Choice among a path's instructions."""

import hashlib
from dataclasses import dataclass

from ..formats.core.errors import check_name
from .episode_index import EpisodeEntry

OWN, ANY = "own", "any"
CHOICES = (OWN, ANY)


@dataclass(frozen=True)
class InstructionChoice:
    """A choice among a path's instructions.

    Attributes:
        choice: `own` is the episode's first text, always; `any` draws one of all its texts.
        epoch: another one draws other instructions; `replace` it between passes over the data.
    """

    choice: str = OWN
    seed: int = 0
    epoch: int = 0

    def __post_init__(self) -> None:
        check_name("choice of instructions", self.choice, CHOICES)

    def text(self, entry: EpisodeEntry) -> str:
        """Return an episode's instruction; the same for every robot, worker and order of items."""
        texts = list(entry.instructions)
        if self.choice == OWN or len(texts) < 2:
            return texts[0]
        return texts[self.draw(entry, len(texts))]

    def draw(self, entry: EpisodeEntry, count: int, purpose: str = "") -> int:
        """Draw one of `count` numbers for an episode and pass; other purposes, other draws."""
        name = f"{self.seed}/{self.epoch}/{entry.uid}{purpose}".encode()
        return int.from_bytes(hashlib.blake2b(name, digest_size=8).digest()) % count


OWN_TEXT = InstructionChoice()
