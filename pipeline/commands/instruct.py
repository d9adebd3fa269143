"""`vlnpe instruct`: texts for the paths of one episode file."""

import sys
from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

from ...formats.core.atomic import write_bytes
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.vlnce.files import read_episodes, scene_stem, write_episodes
from ...instruction_gen.facts import path_facts
from ...instruction_gen.instruct import Levels
from ...instruction_gen.llm.brief import SIGHT_PROMPTS, prompts_sha256
from ...instruction_gen.llm.settings import settings_from
from ...instruction_gen.records import LLM, LOCAL, InstructConfig, parse_languages, parse_styles
from ...instruction_gen.show import show_path
from ..engine.context import open_single, run_output
from ..engine.ledger import Row
from ..engine.runner import Context, StageSummary, run_stage
from ..engine.work import digest, work_item
from ..inputs.episodes import episode_files, scenes_of
from ..jobs.instructions.instruct import CACHE, OBJECTS, InstructJob, read_facts, read_sights
from ..jobs.instructions.name_things import NameThingsJob
from ..options.instructions import Instruct
from ..options.shared import Wording
from ..stages import instruct, repair, visibility
from ..summary import print_result

# In the ledger's folder.
EPISODES, FACTS = "episodes.json.gz", "facts.json.gz"
NAMING = "name things"


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
    vision = None
    if options.vision:
        vision = settings_from(
            asked_by="--vision", max_tokens=options.max_tokens, max_cost=options.max_cost
        )
    camera = "aliengo" if options.robot == "none" else options.robot
    with open_single(out, options.workers) as context:
        root = context.ledger.root
        keys = [digest(asked), *(rows[scene].key for scene in sorted(by_scene))]
        seen: tuple[Path, ...] = ()
        lost: dict[str, str] = {}
        if options.robot != "none" and by_scene:
            looked = _look(context, by_scene, rows, scenes, options.robot, config.replace)
            good = looked.good()
            keys += [row.key for row in good.values()]
            seen = tuple(_seen(root, scene) for scene in good)
            lost = {
                episode.episode_id: row.error["reason"]
                for row in looked.rows
                if row.status == "quarantined"
                for episode in by_scene[row.item]
            }
        write_episodes(root / EPISODES, [e for e in asked if e.episode_id not in lost])
        cache = (options.cache or out.parent / CACHE).resolve()
        named: Path | None = None
        naming_facts: dict[str, Any] = {}
        if vision is not None:
            named = root / OBJECTS
            naming = NameThingsJob(scenes, root / EPISODES, vision, camera, cache, named)
            inputs = (*keys, vision, camera, prompts_sha256(SIGHT_PROMPTS))
            item = work_item(NAMING, out.name, naming, (named,), *inputs)
            (row,) = run_stage(context, NAMING, [item], required=True).rows
            naming_facts, keys = row.facts, [*keys, row.key]
        _forget(root, {*seen, named})
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
            objects=named,
            vision_model=vision.model if vision else "",
        )
        keys.append(str(options.per_instruction))
        made = run_output(context, out, instruct.STAGE, instruct.item(out.name, job, *keys)).facts
    spent = {"vision_model": naming_facts["language_model"]} if naming_facts else {}
    failed = lost | made["quarantined"]
    if options.facts is not None:
        write_bytes(options.facts, job.facts.read_bytes())
    if not options.json:
        _show(read_episodes(out), job, options.show)
        sys.stdout.writelines(f"no true text for {k}: {v}\n" for k, v in failed.items())
        for scene, count in naming_facts.get("named_things", {}).items():
            sys.stdout.write(f"{scene}: {count} things named by the vision-language model\n")
        for label, count in made["unnamed_labels"].items():
            sys.stdout.write(f"no noun is known for the label {label!r} ({count} objects)\n")
    text = f"{options.out}: {made['episodes']} episodes, {made['texts']} texts"
    kept = 0 if config.replace else sum(bool(episode.instruction) for episode in asked)
    if kept:
        text += f"; {kept} episodes had texts and keep them, --replace writes new ones"
    print_result(options, made | spent | {"quarantined": failed}, text)
    return int(len(failed) > options.max_failed)


def _look(
    context: Context,
    by_scene: Mapping[str, list[Episode]],
    rows: Mapping[str, Row],
    scenes: Path,
    robot: str,
    every: bool,
) -> StageSummary:
    """Look along the paths of each scene with the camera of `robot`; one item per scene."""
    root, items = context.ledger.root, []
    for scene, episodes in by_scene.items():
        part = root / f"{scene}.json.gz"
        write_episodes(part, episodes)
        source = Row("episodes", scene, digest(rows[scene].key, episodes), "done")
        items.append(visibility.item(source, scenes, part, _seen(root, scene), robot, every))
    return run_stage(context, visibility.STAGE, items, required=True)


def _forget(root: Path, used: Set[Path | None]) -> None:
    """Delete what earlier runs saw and named: `vlnpe review` judges texts by what is there."""
    for path in {*root.glob("*.seen.json"), root / OBJECTS} - used:
        path.unlink(missing_ok=True)


def _seen(root: Path, scene: str) -> Path:
    return root / f"{scene}.seen.json"


def _show(episodes: list[Episode], job: InstructJob, count: int) -> None:
    """Print the map and the texts of the first `count` paths that got texts."""
    if count < 1:
        return
    instructed = read_facts(job.facts)
    levels, sight = Levels(job.scenes), read_sights(job.seen)
    for episode in [e for e in episodes if e.trajectory_id in instructed][:count]:
        facts = path_facts(episode, levels.of(episode), sight)
        sys.stdout.write(show_path(episode, facts) + "\n\n")


def instruct_config(options: Wording) -> InstructConfig:
    """Return the configuration of the instructions that `collect` and `instruct` were asked for.

    Raises:
        InputError: an unknown name or a bad number; the message lists the valid ones.
    """
    asked = None
    if options.writer in (LLM, LOCAL):
        asked = settings_from(
            local=options.writer == LOCAL,
            max_tokens=options.max_tokens,
            max_cost=options.max_cost,
        )
    return InstructConfig(
        writer=options.writer,
        styles=parse_styles(options.style),
        count=options.count,
        languages=parse_languages(options.language),
        replace=options.replace,
        llm=asked,
    )
