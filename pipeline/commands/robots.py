"""`vlnpe robots`: list robots, render, export and import them, and write cards for deployment."""

from dataclasses import asdict
from pathlib import Path

from ...collectors.robots import ROBOTS, RobotSpec, get_robot
from ...collectors.robots.folder.export import export_robot
from ...collectors.robots.folder.urdf import import_urdf
from ...collectors.robots.registry import FOLDERS
from ...formats.core.errors import FileFormatError, InputError
from ..options.robots import Robots
from ..summary import print_result

Output = tuple[dict[str, object], list[str]]  # values for --json, and lines


def run_robots(options: Robots) -> int:
    """List robots, or render, export or import one; return 2 if a named one is unusable."""
    chosen = (options.view, options.export, options.card, options.import_)
    if sum(option is not None for option in chosen) > 1:
        raise InputError("--view, --export, --card and --import cannot be combined")
    unusable = False
    if options.view is not None:
        facts, lines = _view(get_robot(options.view), options.out or Path())
    elif options.export is not None:
        facts, lines = _export(get_robot(options.export), options.out)
    elif options.card is not None:
        facts, lines = _card(get_robot(options.card), options.out)
    elif options.import_ is not None:
        facts, lines = _import(options.import_, options.out)
    else:
        facts, lines, unusable = _list(options)
    print_result(options, facts, "\n".join(lines))
    return 2 if unusable else 0


def _list(options: Robots) -> tuple[dict[str, object], list[str], bool]:
    # Imported late: loading the physics and rendering modules takes seconds.
    from ..robot_sheet import details, missed_gates, sheet_of, table

    sheets = [sheet_of(get_robot(name)) for name in options.names or (*ROBOTS, *FOLDERS)]
    lines = [table(sheets)]
    lines += ["", *map(details, sheets)] if options.names else missed_gates(sheets)
    unusable = bool(options.names) and any(sheet.problem for sheet in sheets)
    return {"robots": [asdict(sheet) for sheet in sheets]}, lines, unusable


def _view(robot: RobotSpec, out: Path) -> Output:
    from ...rendering.figures.pictures import Picture, save_picture
    from ...rendering.figures.portraits import turntable, walking_strip
    from ...rendering.figures.stroll import stroll
    from ...rendering.figures.studio import make_studio

    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; --out must be a folder")
    studio, written = make_studio(robot), list[str]()

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
    return {"pictures": written, "note": note}, [*written, *([note] if note else [])]


def _export(robot: RobotSpec, out: Path | None) -> Output:
    from ...collectors.locomotion.runtime.policy import policy_files

    out = _new_folder(out, "--export")
    walks = robot.drive is None and bool(robot.joints)
    files = policy_files(robot) if walks else None
    for path in files or ():
        if not path.is_file():
            raise FileFormatError(path, f"{robot.name} has no policy yet; train one first")
    exported = export_robot(robot, out.resolve(), files)
    line = f"{out}: {exported.title} as a folder; use it as --robot {out}"
    return {"robot": exported.name}, [line]


def _card(robot: RobotSpec, out: Path | None) -> Output:
    from ...collectors.locomotion.contract import write_deployment

    if robot.drive is not None or not robot.joints:
        raise InputError(f"{robot.name} does not walk: it has no gait, and no card")
    if out is None:
        raise InputError("--card requires --out, a folder")
    card = write_deployment(robot, out)
    sdk = card["deployment"]["sdk"]
    lines = [f"{out / robot.name}.json: the card; network and a recorded walk lie beside it"]
    if sdk is None:
        lines.append(f"no motor indices of {robot.name} are known; add them to the card")
    else:
        lines.append(f"motors as in {sdk['sdk']}, {sdk['message']}")
        lines += [f"not confirmed: {each}" for each in sdk["unconfirmed"]]
    return card, lines


def _import(urdf: Path, out: Path | None) -> Output:
    out = _new_folder(out, "--import")
    todo, notes = import_urdf(urdf, out.resolve())
    left = f"; to use it, add {'; '.join(todo)}" if todo else f"; use it as --robot {out}"
    facts: dict[str, object] = {"todo": todo, "notes": notes}
    return facts, [*notes, f"{out}: {urdf.name} as a folder{left}"]


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
