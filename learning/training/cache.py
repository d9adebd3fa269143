"""Whole episodes decoded once, at the size they are trained with, and kept on disk."""

import hashlib
import logging
import zlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch.nn.functional import pad
from torch.utils.data import Dataset

from ...datasets.episode_index import EpisodeEntry
from ...datasets.mirror import mirror_item, mirror_text
from ...datasets.sequences import EpisodeSequences
from ...formats.core.atomic import atomic_file, file_digest
from ...formats.core.errors import FileFormatError
from ...formats.process.progress import progress_bar
from ...formats.process.source import code_digest
from ..config import IMAGES
from ..images import DEPTH_STEP_M, to_millimetres
from ..language import TextEncoder, encode_text
from ..pretrained import FrozenEncoder

log = logging.getLogger(__name__)

_CHECKSUM = "crc32"  # its name in a file's metadata


class CachedSequences(Dataset[dict[str, Any]]):
    """Items of `EpisodeSequences`, each made once; memory stays flat, disk holds them.

    Each training epoch would otherwise decode every video and divide every path into actions
    again, which takes longer than training.
    """

    def __init__(
        self,
        sequences: EpisodeSequences,
        folder: Path,
        images: Collection[str] = IMAGES,
        encoder: FrozenEncoder | None = None,
        language: TextEncoder | None = None,
        *,
        mirror: bool = False,
    ):
        """Keep the items of `sequences` in `folder`, which is created if missing.

        Args:
            folder: where the files are kept.
            images: which of `rgb` and `depth` items have; the others are not read.
            encoder: items have its features of the RGB images, (T, C, 4, 4) float16, instead.
            language: `tokens` are its features of the instruction, (L, C) float16, instead.
            mirror: whether half of the items, others in every pass, are mirrored if their
                instruction can be.
        """
        self.sequences, self.folder = sequences, folder
        self.encoder, self.language, self.mirror = encoder, language, mirror
        self.images = frozenset(images)
        self._choice = sequences.instruction_choice
        self._places: dict[int, tuple[EpisodeEntry, Path]] = {}  # of the items made or found
        folder.mkdir(parents=True, exist_ok=True)

    @property
    def digest(self) -> str:
        """Digest of the episodes."""
        return self.sequences.selection.digest

    def begin_pass(self, epoch: int) -> None:
        """Draw other instructions, and other items to mirror, from the next item on."""
        self._choice = replace(self.sequences.instruction_choice, epoch=epoch)

    def __len__(self) -> int:
        return len(self.sequences)

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the episode `number`.

        Raises:
            FileFormatError: its file was cut off after it was checked.
        """
        entry, path = self._place(number)
        unread = set(IMAGES) - self.images
        try:
            with safe_open(path, framework="pt") as file:
                keys = sorted(set(file.keys()) - unread)
                item: dict[str, Any] = {key: file.get_tensor(key) for key in keys}
        except SafetensorError as error:
            raise FileFormatError(
                path, f"a damaged decoded episode; delete it, and it is decoded again ({error})"
            ) from error
        if "depth" in item:
            item["depth"] = item["depth"].to(torch.float32) * DEPTH_STEP_M
        text = self._choice.text(entry)
        drawn = self.mirror and self._choice.draw(entry, 2, "mirror")
        if drawn and (other := mirror_text(text)) is not None:
            item, text = mirror_item(item), other
        return item | {"tokens": self._tokens(text), "uid": entry.uid, "robot": entry.robot}

    def prepare(self, number: int) -> Path:
        """Make the item `number` unless that is done; return its file."""
        return self._place(number)[1]

    def _place(self, number: int) -> tuple[EpisodeEntry, Path]:
        if number in self._places:
            return self._places[number]
        entry = self.sequences.selection.entry(number)
        path = self.folder / f"{self._key(entry)}.safetensors"
        if not _is_whole(path):
            item = self.sequences[number]
            values = {k: v for k, v in item.items() if torch.is_tensor(v) and k != "tokens"}
            if self.encoder is not None:
                values["rgb"] = self.encoder.features(self._large(number))
            values["depth"] = torch.from_numpy(to_millimetres(values["depth"].numpy()))
            values = {k: v.contiguous() for k, v in values.items()}
            _write(path, values)
        self._places[number] = entry, path
        return entry, path

    def _tokens(self, text: str) -> torch.Tensor:
        """Return a text as the model reads it; a pretrained encoder's features are kept on disk."""
        tokens = self.sequences.tokens
        if self.language is None:
            return encode_text(text, tokens, None)
        code = code_digest(TextEncoder.__module__)
        name = _named([text, tokens.length, sorted(self.language.facts.items()), code])
        path = self.folder / f"text-{name}.safetensors"
        if not _is_whole(path):
            _write(path, {"tokens": encode_text(text, tokens, self.language)})
        features = load_file(path)["tokens"]
        return pad(features, (0, 0, 0, tokens.length - len(features)))

    def _large(self, number: int) -> torch.Tensor:
        """Return the RGB images of an episode at the encoder's size."""
        assert self.encoder is not None
        how = self.sequences
        config = replace(how.config, size_px=self.encoder.size_px)
        return EpisodeSequences(how.selection, how.tokens, config)[number]["rgb"]

    def _key(self, entry: EpisodeEntry) -> str:
        """Return a key of the episode's place, its files, the contents of an item, and the code."""
        parts: list[Any] = [entry.uid, entry.length, self.sequences.config, _code()]
        for path in [entry.rows, *(place.path for place in entry.videos.values())]:
            facts = path.stat()
            if self.encoder is not None:  # features are of what the video shows
                content = _digest(path, facts.st_size, facts.st_mtime_ns)
                code = code_digest(FrozenEncoder.__module__)
                parts += [content, entry.first_frame, sorted(self.encoder.facts.items()), code]
                continue
            parts += [path.resolve(), entry.first_frame, facts.st_size, facts.st_mtime_ns]
        return _named(parts)


def _named(parts: list[Any]) -> str:
    return hashlib.blake2b(repr(parts).encode(), digest_size=12).hexdigest()


def _write(path: Path, values: dict[str, torch.Tensor]) -> None:
    with atomic_file(path) as temporary:
        save_file(values, temporary, {_CHECKSUM: _checksum(values)})


@cache
def _digest(path: Path, _size: int, _mtime_ns: int) -> str:
    return file_digest(path)


@cache
def _code() -> str:
    return code_digest(EpisodeSequences.__module__)


def _is_whole(path: Path) -> bool:
    """Return whether a file is there and as it was written; warn if it is damaged."""
    if not path.is_file():
        return False
    try:
        with safe_open(path, framework="pt") as file:
            written = (file.metadata() or {}).get(_CHECKSUM)
            if written == _checksum({key: file.get_tensor(key) for key in sorted(file.keys())}):
                return True
    except SafetensorError:
        pass
    log.warning("%s is damaged, or of an earlier version: it is made again", path)
    return False


def _checksum(values: Mapping[str, torch.Tensor]) -> str:
    """Return the CRC-32 of tensors with their names, types and shapes."""
    checksum = 0
    for name, value in sorted(values.items()):
        checksum = zlib.crc32(f"{name} {value.dtype} {tuple(value.shape)}".encode(), checksum)
        checksum = zlib.crc32(value.numpy().data, checksum)
    return f"{checksum:08x}"


def decode_all(episodes: Collection[CachedSequences], *, show: bool) -> None:
    """Decode all episodes that will be needed, each once; `show` a progress bar."""
    with progress_bar("decode", sum(map(len, episodes)), show=show) as bar:
        for some in episodes:
            for number in range(len(some)):
                some.prepare(number)
                bar.update()
