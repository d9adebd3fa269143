"""From episodes to datasets: `replay`, `render`, `export` of one robot under one controller."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ...collectors.robots import RobotSpec
from ...formats.convert.dataset import read_facts
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.core.rollout import HUMAN
from ...formats.trainers.registry import LAYOUTS
from ...rendering.camera.extras import Extras
from ...rendering.camera.views import View
from ..engine.explain import parts_of
from ..engine.ledger import Ledger, Row
from ..execution.runner import WorkItem
from ..inputs.crews import Crew, action_timing
from ..inputs.robot_copies import robot_of_run
from ..stages.convert.layout_items import group_name, layout_items
from ..stages.datasets import export_items as export
from ..stages.datasets.export_job import UnitJob
from ..stages.datasets.mcap_job import McapJob
from ..stages.instructions import instruct_items as instruct
from ..stages.instructions import sight_items as sight
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.rollouts.render_job import RenderJob
from ..stages.rollouts.replay_job import ReplayJob, Walker
from . import together
from .run import Run

log = logging.getLogger(__name__)

# What a worker imports that takes an episode through all stages.
MODULES = tuple(job.__module__ for job in (ReplayJob, RenderJob, UnitJob, McapJob))


@dataclass(frozen=True)
class Product:
    """Settings of rendering and export.

    Attributes:
        only_success: leave failures out of the export; they are rendered in any case.
        depth_storage: what `export.check_depth_storage` takes.
        also: layouts of trainers, keys of `LAYOUTS`.
        language: Give datasets LeRobot's language column.
    """

    frames_per_second: int
    extras: Extras
    only_success: bool
    rgb_codec: str
    depth_storage: str
    mcap: bool = True
    also: tuple[str, ...] = ()
    language: bool = False


def select_current(
    run: Run, episodes: Sequence[Episode], scenes: Mapping[str, Row], pairs: Sequence[Crew]
) -> None:
    """Leave out robots other than `pairs` that walked other paths, or else than they would now.

    Those that walked some of these paths stay, also with more or fewer of them, and so do those of
    another seed: the report says how many each walked. `report.gather.left_out` tells the others.
    """
    ledger = run.context.ledger
    done = {tuple(row.item.split("/")[:2]) for row in ledger.rows(replay.STAGE)}
    current = {(crew[0].name, replay.label_of(ledger, _walker(run, crew).config)) for crew in pairs}
    for robot, label in sorted(done - current):
        if label == HUMAN:  # nobody can have a person drive other paths
            continue
        scope = f"{robot}/{label}/"
        rows = [row for row in ledger.rows(replay.STAGE) if row.item.startswith(scope)]
        try:
            walker = _recorded_walker(run, robot, rows)
            if walker.config.seed != run.seed or _agree(
                ledger, rows, episodes, _walks(run, episodes, scenes, walker, label)
            ):
                continue
        except InputError:  # a robot that is known no more
            pass
        for stage in (replay.STAGE, render.STAGE, export.STAGE, export.MCAP_STAGE):
            ledger.select(stage, scope, ())
        for stage in (export.DATASET_STAGE, *LAYOUTS):
            ledger.select(stage, f"{robot}-{label}-", ())


def collect(
    run: Run,
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    crew: Crew,
    views: Sequence[View],
    product: Product,
    facts: Mapping[str, Any],
) -> None:
    """Replay the episodes with one crew; render and export each view."""
    walker = _walker(run, crew)
    label = replay.label_of(run.context.ledger, walker.config)
    walks = _walks(run, episodes, scenes, walker, label)
    named = (crew[0], label)
    export_walks(run, episodes, walks, scenes, named, views=views, product=product, facts=facts)


def export_walks(
    run: Run,
    episodes: Sequence[Episode],
    walks: Sequence[WorkItem],
    scenes: Mapping[str, Row],
    crew: Crew,
    *,
    views: Sequence[View],
    product: Product,
    facts: Mapping[str, Any],
) -> None:
    """Make the walks; render and export each view.

    Args:
        walks: items of the replay stage, one of each episode.
        crew: robot, and the label of its walks.
    """
    folder, ledger, (robot, label) = run.folder, run.context.ledger, crew
    rollouts: dict[str, Row] | None = None
    datasets = []
    for view in views:
        dataset = export.Dataset.under(folder.root, robot.name, label, view.name)
        renders = partial(_renders, run, robot, scenes, view, product)
        of_view = f" {view.camera.name} {view.light}" if len(views) > 1 else ""
        exports = partial(
            export.items,
            root=folder.root,
            scenes=folder.scenes,
            robot=robot,
            dataset=dataset,
            depth_storage=product.depth_storage,
            per_instruction=run.per_instruction,
            mcap=product.mcap,
        )
        together.run(
            run.context,
            episodes,
            walks,
            renders,
            exports,
            only_success=product.only_success,
            label=f"{robot.name} {label}{of_view}",
        )
        if rollouts is None:
            rollouts = run.stage(replay.STAGE, walks, f"{robot.name}/{label}/").good()
            run.context.ledger.record_new(folder.models)
        frames = run.stage(render.STAGE, renders(rollouts), dataset.scope).good()
        # All models count their requests in one file.
        model_rows = [*ledger.rows(sight.NAME_STAGE), *ledger.rows(instruct.STAGE)]
        summaries = export.run(
            run.context,
            exports(export.rows_to_export(frames, product.only_success)),
            folder.scenes,
            dataset,
            {"options": dict(facts), "language_model": sight.model_usage(model_rows)},
            product.language,
        )
        run.summaries.extend(summaries)
        datasets.append(dataset)
    _write_layouts(run, datasets, product.also)


def _write_layouts(run: Run, datasets: Sequence[export.Dataset], layouts: Sequence[str]) -> None:
    """Write the layouts of trainers from the units of datasets; those not in `layouts` lapse.

    A layout that joins rigs takes those of earlier commands, too.
    """
    ledger, root = run.context.ledger, run.folder.root
    good = {row.item for row in ledger.done(export.DATASET_STAGE)}
    units: dict[str, dict[str, Row]] = {}
    for row in ledger.done(export.STAGE):
        units.setdefault("-".join(row.item.split("/")[:3]), {})[row.item] = row
    for layout in LAYOUTS:
        groups = {group_name(layout, dataset.name): dataset for dataset in datasets}
        for group, dataset in groups.items():
            members = sorted(n for n in good & {*units} if group_name(layout, n) == group)
            rows = {item: row for name in members for item, row in units[name].items()}
            if layout not in layouts or not rows:
                ledger.select(layout, f"{group}/", ())
                continue
            facts = read_facts(dataset.lerobot.with_name(members[0]))
            held_out = facts.provenance.get("held_out_scenes", ())
            how: dict[str, Any] = {"held_out": held_out, "licence": facts.licence}
            try:
                items = layout_items(layout, rows, root, group, **how)
            except InputError as error:  # the run itself is whole
                log.warning("--also %s: %s", layout, error)
                items = []
            run.stage(layout, items, f"{group}/")
            ledger.discard(layout, f"{group}/")


def _renders(
    run: Run,
    robot: RobotSpec,
    scenes: Mapping[str, Row],
    view: View,
    product: Product,
    rollouts: Mapping[str, Row],
) -> list[WorkItem]:
    folder = run.folder
    return render.items(
        render.Recorded(robot, rollouts, folder.root, scenes, folder.scenes),
        view,
        product.frames_per_second,
        folder.frames,
        folder.root,
        rgb_codec=product.rgb_codec,
        extras=product.extras,
        depth_storage=product.depth_storage,
    )


def _walker(run: Run, crew: Crew) -> Walker:
    return replay.walker(*crew, run.seed, run.actions, run.state)


def _recorded_walker(run: Run, name: str, rows: Sequence[Row]) -> Walker:
    """Return what walked the rollouts of some rows, which share robot and label."""
    robot = robot_of_run(name, run.folder.root)
    for facts in (row.facts for row in rows if "seed" in row.facts):
        actions = facts["actions"]
        timing = action_timing(**actions) if actions else run.actions
        state = facts.get("state", "true")
        return replay.walker(robot, facts["controller"], facts["seed"], timing, state)
    return _walker(run, (robot, rows[0].item.split("/")[1]))


def _walks(
    run: Run, episodes: Sequence[Episode], scenes: Mapping[str, Row], walker: Walker, label: str
) -> list[WorkItem]:
    folder = run.folder
    where = (folder.scenes, folder.rollouts, folder.models)
    return replay.items(episodes, scenes, *where, walker, label)


def _agree(
    ledger: Ledger, rows: Sequence[Row], episodes: Sequence[Episode], items: Sequence[WorkItem]
) -> bool:
    """Return whether rows are walks of `items`, or of further paths walked in the same way."""
    named = {item.name: item for item in items}
    settings = [
        _without_episode({name: part.digest for name, part in parts_of(i.inputs, i.job).items()})
        for i in {e.scene_id: i for e, i in zip(episodes, items, strict=True)}.values()
    ]
    return any(row.item in named for row in rows) and all(
        _is_current(ledger, named[row.item])
        if row.item in named
        else _without_episode(row.parts) in settings
        for row in rows
    )


def _without_episode(parts: Mapping[str, str]) -> dict[str, str]:
    return {name: digest for name, digest in parts.items() if not name.startswith("Episode ")}


def _is_current(ledger: Ledger, item: WorkItem) -> bool:
    """Return whether an earlier run did, or failed at, exactly this item."""
    row = ledger.row(replay.STAGE, item.name)
    broken = row is not None and row.status == "quarantined" and row.key == item.key
    return broken or ledger.is_done(replay.STAGE, item.name, item.key)
