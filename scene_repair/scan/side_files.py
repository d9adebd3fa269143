"""Small files beside a scan (labels, licence): found by name, and only inside the scan's folder."""

from __future__ import annotations

from pathlib import Path

from ...formats.core.errors import FileFormatError

LICENCE_NAMES = ("LICENSE.{stem}", "{stem}.LICENSE", "{stem}.license.txt", "LICENSE")
MAX_LICENCE_BYTES = 1 << 20
LABELS_NAME, MAX_LABELS_BYTES = "{stem}.labels.json", 64 << 20
HOUSE_NAME, MAX_HOUSE_BYTES = "{stem}.house", 256 << 20


def side_names(source: Path) -> list[str]:
    """Names of all files beside the scan `source` that are read with it if they are there."""
    stem = source.stem
    return [LABELS_NAME.format(stem=stem), HOUSE_NAME.format(stem=stem), *licence_names(stem)]


def licence_names(stem: str) -> list[str]:
    """Names a licence may have, the nearest first: `quest_room` may be under `LICENSE.quest`."""
    own = [pattern.format(stem=stem) for pattern in LICENCE_NAMES]
    ends = [k for k, letter in enumerate(stem) if letter in "_-" and k > 0]
    family = [LICENCE_NAMES[0].format(stem=stem[:k]) for k in reversed(ends)]
    return [*own[:-1], *family, own[-1]]


def side_file(folder: Path, name: str, max_bytes: int) -> bytes | None:
    """Bytes of the file `name` in `folder`, None if there is none.

    Raises:
        FileFormatError: a link out of the folder, larger than `max_bytes`, or unreadable.
    """
    path = folder / name
    try:
        if not path.is_file():
            return None
        target = path.resolve()
        if not target.is_relative_to(folder.resolve()):
            raise FileFormatError(path, "is a link that leaves the scan's folder")
        size = target.stat().st_size
        if size > max_bytes:
            raise FileFormatError(path, f"is larger than {max_bytes >> 20} MiB ({size:,} bytes)")
        return target.read_bytes()
    except (OSError, RuntimeError) as error:
        raise FileFormatError(path, f"cannot be read: {error}") from error


def licence_beside(source: Path) -> str:
    """Text of the licence file beside the source, empty if there is none.

    Raises:
        FileFormatError: no text, too large, or a link out of the folder.
    """
    for name in licence_names(source.stem):
        data = side_file(source.parent, name, MAX_LICENCE_BYTES)
        if data is not None:
            try:
                return data.decode()
            except UnicodeDecodeError as error:
                path = source.with_name(name)
                raise FileFormatError(path, "licence is not text in UTF-8") from error
    return ""
