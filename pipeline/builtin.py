"""Names of the built-in scenes: `builtin`, `builtin:house`, `builtin:villa*10`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..formats.core.errors import InputError, UnknownNameError

BUILTIN = "builtin"
_DEFAULT_KIND = "apartment"
_FORM = re.compile(rf"{BUILTIN}(?::(?P<kind>[^*]*))?(?:\*(?P<count>.*))?")
_MOST = 1000


@dataclass(frozen=True)
class BuiltIn:
    """A building to generate.

    Attributes:
        kind: key of `apartments.BUILDINGS`.
        seed: of the building.
    """

    kind: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the scene; the same building has the same name in every run."""
        return f"{self.kind}-{self.seed}"


def parse_builtin(text: str, seed: int) -> list[BuiltIn]:
    """The buildings that a scene's name asks for; none if it names a file.

    `builtin` is the apartment of `seed`, `builtin:KIND` another kind of building, and
    `builtin:KIND*N` the N buildings of `seed`, `seed` + 1, ….

    Raises:
        InputError: the kind is unknown, or the number is not one from 1 to 1,000.
    """
    found = _FORM.fullmatch(text)
    if not found:
        return []
    kind = _DEFAULT_KIND if found["kind"] is None else found["kind"]
    check_kind(kind)
    count = found["count"]
    if count is None:
        return [BuiltIn(kind, seed)]
    if not (count.isascii() and count.isdigit() and 1 <= int(count) <= _MOST):
        raise InputError(
            f"scene {text!r}: {count!r} is not a number of buildings; valid: 1 to {_MOST:,}, "
            f"for example {BUILTIN}:{kind}*10"
        )
    return [BuiltIn(kind, seed + k) for k in range(int(count))]


def check_kind(kind: str) -> None:
    """Raise UnknownNameError if there is no such kind of building."""
    # Takes long to import, and most runs have scans of their own.
    from ..apartments.config import BUILDINGS

    if kind not in BUILDINGS:
        raise UnknownNameError("built-in building", kind, BUILDINGS)
