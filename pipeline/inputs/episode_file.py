"""The episodes and scenes of a run that a user names, or of an episode file."""

from pathlib import Path

from ...formats.core.episode import Episode
from ...formats.core.errors import InputError, check_name
from ...formats.vlnce.files import read_episodes


def episodes_of(
    given: Path, scenes_folder: Path | None, split: str | None
) -> tuple[list[Episode], Path]:
    """Return the episodes of a run or an episode file, and the folder of their scenes.

    Args:
        given: run folder, or episode file.
        scenes_folder: see `scenes_of`.
        split: only this one; all when None.
    """
    files = episode_files(given)
    scenes = scenes_of(given, scenes_folder)
    episodes = [episode for path in files for episode in read_episodes(path)]
    splits = {episode.split for episode in episodes}
    if split is not None:
        check_name("split", split, splits)
        episodes = [e for e in episodes if e.split == split]
    return episodes, scenes


def episode_files(given: Path) -> list[Path]:
    """Return the episode files of a run, one per split, or the one that is given."""
    if not given.exists():
        raise InputError(f"{given}: no such file or folder")
    if not given.is_dir():
        return [given]
    # A run's episodes, or a folder of nothing but episode files.
    inside = given / "episodes" if (given / "episodes").is_dir() else given
    files = sorted(inside.glob("*.json.gz"))
    if not files:
        raise InputError(f"{given}: contains no episodes/*.json.gz; give a run or an episode file")
    return files


def scenes_of(given: Path, scenes: Path | None) -> Path:
    """Return the folder of repaired scenes: `scenes`, or by default that of a run.

    Args:
        given: a run folder, or a file in its `episodes/`; anything else needs `scenes`.
    """
    if scenes is not None:
        return scenes
    parent = given.absolute().parent
    run = given if given.is_dir() else parent.parent if parent.name == "episodes" else None
    if run is not None and (run / "scenes").is_dir():
        return run / "scenes"
    if given.is_dir():
        raise InputError(f"{given}: contains no scenes/; give it with --scenes FOLDER")
    raise InputError(f"{given} is a file outside of a run; give its scenes with --scenes FOLDER")
