"""What a person may drive: the scenes of a command, copied into its run, and its episodes."""

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.vlnce.groups import group_by_path
from ..collect.command import sources_of
from ..collect.episode_chain import repaired
from ..collect.run import Run
from ..context import LEDGERS
from ..engine.ledger import Ledger, Row
from ..inputs.episode_file import episodes_of
from ..inputs.folders import scenes_in
from ..options.collect import Collect
from ..options.viewer import Drive
from ..stages.scenes import items as repair


def chosen_scenes(run: Run, options: Drive) -> dict[str, Row]:
    """Return the rows of the scenes that `options.scene` names, which are in the run then."""
    given = Path(options.scene)
    if not given.is_dir():
        collect = Collect(scene=options.scene, seed=options.seed)
        config = collect.repair_config(collision="")
        return repaired(run, sources_of(collect, [], ""), config, allow_unsound=False)
    inside = given / "scenes" if (given / "scenes").is_dir() else given
    return {name: _copied(run, path) for name, path in scenes_in(inside.resolve()).items()}


def _copied(run: Run, scene: Path) -> Row:
    """Copy a repaired scene into the run, so that this stands alone; return its row."""
    ledger, copy = run.context.ledger, run.folder.scenes / scene.name
    source = _ledger_of(scene)
    row = source.row(repair.STAGE, scene.name)
    if row is None or row.status != "done":
        raise InputError(f"{scene}: {source.root} has no record of its repair; repair it again")
    if scene != copy and not ledger.is_done(repair.STAGE, scene.name, row.key):
        with atomic_folder(copy) as temporary:
            shutil.copytree(scene, temporary, dirs_exist_ok=True)
        output = ledger.relative(copy)
        records = next(iter(source.records(row).values()), {})
        copied = replace(row, outputs=(output,), current=True)
        ledger.add(copied, {output: records})
    return row


def _ledger_of(scene: Path) -> Ledger:
    """Return the ledger that records a repaired scene: its run's, or the one beside it."""
    for root in (scene.parent.parent, scene.parent / LEDGERS / scene.name):
        ledger = Ledger(root)
        if ledger.row(repair.STAGE, scene.name) is not None:
            return ledger
    return Ledger(scene.parent.parent)


def given_episodes(options: Drive, scenes: Mapping[str, Row]) -> list[Episode]:
    """Return the episodes whose instructions are to be followed, one for each path.

    Raises:
        InputError: there is none in these scenes, or the file cannot be used.
    """
    assert options.episodes is not None
    # Only the names of its scenes matter: they are in the run by now.
    episodes, _ = episodes_of(options.episodes, options.episodes, options.split)
    here = [episode for episode in group_by_path(episodes) if episode.scene_id in scenes]
    if not here:
        named = ", ".join(sorted({episode.scene_id for episode in episodes})) or "none"
        raise InputError(
            f"--episodes {options.episodes}: no episode in {', '.join(scenes)}; its scenes: {named}"
        )
    return here
