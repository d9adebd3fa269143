"""`vlnpe robots`: list robots, render them, export one as a template, and import a URDF."""

import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ...collectors.robots import ROBOTS, RobotSpec, get_robot
from ...collectors.robots.folder.export import export_robot
from ...collectors.robots.folder.urdf import import_urdf
from ...formats.core.errors import FileFormatError, InputError
from ..options.robots import Robots


@dataclass
class _Done:
    """Output of the command.

    Attributes:
        lines: Human-readable output.
        values: Output of `--json`.
        problems: Whether a requested robot cannot be used.
    """

    lines: list[str] = field(default_factory=list)
    values: dict[str, object] = field(default_factory=dict)
    problems: bool = False


def run_robots(options: Robots) -> int:
    """List robots, render one, export one, or import one.

    Raises:
        InputError: If a robot is unknown, a folder is not a robot, or `out` cannot be used.
    """
    done = _Done()
    if sum(o is not None for o in (options.view, options.export, options.import_)) > 1:
        raise InputError("--view, --export and --import cannot be combined")
    if options.view is not None:
        _view(get_robot(options.view), options.out or Path(), done)
    elif options.export is not None:
        _export(get_robot(options.export), options.out, done)
    elif options.import_ is not None:
        _import(options.import_, options.out, done)
    else:
        _list(options, done)
    text = json.dumps(done.values) if options.json else "\n".join(done.lines)
    sys.stdout.write(text + "\n")
    return 2 if done.problems else 0


def _list(options: Robots, done: _Done) -> None:
    # Imported late: loading the physics and rendering modules takes seconds.
    from ..robot_sheet import details, missed_gates, sheet_of, table

    sheets = [sheet_of(get_robot(name)) for name in options.names or ROBOTS]
    # A robot requested by name that cannot be used is an error.
    done.problems = bool(options.names) and any(sheet.problem for sheet in sheets)
    done.values["robots"] = [asdict(sheet) for sheet in sheets]
    done.lines += [table(sheets), *([] if options.names else missed_gates(sheets))]
    if options.names:
        done.lines += ["", *(details(sheet) for sheet in sheets)]


def _view(robot: RobotSpec, out: Path, done: _Done) -> None:
    from ...rendering.figures.pictures import Picture, save_picture
    from ...rendering.figures.portraits import turntable, walking_strip
    from ...rendering.figures.stroll import stroll
    from ...rendering.figures.studio import make_studio

    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; --out must be a folder")
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
        note = f"no walking strip: {robot.name} has no joints and cannot walk"
    done.values.update(pictures=written, note=note)
    done.lines += [*written, *([note] if note else [])]


def _export(robot: RobotSpec, out: Path | None, done: _Done) -> None:
    from ...collectors.locomotion.runtime.policy import policy_files

    out = _new_folder(out, "--export")
    walks = robot.drive is None and bool(robot.joints)
    files = policy_files(robot) if walks else None
    for path in files or ():
        if not path.is_file():
            raise FileFormatError(path, f"{robot.name} has no policy yet; train one first")
    exported = export_robot(robot, out.resolve(), files)
    done.values.update(out=str(out), robot=exported.name)
    done.lines.append(f"{out}: {exported.title} as a folder; use it as --robot {out}")


def _import(urdf: Path, out: Path | None, done: _Done) -> None:
    out = _new_folder(out, "--import")
    todo, notes = import_urdf(urdf, out.resolve())
    done.values.update(out=str(out), todo=todo, notes=notes)
    left = f"; to use it, add {'; '.join(todo)}" if todo else f"; use it as --robot {out}"
    done.lines += [*notes, f"{out}: {urdf.name} as a folder{left}"]


def _new_folder(out: Path | None, option: str) -> Path:
    """Return the folder to write a robot to; raise InputError if there is none or it is used."""
    if out is None:
        raise InputError(f"{option} requires --out, a folder whose name becomes the robot's name")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        # An existing robot may have been edited by hand, so never overwrite it.
        raise InputError(f"{out}: already exists; choose another folder or remove it first")
    name = out.resolve().name
    if name in ROBOTS:
        raise InputError(f"{out}: {name} is a built-in robot; choose another folder name")
    return out
