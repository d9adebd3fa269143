"""`vlnpe robots`: what robots there are, what they look like, and how to begin one's own."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from ...collectors.robots import ROBOTS, RobotSpec, get_robot
from ...collectors.robots.folder.export import export_robot
from ...formats.core.errors import FileFormatError, InputError


@dataclass(frozen=True)
class Robots:
    """List the robots: mass, height, camera, limits, controllers, and how well their gaits walk.

    Named robots are told of in full. `--view h1` writes a turntable picture and a walking strip,
    `--export aliengo` writes a robot as a folder, a start for your own (docs/robots.md).
    """

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Which robots: names, or folders of your own robots, which are checked."""
    view: str | None = None
    """Write pictures of this robot into --out."""
    export: str | None = None
    """Write this robot as a folder to --out."""
    out: Path | None = None
    """For --view the folder of the pictures (default: here), for --export the robot's folder."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object as the last line."""


@dataclass
class _Done:
    """What was told and written.

    Attributes:
        lines: for people.
        values: for programs.
        problems: a robot that was asked for cannot be used.
    """

    lines: list[str] = field(default_factory=list)
    values: dict[str, object] = field(default_factory=dict)
    problems: bool = False


def run_robots(options: Robots) -> int:
    """List robots, picture one, or export one.

    Raises:
        InputError: an unknown robot, a folder that is none, or an unusable `out`.
    """
    done = _Done()
    if options.view is not None and options.export is not None:
        raise InputError("--view and --export: valid: one of them at a time")
    if options.view is not None:
        _view(get_robot(options.view), options.out or Path(), done)
    elif options.export is not None:
        _export(get_robot(options.export), options.out, done)
    else:
        _list(options, done)
    text = json.dumps(done.values) if options.json else "\n".join(done.lines)
    sys.stdout.write(text + "\n")
    return 2 if done.problems else 0


def _list(options: Robots, done: _Done) -> None:
    # Late, because loading all that robots move and are drawn with takes seconds.
    from ..robot_sheet import details, sheet_of, table

    sheets = [sheet_of(get_robot(name)) for name in options.names or ROBOTS]
    # Who asks for a robot by name wants to know whether it can be used.
    done.problems = bool(options.names) and any(sheet.problem for sheet in sheets)
    done.values["robots"] = [asdict(sheet) for sheet in sheets]
    done.lines.append(table(sheets))
    if options.names:
        done.lines += ["", *(details(sheet) for sheet in sheets)]


def _view(robot: RobotSpec, out: Path, done: _Done) -> None:
    from ...collectors.rendering.people.pictures import Picture, save_picture
    from ...collectors.rendering.people.studio import make_studio, turntable, walking_strip
    from ...collectors.stroll import stroll

    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; --out takes a folder")
    studio, written = make_studio(robot), []

    def save(kind: str, picture: Picture) -> None:
        path = out / f"{robot.name}-{kind}.png"
        save_picture(path, picture)
        written.append(str(path))

    save("turntable", turntable(studio, robot))
    note = ""
    if robot.joints:
        try:
            save("walk", walking_strip(studio, robot, stroll(robot)))
        except FileFormatError as error:
            note = f"no walking strip: {error}"
    else:
        note = f"no walking strip: {robot.name} is placed and cannot walk"
    done.values.update(pictures=written, note=note)
    done.lines += [*written, *([note] if note else [])]


def _export(robot: RobotSpec, out: Path | None, done: _Done) -> None:
    from ...collectors.locomotion.policy import policy_files

    if out is None:
        raise InputError("--export needs --out: the folder, whose name becomes the robot's")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        # A robot there may have been edited by hand; nothing could bring that back.
        raise InputError(f"{out}: exists already; choose another folder, or remove it first")
    name = out.resolve().name
    if name in ROBOTS:
        raise InputError(f"{out}: a robot is named {name} already; choose another folder")
    walks = robot.drive is None and bool(robot.joints)
    files = policy_files(robot) if walks else None
    for path in files or ():
        if not path.is_file():
            raise FileFormatError(path, f"{robot.name} has no policy yet; train one first")
    exported = export_robot(robot, out.resolve(), files)
    done.values.update(out=str(out), robot=exported.name)
    done.lines.append(f"{out}: {exported.title} as a folder; use it as --robot {out}")
