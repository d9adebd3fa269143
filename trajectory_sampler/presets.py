"""Numbers of paths per scene and split: published sets, or your own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..formats.core.errors import InputError, check_name

TRAIN = "train"


@dataclass(frozen=True)
class Preset:
    """A published set's sizes.

    Attributes:
        instructions: per path.
        scenes: how many are needed.
        seen: how many of them are for training.
    """

    splits: Mapping[str, int]
    instructions: int
    scenes: int
    seen: int


# VLN-PE publishes instruction episodes: 441 / 111 / 1,287 over ten scenes, three trained in. All
# three divide by three, so they are read as paths times three instructions (an inference).
# 3DGS-Lab-VLN has 160 / 640 in one scene, which do not; they are read as paths times four.
PRESETS: dict[str, Preset] = {
    "gru_vln10": Preset({TRAIN: 147, "val_seen": 37, "val_unseen": 429}, 3, 10, 3),
    "lab_3dgs": Preset({TRAIN: 40, "val_seen": 160}, 4, 1, 1),
}


def get_preset(name: str) -> Preset:
    """Return the preset of a name."""
    check_name("preset", name, PRESETS)
    return PRESETS[name]


def parse_splits(text: str) -> dict[str, int]:
    """Return `train=40,val_seen=10` → paths by split."""
    return _parse_counts(text, "splits", "train=147,val_seen=37,val_unseen=429")


def parse_quotas(text: str) -> dict[str, int]:
    """Return `home_1=40,home_2=80` → paths by scene; "" → none."""
    return _parse_counts(text, "quotas", "home_1=40,home_2=80") if text else {}


def is_seen(split: str) -> bool:
    """Return whether a split has the scenes of training, as `val_seen` has."""
    return "unseen" not in split and not split.startswith("test")


def choose_seen(
    splits: Mapping[str, int], scenes: Sequence[str], count: int = 0, named: Sequence[str] = ()
) -> list[str]:
    """Return the scenes of training.

    Args:
        scenes: all scenes, in the user's order.
        count: how many to take; 0 takes as many as the splits' sizes ask for.
        named: the scenes themselves, if the user names them.
    """
    seen = sum(n for split, n in splits.items() if is_seen(split))
    unseen = sum(splits.values()) - seen
    for name in named:
        check_name("scene to train in", name, scenes)
    if named:
        chosen = [scene for scene in scenes if scene in set(named)]
    else:
        share = round(len(scenes) * seen / max(1, seen + unseen))
        number = count or (share if unseen else len(scenes))
        if unseen and not count:
            number = min(number, len(scenes) - 1)
        chosen = list(scenes[: max(number, 1 if seen else 0)])
    if unseen and len(chosen) >= len(scenes):
        split = next(split for split in splits if not is_seen(split))
        raise InputError(
            f"{split} needs a scene outside the training scenes: of {len(scenes)} given, "
            f"{len(chosen)} are training scenes; give more scenes, or ask for val_seen instead"
        )
    return chosen


def plan_quotas(
    splits: Mapping[str, int],
    scenes: Sequence[str],
    seen: Sequence[str],
    fixed: Mapping[str, int] | None = None,
) -> dict[str, dict[str, int]]:
    """Spread the paths of each split over its scenes, as evenly as whole numbers allow.

    Args:
        seen: the scenes of training; `val_seen` shares them, `val_unseen` has the others.
        fixed: total paths of single scenes; the other scenes share what is left.

    Returns:
        Paths by split, by scene; scenes and splits without any are left out.
    """
    fixed = dict(fixed or {})
    for scene in fixed:
        check_name("scene with a quota", scene, scenes)
    result: dict[str, dict[str, int]] = {scene: {} for scene in scenes}
    for kind in (True, False):
        own = [scene for scene in scenes if (scene in seen) == kind]
        requested = {split: n for split, n in splits.items() if is_seen(split) == kind and n}
        total = sum(requested.values())
        if not total:
            continue
        set_here = {scene: fixed[scene] for scene in own if scene in fixed}
        free = [scene for scene in own if scene not in fixed]
        left = total - sum(set_here.values())
        if left < 0 or (left and not free):
            raise InputError(
                f"{', '.join(requested)} ask for {total} paths, the quotas of their scenes for "
                f"{sum(set_here.values())}; valid: quotas that leave the rest to other scenes"
            )
        sizes = set_here | dict(zip(free, _even(left, len(free)), strict=True))
        _deal(requested, sizes, result)
    return {scene: quota for scene, quota in result.items() if quota}


def _deal(
    requested: Mapping[str, int], sizes: Mapping[str, int], result: dict[str, dict[str, int]]
) -> None:
    """Divide each scene's paths among splits so that both kinds of sum are exact."""
    room = dict(sizes)
    left = sum(sizes.values())
    for split, count in requested.items():
        # Cumulative rounding: every scene gets its share of the split, to within one path.
        before, given = 0, 0
        for scene in sizes:
            before += room[scene]
            share = round(count * before / left) - given
            given += share
            if share:
                result[scene][split] = share
            room[scene] -= share
        left -= count


def _even(total: int, parts: int) -> list[int]:
    return [total // parts + (k < total % parts) for k in range(parts)] if parts else []


def _parse_counts(text: str, what: str, example: str) -> dict[str, int]:
    result: dict[str, int] = {}
    for part in text.split(","):
        name, _, number = part.strip().partition("=")
        if not name or not number.isdecimal() or int(number) < 1 or name in result:
            raise InputError(f"{what} {text!r}: {part.strip()!r}; valid: for example {example}")
        result[name] = int(number)
    return result
