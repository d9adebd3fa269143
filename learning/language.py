"""Pretrained encoders of instructions; they stay as they are, so that a text is encoded once.

Those of sentence-transformers that are BERTs are computed here by PyTorch's transformer layers:
importing `transformers` takes longer than encoding a thousand instructions.
"""

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load
from torch import Tensor, nn
from torch.nn.functional import layer_norm

from ..datasets.tokens import Tokens
from ..formats.core.errors import FileFormatError, MissingExtraError, first_line
from ..formats.untrusted.archives import read_zip
from ..formats.untrusted.documents import parse_json
from ..formats.untrusted.files import PARSER_ERRORS, read_input
from ..formats.untrusted.limits import limits
from .card import Card
from .config import ModelConfig
from .weights import EXTRA, WHEELS, find_weights, require_same

_WEIGHTS, _CONFIG, _TOKENIZER = _FILES = ("model.safetensors", "config.json", "tokenizer.json")
_DAMAGED = (*PARSER_ERRORS, AssertionError, SafetensorError)
# Settings of a BERT that change what is computed, and their only valid values.
_FIXED = {"model_type": "bert", "hidden_act": "gelu", "position_embedding_type": "absolute"}
# Layer of PyTorch → layer of BERT.
_NAMES = {
    "self_attn.out_proj": "attention.output.dense",
    "norm1": "attention.output.LayerNorm",
    "linear1": "intermediate.dense",
    "linear2": "output.dense",
    "norm2": "output.LayerNorm",
}


class TextEncoder:
    """A pretrained encoder of texts with its weights, on the CPU.

    Attributes:
        width: number of features of each token.
        facts: what a card says of it: model, digests and licence of the weights.
    """

    def __init__(self, language: str, weights: str = ""):
        """Read the encoder `sentence-transformers/NAME`; nothing is downloaded.

        Args:
            weights: its folder or ZIP archive; without it, a wheel's or the Hub's cache is taken.

        Raises:
            MissingExtraError: tokenizers is not installed.
            InputError: its weights are nowhere.
            FileFormatError: its files are damaged, or those of another kind of model.
        """
        try:
            from tokenizers import Tokenizer
        except ImportError as error:
            raise MissingExtraError(f"language {language}", EXTRA) from error
        path, licence = _place(language, weights)
        files = _read(path)
        settings = parse_json(path / _CONFIG, files[_CONFIG])
        try:
            self._network = _Bert(settings, load(files[_WEIGHTS]))
            tokenizer = Tokenizer.from_buffer(files[_TOKENIZER])
            tokenizer.no_padding()
            if tokenizer.get_vocab_size() > len(self._network.words):
                raise ValueError(f"{_TOKENIZER} has more words than {_WEIGHTS}")
        except _DAMAGED as error:
            reason = f"not an encoder of texts ({type(error).__name__}: {first_line(error)})"
            raise FileFormatError(path, reason) from error
        self._tokenizer = tokenizer
        self.width = self._network.words.shape[1]
        self.facts = {
            "model": language,
            "weights_sha256": hashlib.sha256(files[_WEIGHTS]).hexdigest(),
            "tokenizer_sha256": hashlib.sha256(files[_TOKENIZER]).hexdigest(),
            "config_sha256": hashlib.sha256(files[_CONFIG]).hexdigest(),
            "licence": licence,
        }

    @torch.inference_mode()
    def features(self, text: str, length: int) -> Tensor:
        """Return features (L, width) float16 of a text's first `length` tokens, marks included."""
        self._tokenizer.enable_truncation(min(length, len(self._network.places)))
        return self._network(torch.tensor(self._tokenizer.encode(text).ids)).half()


class _Bert(nn.Module):
    """BERT (Devlin et al., NAACL 2019) for one text at a time."""

    def __init__(self, settings: Mapping[str, Any], weights: Mapping[str, Tensor]):
        """Build it; raise one of `_DAMAGED` if settings or weights are not those of a BERT."""
        super().__init__()
        for key, valid in _FIXED.items():
            if (value := settings.get(key, valid)) != valid:
                raise ValueError(f"{_CONFIG}: {key} {value!r}; valid: {valid!r}")
        self.width, self.epsilon = settings["hidden_size"], settings["layer_norm_eps"]
        start = "embeddings."
        self.words, self.places, kinds = (
            weights[f"{start}{name}_embeddings.weight"].float()
            for name in ("word", "position", "token_type")
        )
        self.kind = kinds[0]
        self.scale, self.shift = (
            weights[f"{start}LayerNorm.{part}"].float() for part in ("weight", "bias")
        )
        self.layers = nn.Sequential()
        for number in range(settings["num_hidden_layers"]):
            with torch.device("meta"):  # the weights come from the file
                layer = nn.TransformerEncoderLayer(
                    self.width,
                    settings["num_attention_heads"],
                    settings["intermediate_size"],
                    activation="gelu",
                    layer_norm_eps=self.epsilon,
                    batch_first=True,
                )
            layer.load_state_dict(_renamed(weights, f"encoder.layer.{number}."), assign=True)
            self.layers.append(layer)
        self.eval().requires_grad_(False)

    def forward(self, tokens: Tensor) -> Tensor:
        """Return the features (L, width) of the tokens (L,) of a text."""
        features = self.words[tokens] + self.places[: len(tokens)] + self.kind
        features = layer_norm(features, (self.width,), self.scale, self.shift, self.epsilon)
        return self.layers(features[None])[0]


def _renamed(weights: Mapping[str, Tensor], layer: str) -> dict[str, Tensor]:
    """Return the weights of a layer of BERT under PyTorch's names."""
    result = {}
    for part in ("weight", "bias"):
        heads = [weights[f"{layer}attention.self.{n}.{part}"] for n in ("query", "key", "value")]
        result[f"self_attn.in_proj_{part}"] = torch.cat(heads).float()
        for ours, theirs in _NAMES.items():
            result[f"{ours}.{part}"] = weights[f"{layer}{theirs}.{part}"].float()
    return result


_kept = lru_cache(maxsize=2)(TextEncoder)


def text_encoder(config: ModelConfig) -> TextEncoder | None:
    """Return the pretrained encoder of a model's instructions; None if it has none."""
    if not config.frozen_language:
        return None
    return _kept(config.language, config.language_weights)


def language_of(card: Card) -> TextEncoder | None:
    """Return the encoder of instructions that a checkpoint was trained with.

    Raises:
        InputError: it is not here, or has other weights; see `TextEncoder`.
    """
    encoder = text_encoder(card.config.model)
    if encoder is not None:
        require_same(encoder.facts, card.language)
    return encoder


def encode_text(text: str, tokens: Tokens, encoder: TextEncoder | None) -> Tensor:
    """Return word indices (length,) int64 of a text, or an encoder's features (L, C) float16."""
    if encoder is None:
        return torch.from_numpy(tokens.encode(text))
    return encoder.features(text, tokens.length)


def _place(language: str, weights: str) -> tuple[Path, str]:
    """Return an encoder's folder or archive, and its licence: named, a wheel's, or the Hub's."""
    if weights:
        return Path(weights), ""
    wheel = WHEELS.get(language)
    path, licence = find_weights(
        f"language {language}",
        wheel,
        language,
        _FILES,
        wheel.licence if wheel is not None else "",
        "a folder with these three files (language_weights)",
    )
    return (path.parent if path.name == _WEIGHTS else path), licence


def _read(path: Path) -> dict[str, bytes]:
    if not path.is_dir():
        return read_zip(path, _FILES)
    cap = limits().array_bytes
    return {name: read_input(path / name, root=path, max_bytes=cap) for name in _FILES}
