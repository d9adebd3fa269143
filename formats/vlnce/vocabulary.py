"""Word-level vocabulary of instructions, in the shape of VLN-CE's `instruction_vocab`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

PAD, UNKNOWN = "<pad>", "<unk>"


@dataclass(frozen=True)
class Vocabulary:
    """Words in index order; index 0 pads, index 1 stands for unknown words."""

    words: tuple[str, ...]

    @staticmethod
    def of(texts: Iterable[str]) -> "Vocabulary":
        """Return all words of `texts`, sorted, so that equal texts give equal vocabularies."""
        words = sorted({word for text in texts for word in tokenize(text)})
        return Vocabulary((PAD, UNKNOWN, *words))

    @cached_property
    def index(self) -> dict[str, int]:
        """Index of each word."""
        return {word: k for k, word in enumerate(self.words)}

    def encode(self, text: str, length: int) -> list[int]:
        """Return the word indices of `text`, cut or padded to `length`."""
        unknown = self.index[UNKNOWN]
        indices = [self.index.get(word, unknown) for word in tokenize(text)][:length]
        return indices + [self.index[PAD]] * (length - len(indices))

    def to_json(self) -> dict[str, Any]:
        """Return the `instruction_vocab` object of an episode file."""
        return {
            "word_list": list(self.words),
            "word2idx_dict": self.index,
            "stoi": self.index,
            "itos": list(self.words),
            "num_vocab": len(self.words),
            "UNK_INDEX": self.index[UNKNOWN],
            "PAD_INDEX": self.index[PAD],
        }


def tokenize(text: str) -> list[str]:
    """Return the lower-case words and punctuation marks of `text`."""
    return re.findall(r"\w+(?:['’-]\w+)*|[^\w\s]", text.lower())
