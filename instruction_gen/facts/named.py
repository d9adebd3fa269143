"""What is named in a scene beside its labels, by a vision-language model, as JSON on disk."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ...formats.core.atomic import write_json
from ...formats.core.errors import FileFormatError
from ...formats.scene.bundle import LabeledObject

SUFFIX = ".named.json"  # after the scene's id in the name of its file


@dataclass(frozen=True)
class NamedRoom:
    """The name of a room that the scene has no label for.

    Attributes:
        name: see `language.nouns.room_of`.
        xy_m: any place in it [m].
    """

    name: str
    xy_m: tuple[float, float]
    level: int


@dataclass(frozen=True)
class Named:
    """What is named in one scene."""

    objects: tuple[LabeledObject, ...] = ()
    rooms: tuple[NamedRoom, ...] = ()


def write_named(path: Path, named: Named | None) -> None:
    """Write what is named in a scene; None where its own labels are enough."""
    write_json(path, asdict(named) if named else None)


def read_named(paths: Sequence[Path]) -> dict[str, Named]:
    """Read what is named, by scene, without the scenes whose own labels are enough.

    Raises:
        FileFormatError: a file is missing or damaged.
    """
    found = {path.name.removesuffix(SUFFIX): _read(path) for path in paths}
    return {scene: named for scene, named in found.items() if named is not None}


def _read(path: Path) -> Named | None:
    try:
        return TypeAdapter(Named | None).validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise FileFormatError(path, f"no record of what is named: {error}") from error
