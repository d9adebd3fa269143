"""`vlnpe instruct`: texts for the paths of one episode file."""

import sys
from collections.abc import Mapping, Sequence, Set
from pathlib import Path

from ...formats.core.atomic import write_bytes
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.vlnce.files import read_episodes, scene_stem, write_episodes
from ...instruction_gen.facts import path_facts
from ...instruction_gen.instruct import Levels
from ...instruction_gen.show import show_path
from ..context import open_single, run_output
from ..engine.ledger import Row
from ..engine.run_folder import SightFiles
from ..engine.runner import run_stage
from ..engine.work import digest
from ..inputs.crews import chosen_robot
from ..inputs.episode_file import episode_files, scenes_of
from ..inputs.wording import instruct_config, vision_settings
from ..options.instructions import Instruct
from ..stages.instructions import instruct_items as instruct
from ..stages.instructions import sight_items as sight
from ..stages.instructions.instruct_job import CACHE, InstructJob, read_sights
from ..stages.scenes import items as repair
from ..summary import print_result

NO_ROBOT = "none"  # no camera looks along the paths
# In the ledger's folder.
EPISODES, FACTS = "episodes.json.gz", "facts.json.gz"


def run(options: Instruct) -> int:
    """Instruct one file's episodes; return 1 if too many have no true text.

    Raises:
        InputError: If an option is invalid, or a file or folder cannot be used.
    """
    config = instruct_config(options)
    source, *more = episode_files(options.episodes)
    if more:
        names = ", ".join(map(str, (source, *more)))
        raise InputError(f"{options.episodes}: has several episode files; valid: one of {names}")
    scenes = scenes_of(options.episodes, options.scenes)
    asked = read_episodes(source)
    rows = repair.rows_of(scenes)
    by_scene: dict[str, list[Episode]] = {}
    for episode in asked:
        by_scene.setdefault(scene_stem(episode.scene_id), []).append(episode)
    repair.demand(by_scene, rows, scenes)
    out, scenes = options.out.resolve(), scenes.resolve()
    vision = vision_settings(options)
    robot = chosen_robot(Instruct.robot if options.robot == NO_ROBOT else options.robot)
    with open_single(out, options.workers) as context:
        root = context.ledger.root
        files = SightFiles(root)
        looking = sight.Sight(scenes, files, robot, config.replace)
        for scene, episodes in by_scene.items():
            write_episodes(_part(root, scene), episodes)
        keys = [digest(asked), *(rows[scene].key for scene in sorted(by_scene))]
        cache = (options.cache or out.parent / CACHE).resolve()
        made_before: list[Row] = []
        seen: tuple[Path, ...] = ()
        if options.robot != NO_ROBOT and by_scene:
            items = [
                looking.look(
                    Row("episodes", scene, digest(rows[scene].key, episodes), "done"),
                    _part(root, scene),
                )
                for scene, episodes in by_scene.items()
            ]
            looked = run_stage(context, sight.STAGE, items, required=True)
            made_before += looked.rows
            seen = tuple(files.seen(scene) for scene in looked.good())
        naming: Mapping[str, Row] = {}
        if vision is not None and by_scene:
            items = [
                looking.name(
                    scene, [_part(root, scene)], vision, cache, rows[scene].key, digest(episodes)
                )
                for scene, episodes in by_scene.items()
            ]
            summary = run_stage(context, sight.NAME_STAGE, items, required=True)
            made_before += summary.rows
            naming = summary.good()
        keys += [row.key for row in made_before if row.status == "done"]
        lost = {
            episode.episode_id: row.error["reason"]
            for row in made_before
            if row.status == "quarantined"
            for episode in by_scene[row.item]
        }
        write_episodes(root / EPISODES, [e for e in asked if e.episode_id not in lost])
        named = tuple(files.named(scene) for scene in naming)
        _forget(files, {*seen, *named})
        job = InstructJob(
            scenes=scenes,
            episodes=root / EPISODES,
            seen=seen,
            out=out,
            facts=root / FACTS,
            cache=cache,
            config=config,
            seed=options.seed,
            per_instruction=options.per_instruction,
            named=named,
            vision_model=vision.model if vision else "",
        )
        keys.append(str(options.per_instruction))
        made = run_output(context, out, instruct.STAGE, instruct.item(out.name, job, *keys)).facts
    spent = {"vision_model": sight.model_usage(naming.values())} if naming else {}
    failed = lost | made["quarantined"]
    if options.facts is not None:
        write_bytes(options.facts, job.facts.read_bytes())
    if not options.json:
        if options.show > 0:
            new = {e.trajectory_id for e in asked if config.replace or not e.instruction}
            told = sorted(read_episodes(out), key=lambda e: e.trajectory_id not in new)
            _show(told[: options.show], job)
        sys.stdout.writelines(f"no true text for {k}: {v}\n" for k, v in failed.items())
        sys.stdout.writelines(sight.naming_report(naming.values()))
        for label, count in made["unnamed_labels"].items():
            sys.stdout.write(f"no noun is known for the label {label!r} ({count} objects)\n")
    text = f"{options.out}: {made['episodes']} episodes, {made['texts']} texts"
    kept = 0 if config.replace else sum(bool(episode.instruction) for episode in asked)
    if kept:
        text += f"; {kept} episodes had texts and keep them, --replace writes new ones"
    print_result(options, made | spent | {"quarantined": failed}, text)
    return int(len(failed) > options.max_failed)


def _forget(files: SightFiles, used: Set[Path]) -> None:
    """Delete what earlier runs saw and named: `vlnpe review` judges texts by what is there."""
    for path in {*files.all_seen(), *files.all_named()} - used:
        path.unlink(missing_ok=True)


def _part(root: Path, scene: str) -> Path:
    return root / f"{scene}.json.gz"


def _show(episodes: Sequence[Episode], job: InstructJob) -> None:
    """Print the map and the texts of episodes."""
    levels, sight = Levels(job.scenes), read_sights(job.seen)
    for episode in episodes:
        facts = path_facts(episode, levels.of(episode), sight)
        sys.stdout.write(show_path(episode, facts) + "\n\n")
