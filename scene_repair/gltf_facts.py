"""What a glTF file says about itself: licence, and the facts of a generated scene."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from ..formats.errors import FileFormatError

OWN_GENERATOR = "vlnpe"


def gltf_facts(path: Path) -> tuple[str, dict[str, Any]]:
    """Licence (empty if the file tells none) and generator facts of a GLB or glTF file.

    Raises:
        FileFormatError: the header is damaged.
    """
    try:
        header = _header(path)
        asset = header.get("asset", {}) if isinstance(header, dict) else {}
        extras = asset.get("extras", {})
        extras = extras if isinstance(extras, dict) else {}
    except (ValueError, struct.error, AttributeError) as error:
        raise FileFormatError(path, f"damaged glTF header: {error}") from error
    licence = str(extras.get("licence") or extras.get("license") or asset.get("copyright") or "")
    if asset.get("generator") != OWN_GENERATOR:
        return licence, {}
    return licence, {k: v for k, v in extras.items() if k not in ("licence", "license")}


def _header(path: Path) -> Any:
    if path.suffix.lower() == ".gltf":
        return json.loads(path.read_text())
    with path.open("rb") as stream:
        magic, _, _, length, kind = struct.unpack("<4sIII4s", stream.read(20))
        if magic != b"glTF" or kind != b"JSON":
            raise ValueError("no glTF signature")
        if length > path.stat().st_size:
            raise ValueError(f"JSON chunk of {length} bytes in a smaller file")
        return json.loads(stream.read(length))
