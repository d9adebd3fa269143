"""Names of the built-in scenes: `builtin`, `builtin:house`, `builtin-exact:villa*10@100`."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...formats.core.errors import InputError, check_name, did_you_mean

BUILTIN = "builtin"
_DEFAULT_KIND = "apartment"
_FORM = re.compile(
    rf"{BUILTIN}(?P<exact>-exact)?(?::(?P<kind>[^*@]*))?(?:\*(?P<count>[^@]*))?(?:@(?P<seed>.*))?"
)
_MOST = 1000
_EXACT = "exact-"  # how names of scenes begin that are no scans


@dataclass(frozen=True)
class BuiltIn:
    """A building to generate.

    Attributes:
        kind: key of `apartments.BUILDINGS`.
        scanned: scan it virtually; otherwise its exact, textured geometry is used as the scan.
    """

    kind: str
    seed: int
    scanned: bool = True

    @property
    def name(self) -> str:
        """Name of the scene; the same building has the same name in every run."""
        return f"{'' if self.scanned else _EXACT}{self.kind}-{self.seed}"

    def and_next(self, count: int) -> "list[BuiltIn]":
        """Return `count` buildings of consecutive seeds, of which this is the first."""
        return [replace(self, seed=self.seed + k) for k in range(count)]


def building_of(scene_id: str) -> str:
    """Return one name for a scene whether it was scanned virtually or not."""
    return scene_id.removeprefix(_EXACT)


def parse_builtin(text: str, seed: int) -> list[BuiltIn]:
    """Return the buildings that a scene's name asks for; none if it names a file.

    `builtin` is the apartment of `seed`, `builtin:KIND` another kind of building, `builtin:KIND*N`
    the N buildings of `seed`, `seed` + 1, …, and `builtin:KIND*N@S` those of S, S + 1, ….
    `builtin-exact…` are the same buildings without the virtual scan. Several, comma-separated,
    follow one another.
    """
    parts = [part.strip() for part in text.split(",")]
    matches = [_FORM.fullmatch(part) for part in parts]
    if not any(matches):
        return []
    result: list[BuiltIn] = []
    for part, match in zip(parts, matches, strict=True):
        if match is None:
            raise InputError(
                f"scene {text!r}: {part!r} is not a built-in scene; valid: one file, or {BUILTIN}…"
            )
        result += _buildings(part, match, seed)
    names = [building.name for building in result]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"scene {text!r}: {twice} is listed twice; valid: each building once")
    return result


def _buildings(text: str, match: re.Match[str], seed: int) -> list[BuiltIn]:
    kind = _DEFAULT_KIND if match["kind"] is None else match["kind"]
    check_kind(kind)
    count, first = match["count"], match["seed"]
    if count is not None and not (_is_number(count) and 1 <= int(count) <= _MOST):
        raise InputError(
            f"scene {text!r}: {count!r} is not a number of buildings; valid: 1 to {_MOST:,}, "
            f"for example {BUILTIN}:{kind}*10"
        )
    if first is not None and not _is_number(first):
        raise InputError(
            f"scene {text!r}: {first!r} is not a seed; valid: a whole number, for example "
            f"{BUILTIN}:{kind}*10@100"
        )
    start = seed if first is None else int(first)
    return BuiltIn(kind, start, not match["exact"]).and_next(1 if count is None else int(count))


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit()


def no_scene(text: str, suffixes: Sequence[str]) -> InputError:
    """Return the error for a scene's name that is neither a file nor a built-in scene."""
    from ...apartments.config import BUILDINGS

    hint = did_you_mean(re.split("[:*@]", text)[0], (BUILTIN, f"{BUILTIN}-exact"))
    kinds = ", ".join(f"{BUILTIN}:{kind}" for kind in BUILDINGS)
    return InputError(
        f"scene {text!r}{hint}: no such file; valid: {BUILTIN}, {kinds}, the same with "
        f"{BUILTIN}-exact, or a scan ({', '.join(suffixes)})"
    )


def check_kind(kind: str) -> None:
    """Raise UnknownNameError if there is no such kind of building."""
    # Takes long to import, and most runs have scans of their own.
    from ...apartments.config import BUILDINGS

    check_name("built-in building", kind, BUILDINGS)
