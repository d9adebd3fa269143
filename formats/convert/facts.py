"""What belongs to a LeRobot dataset as a whole, and to no episode: title, licence, provenance."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.errors import FileFormatError, brief
from ..lerobot.layout import DEPTH_KEY, INFO_PATH, PROVENANCE_PATH, FileLimits
from ..untrusted.documents import read_json_object
from ..untrusted.files import read_input

MAX_CARD_BYTES = 16 << 20


@dataclass(frozen=True)
class DatasetFacts:
    """What belongs to a dataset as a whole, and to no episode.

    Attributes:
        provenance: meta/provenance.json.
        limits: when new files begin.
        depth_storage: one of LeRobot's `DEPTH_STORAGES`.
    """

    title: str
    licence: str
    provenance: dict[str, Any]
    limits: FileLimits = FileLimits()  # noqa: RUF009 (frozen)
    depth_storage: str = "video"

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> "DatasetFacts":
        """Return the inverse of `to_json`.

        Raises:
            KeyError, TypeError: not such facts.
        """
        return DatasetFacts(
            str(values["title"]),
            str(values["licence"]),
            dict(values["provenance"]),
            FileLimits(**values["limits"]),
            str(values["depth_storage"]),
        )


def facts_of(root: Path, info: dict[str, Any]) -> DatasetFacts:
    """Return the facts of a LeRobot dataset whose meta/info.json is `info`.

    Raises:
        FileFormatError: info.json or the provenance is damaged.
    """
    provenance = root / PROVENANCE_PATH
    try:
        value = read_json_object(provenance, root=root) if provenance.exists() else {}
        file_limits = FileLimits(
            int(info["chunks_size"]),
            _megabytes(info["data_files_size_in_mb"]),
            _megabytes(info["video_files_size_in_mb"]),
        )
        features = info["features"]
        if "observation.state" not in features:
            raise KeyError("features: observation.state")
        depth_storage = features.get(DEPTH_KEY, {}).get("dtype", "video")
    except (AttributeError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise FileFormatError(root / INFO_PATH, f"damaged: {error!r}") from error
    front = _card_front(root / "README.md")
    return DatasetFacts(
        front.get("pretty_name", root.name),
        front.get("license", "unknown"),
        value,
        file_limits,
        depth_storage,
    )


def _megabytes(value: Any) -> float:
    """Return a size in the notation of the file, so that it is written back unchanged."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e9:
        raise ValueError(f"size {brief(value)} MB; valid: a number above 0")
    return value


def _card_front(path: Path) -> dict[str, str]:
    """Return the text values of a card's front matter, as `dataset_card` writes them."""
    if not path.exists():
        return {}
    found = {}
    text = read_input(path, root=path.parent, max_bytes=MAX_CARD_BYTES).decode(errors="replace")
    for line in text.partition("\n---")[0].splitlines():
        key, _, value = line.partition(": ")
        if key in ("license", "pretty_name"):
            try:
                found[key] = str(json.loads(value))
            except ValueError:
                found[key] = value.strip()
    return found
