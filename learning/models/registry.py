"""The registry of models."""

from pathlib import Path

from torch import nn

from ...datasets.tokens import Tokens
from ..config import ModelConfig
from .cma import Cma
from .rdp import Rdp
from .senses import load_word_vectors
from .seq2seq import Seq2Seq

Model = Cma | Seq2Seq | Rdp
MODELS: dict[str, type[Cma] | type[Seq2Seq] | type[Rdp]] = {
    "cma": Cma,
    "seq2seq": Seq2Seq,
    "rdp": Rdp,
}


def build_model(tokens: Tokens, config: ModelConfig, *, pretrained: bool = True) -> Model:
    """Return a new model.

    Args:
        tokens: whose vocabulary it reads.
        pretrained: read the configuration's files of weights and word vectors; a checkpoint's
            weights contain them.

    Raises:
        FileFormatError: such a file cannot be read, or does not fit the model.
    """
    words = tokens.vocabulary.words
    model = MODELS[config.name](len(words), config, pretrained=pretrained)
    embedding = model.reader.embedding
    if config.word_vectors and pretrained and isinstance(embedding, nn.Embedding):
        load_word_vectors(embedding, tuple(words), Path(config.word_vectors))
    return model
