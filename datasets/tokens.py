"""Instructions as word indices, as VLN-CE's agents take them.

Words are lower-case, punctuation marks are words (`formats.vlnce.vocabulary.tokenize`). Index 0 is
padding, 1 stands for every word that is not in the vocabulary, as in VLN-CE's files. The
vocabulary is that of the training instructions alone, or one read from a VLN-CE file, so that
embeddings trained elsewhere fit.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..formats.core.errors import FileFormatError
from ..formats.vlnce.files import read_vlnce
from ..formats.vlnce.vocabulary import PAD, UNKNOWN, Vocabulary

LONG, SHORT = 200, 80  # what VLN-CE pads to, and what R2R's agents without a simulator do


@dataclass(frozen=True)
class Tokens:
    """Vocabulary and length of tokenised instructions.

    Attributes:
        length: tokens that every instruction is padded or cut to.
    """

    vocabulary: Vocabulary
    length: int = LONG

    def encode(self, text: str) -> NDArray[np.int64]:
        """Return (length,) word indices, 0 behind the last word."""
        return np.array(self.vocabulary.encode(text, self.length), np.int64)


def training_tokens(instructions: Iterable[str], length: int = LONG) -> Tokens:
    """Return the tokens with the words of `instructions`."""
    return Tokens(Vocabulary.of(instructions), length)


def tokens_of_file(path: Path, length: int = LONG) -> Tokens:
    """Return the tokens with the vocabulary of a VLN-CE episode file.

    Raises:
        FileFormatError: not such a file, or its vocabulary does not begin with padding and
            unknown word.
    """
    vocabulary = read_vlnce(path).vocabulary or {}
    words = vocabulary.get("word_list")
    if not isinstance(words, list) or len(words) < 2 or not all(isinstance(w, str) for w in words):
        raise FileFormatError(path, "instruction_vocab has no word_list")
    marks = (vocabulary.get("PAD_INDEX", 0), vocabulary.get("UNK_INDEX", 1))
    if marks != (0, 1):
        raise FileFormatError(path, f"PAD_INDEX, UNK_INDEX are {marks}; valid: 0, 1")
    # Whatever the file calls them, they have their meaning by their place.
    return Tokens(Vocabulary((PAD, UNKNOWN, *words[2:])), length)
