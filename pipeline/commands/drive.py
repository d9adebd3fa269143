"""Command `drive`: a person drives, and the drives become a dataset."""

from collections.abc import Mapping
from pathlib import Path

from ...collectors.controllers import controller_for
from ...collectors.replay.replay import warnings_logged
from ...collectors.replay.suits import check_suits
from ...collectors.robots import RobotSpec
from ...formats.core.errors import InputError
from ...formats.core.rollout import HUMAN
from ...instruction_gen.records import InstructConfig
from ...rendering.camera.extras import Extras
from ...rendering.camera.views import CameraOverrides, View
from ..collect import episode_chain
from ..collect.rollout_chain import Product, export_walks
from ..collect.run import Run
from ..context import open_context
from ..drive.scenes import chosen_scenes, given_episodes
from ..engine.ledger import Row
from ..engine.run_folder import RunFolder
from ..inputs.crews import chosen_robots, keep
from ..inputs.views import chosen_views
from ..options.viewer import Drive
from ..report import items as report
from ..report.gather import robot_rows
from ..stages.rollouts import drive_items
from ..stages.scenes import items as repair
from ..summary import looking_commands, print_stages, robot_table

FRAMES_PER_SECOND = 4


def run(options: Drive) -> int:
    """Let a person drive; then make the dataset of all drives that were kept.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    robots = chosen_robots(options.robot)
    if len(robots) != 1:
        raise InputError(f"--robot {options.robot}: a person drives one robot")
    controller_for(robots[0], drive_items.CONTROLLERS[options.actions])
    overrides = CameraOverrides(height_m=options.camera_height, pitch_down_deg=options.camera_pitch)
    views = chosen_views("ego", options.light, options.renderer, robots[0], overrides)
    if len(views) != 1:
        raise InputError(f"--light {options.light}: a drive has one light")
    from ..drive.session import Session

    with open_context(options.out, options) as context:
        root = context.ledger.root
        robot = keep(robots[0], root)
        current = Run(RunFolder(root), context, options.seed)
        scenes = chosen_scenes(current, options)
        given = given_episodes(options, scenes) if options.episodes else None
        check_suits(robot, given or ())
        session = Session(
            run=current,
            options=options,
            robot=robot,
            view=views[0],
            scenes={name: current.folder.scenes / name for name in scenes},
            episodes=given,
        )
        with warnings_logged():
            if options.finish:
                session.finish()
            else:
                session.live()
        text = "no drive was kept; a drive can be kept once it has ended"
        if drives := drive_items.kept_drives(root):
            page = make_dataset(current, robot, views[0], drives)
            ledger = context.ledger
            text = f"{robot_table(robot_rows(ledger))}\n\n{looking_commands(ledger, page)}"
    left = {str(path): reason for path, reason in session.left.items()}
    return print_stages(options, current.summaries, text, drives=len(drives), left=left)


def make_dataset(run: Run, robot: RobotSpec, view: View, drives: list[drive_items.Driven]) -> Path:
    """Instruct free drives, and render and export the robot's; return the report's page."""
    folder, ledger = run.folder, run.context.ledger
    by_scene: dict[str, list[drive_items.Driven]] = {}
    for drive in drives:
        by_scene.setdefault(drive.episode.scene_id, []).append(drive)
    ledger.select(repair.STAGE, "", by_scene.keys())  # also those of earlier commands
    scenes: Mapping[str, Row] = {row.item: row for row in ledger.done(repair.STAGE)}
    parts = {scene: folder.episodes(f"driven/{scene}") for scene in by_scene}
    items = [
        drive_items.episode_item(scenes[scene], here, parts[scene])
        for scene, here in by_scene.items()
    ]
    driven = run.stage(drive_items.STAGE, items, required=True)
    wording = episode_chain.Wording(InstructConfig(), robot)
    paths = episode_chain.instructed(run, wording, driven, parts)
    where = (folder.scenes, folder.rollouts, folder.models)
    episodes, walks = drive_items.items(drives, paths, scenes, *where, robot)
    product = Product(FRAMES_PER_SECOND, Extras(), False, "h264", "video")
    drivers = sorted({str(d.header["driver"]) for d in drives if d.header["robot"] == robot.name})
    facts = {"robot": robot.name, "controller": HUMAN, "drivers": drivers, "seed": run.seed}
    facts["success_m"] = drive_items.SUCCESS_M
    named = (robot, HUMAN)
    export_walks(run, episodes, walks, scenes, named, views=[view], product=product, facts=facts)
    return report.write(folder, run.context, run.summaries)
