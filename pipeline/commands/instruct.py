"""`vlnpe instruct`: texts for the paths of one episode file."""

import sys
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...formats.core.atomic import write_bytes
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.vlnce.files import read_episodes, scene_stem, write_episodes
from ...instruction_gen.instruct import Levels
from ...instruction_gen.llm.settings import CACHE_NAME
from ...instruction_gen.show import show_path
from ..context import open_single, run_output
from ..engine.ledger import Row
from ..engine.run_folder import SightFiles
from ..engine.work import digest
from ..execution.runner import Context, StageSummary, run_stage
from ..inputs.crews import chosen_robot
from ..inputs.episode_file import episode_files, scenes_of
from ..inputs.wording import instruct_config, vision_settings
from ..options.instructions import Instruct
from ..stages.instructions import instruct_items as instruct
from ..stages.instructions import sight_items as sight
from ..stages.instructions.instruct_job import InstructJob, read_sights
from ..stages.scenes import items as repair
from ..summary import print_result

NO_ROBOT = "none"  # no camera looks along the paths
# In the ledger's folder.
EPISODES, FACTS = "episodes.json.gz", "facts.json.gz"


@dataclass(frozen=True)
class _Task:
    """The episodes to instruct, by the scene that they lie in."""

    episodes: Sequence[Episode]
    by_scene: Mapping[str, Sequence[Episode]]
    scenes: Path
    keys: Mapping[str, str]

    def rows(self) -> dict[str, Row]:
        """Return a row for each scene's episodes, as if a stage had made them."""
        return {
            scene: Row("episodes", scene, digest(self.keys[scene], episodes), "done")
            for scene, episodes in self.by_scene.items()
        }


def run(options: Instruct) -> int:
    """Instruct one file's episodes; return 1 if too many have no true text."""
    config, vision = instruct_config(options), vision_settings(options)
    task = _task(options)
    robot = chosen_robot(Instruct.robot if options.robot == NO_ROBOT else options.robot)
    out = options.out.resolve()
    cache = (options.cache or out.parent / CACHE_NAME).resolve()
    with open_single(out, options.workers) as context:
        files = SightFiles(context.ledger.root)
        observer = sight.Sight(task.scenes, files, robot, config.replace)
        model = sight.Model(vision, cache) if vision else None
        seen, names = _observed(context, observer, task, options.robot != NO_ROBOT, model)
        sight_rows = [*seen.rows, *names.rows]
        lost = {
            episode.episode_id: row.error["reason"]
            for row in sight_rows
            if row.status == "quarantined"
            for episode in task.by_scene[row.item]
        }
        left = [e for e in task.episodes if e.episode_id not in lost]
        write_episodes(context.ledger.root / EPISODES, left)
        records = tuple(files.seen(scene) for scene in seen.good())
        named = tuple(files.named(scene) for scene in names.good())
        _forget(files, {*records, *named})
        job = InstructJob(
            scenes=task.scenes,
            episodes=context.ledger.root / EPISODES,
            seen=records,
            out=out,
            facts=context.ledger.root / FACTS,
            cache=cache,
            config=config,
            seed=options.seed,
            per_instruction=options.per_instruction,
            named=named,
            vision_model=vision.model if vision else "",
        )
        keys = [digest(task.episodes), *(task.keys[scene] for scene in sorted(task.by_scene))]
        keys += [row.key for row in sight_rows if row.status == "done"]
        item = instruct.item(out.name, job, *keys, str(options.per_instruction))
        facts = run_output(context, out, instruct.STAGE, item).facts
    if options.facts is not None:
        write_bytes(options.facts, job.facts.read_bytes())
    facts["quarantined"] = lost | facts["quarantined"]
    if naming := names.good():
        facts["vision_model"] = sight.model_usage(naming.values())
    _print(options, task, job, facts, naming)
    return int(len(facts["quarantined"]) > options.max_failed)


def _task(options: Instruct) -> _Task:
    source, *more = episode_files(options.episodes)
    if more:
        names = ", ".join(map(str, (source, *more)))
        raise InputError(f"{options.episodes}: has several episode files; valid: one of {names}")
    scenes = scenes_of(options.episodes, options.scenes)
    episodes = read_episodes(source)
    rows = repair.rows_of(scenes)
    by_scene: dict[str, list[Episode]] = {}
    for episode in episodes:
        by_scene.setdefault(scene_stem(episode.scene_id), []).append(episode)
    repair.demand(by_scene, rows, scenes)
    keys = {scene: rows[scene].key for scene in by_scene}
    return _Task(episodes, by_scene, scenes.resolve(), keys)


def _observed(
    context: Context, looking: sight.Sight, task: _Task, look: bool, model: sight.Model | None
) -> tuple[StageSummary, StageSummary]:
    """Run the stages `look` and `name`, each if it is asked for."""
    rows = task.rows()
    parts = {scene: context.ledger.root / f"{scene}.json.gz" for scene in rows}
    for scene, episodes in task.by_scene.items():
        write_episodes(parts[scene], episodes)
    stage = partial(run_stage, context)
    looked = named = StageSummary(sight.STAGE)
    if look and rows:
        items = [looking.look(row, parts[scene]) for scene, row in rows.items()]
        looked = stage(sight.STAGE, items, required=True)
    if model and rows:
        named = sight.named_scenes(stage, looking, model, rows, parts)
    return looked, named


def _print(
    options: Instruct,
    task: _Task,
    job: InstructJob,
    facts: dict[str, Any],
    named: Mapping[str, Row],
) -> None:
    replace = job.config.replace
    if not options.json:
        if options.show > 0:
            new = {e.trajectory_id for e in task.episodes if replace or not e.instruction}
            shown = sorted(read_episodes(job.out), key=lambda e: e.trajectory_id not in new)
            _show(shown[: options.show], job)
        for name, reason in facts["quarantined"].items():
            sys.stdout.write(f"no true text for {name}: {reason}\n")
        sys.stdout.writelines(sight.naming_report(named.values()))
        for label, count in facts["unnamed_labels"].items():
            sys.stdout.write(f"no noun is known for the label {label!r} ({count} objects)\n")
    text = f"{options.out}: {facts['episodes']} episodes, {facts['texts']} texts"
    if facts["unchecked"]:
        text += f"; {facts['unchecked']} with unchecked words are not exported before a review"
    if facts["ambiguous"]:
        text += f"; {facts['ambiguous']} may lead elsewhere, too: nothing there has a name"
    unchanged = 0 if replace else sum(bool(episode.instruction) for episode in task.episodes)
    if unchanged:
        text += f"; {unchanged} episodes had texts and keep them, --replace writes new ones"
    print_result(options, facts, text)


def _forget(files: SightFiles, used: Set[Path]) -> None:
    """Delete what earlier runs saw and named: `vlnpe review` judges texts by what is there."""
    for path in {*files.all_seen(), *files.all_named()} - used:
        path.unlink(missing_ok=True)


def _show(episodes: Sequence[Episode], job: InstructJob) -> None:
    """Print the map and the texts of episodes."""
    levels, sight = Levels(job.scenes), read_sights(job.seen)
    for episode in episodes:
        facts = levels.facts(episode, sight)
        sys.stdout.write(show_path(episode, facts, levels.of(episode)) + "\n\n")
