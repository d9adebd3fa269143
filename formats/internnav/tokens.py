"""The vocabulary of InternNav's instruction tokens."""

import logging
from collections.abc import Iterable
from pathlib import Path

from ..core.errors import FileFormatError
from ..untrusted.limits import limits
from ..vlnce.load import load_json
from ..vlnce.vocabulary import PAD, UNKNOWN, Vocabulary
from .layout import VOCABULARY_SIZE

log = logging.getLogger(__name__)


def own_vocabulary(texts: Iterable[str]) -> Vocabulary:
    """Return the vocabulary of `texts`; warn if it is too large for InternNav's models."""
    vocabulary = Vocabulary.of(texts)
    if len(vocabulary.words) > VOCABULARY_SIZE:
        log.warning(
            "%d words; InternNav's CMA has embeddings for %d: raise its vocab_size",
            len(vocabulary.words),
            VOCABULARY_SIZE,
        )
    return vocabulary


def read_vocabulary(path: Path) -> Vocabulary:
    """Return the vocabulary of a VLN-CE episode file (.json or .json.gz).

    Raises:
        FileFormatError: no such file, or no vocabulary in it.
    """
    value = load_json(path, limits())
    try:
        words = tuple(value.get("instruction_vocab", value)["word_list"])
        if not all(isinstance(word, str) for word in words):
            raise ValueError("word_list contains entries that are not text")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileFormatError(path, f"contains no instruction_vocab ({error!r})") from error
    missing = [word for word in (PAD, UNKNOWN) if word not in words]
    if missing:
        raise FileFormatError(path, f"word_list lacks {missing[0]}")
    return Vocabulary(words)
