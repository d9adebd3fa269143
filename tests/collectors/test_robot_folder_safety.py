"""A robot's folder reads nothing outside itself, and nobody's machine is filled by one."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from tests.collectors.test_robot_folder import written_rover
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.pipeline.kept_robots import keep

SECRET = "the user's own"


@pytest.fixture
def rover(tmp_path: Path) -> Path:
    """A robot's folder, and a secret beside it."""
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "part.xml").write_text("<mujocoinclude/>")
    trimesh.creation.icosphere(1, radius=0.1).export(tmp_path / "secret" / "hull.stl")
    (tmp_path / "secret" / "key.txt").write_text(SECRET)
    return written_rover(tmp_path / "rover")


def insert(text: str, before: str = "<worldbody>") -> Callable[[Path], None]:
    """Write into model.xml; SECRET_FOLDER stands for the absolute path of the folder beside."""

    def spoil(folder: Path) -> None:
        model = folder / "model.xml"
        given = text.replace("SECRET_FOLDER", str(folder.parent / "secret"))
        model.write_text(model.read_text().replace(before, given + before, 1))

    return spoil


def link(name: str, target: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).symlink_to(folder / target)


def both(*steps: Callable[[Path], None]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        for step in steps:
            step(folder)

    return spoil


def fifo(folder: Path) -> None:
    os.mkfifo(folder / "pipe.stl")


def included(text: str) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        (folder / "part.xml").write_text(f"<mujocoinclude>{text}</mujocoinclude>")
        insert('<include file="part.xml"/>')(folder)

    return spoil


OUT = "leads out of the robot's folder"
GEOM = '<geom size=".01" mass=".001" contype="0" conaffinity="0"/>'
ATTACKS = {
    "include, absolute": (insert('<include file="SECRET_FOLDER/part.xml"/>'), OUT),
    "include, above": (insert('<include file="../secret/part.xml"/>'), OUT),
    "mesh, absolute": (insert('<asset><mesh file="SECRET_FOLDER/hull.stl"/></asset>'), OUT),
    "mesh, above": (insert('<asset><mesh file="../secret/hull.stl"/></asset>'), OUT),
    "meshdir": (
        insert('<compiler meshdir="/"/><asset><mesh file="etc/hull.stl"/></asset>'),
        rf"meshdir='/'.* {OUT}",
    ),
    "texturedir": (insert('<compiler texturedir=".."/>'), OUT),
    "assetdir in an included file": (included('<compiler assetdir="../secret"/>'), OUT),
    "mesh in an included file": (included('<asset><mesh file="../secret/hull.stl"/></asset>'), OUT),
    "hfield": (
        insert('<asset><hfield name="h" file="/etc/passwd" size="1 1 1 1"/></asset>'),
        rf"<hfield file='/etc/passwd'> {OUT}",
    ),
    "texture": (insert('<asset><texture type="2d" name="t" file="/etc/passwd"/></asset>'), OUT),
    "cube texture": (
        insert('<asset><texture type="cube" name="t" fileright="/etc/passwd"/></asset>'),
        OUT,
    ),
    "skin": (insert('<asset><skin name="s" file="/etc/passwd"/></asset>'), OUT),
    "attached model": (insert('<asset><model name="m" file="/etc/passwd"/></asset>'), OUT),
    "backslash": (insert(r'<asset><mesh file="..\secret\hull.stl"/></asset>'), "backslash"),
    "linked mesh": (link("hull.stl", "../secret/hull.stl"), "symbolic link that leads out"),
    "linked text": (link("notes.txt", "../secret/key.txt"), "symbolic link that leads out"),
    "linked facts": (
        both(lambda f: (f / "robot.toml").unlink(), link("robot.toml", "../secret/key.txt")),
        "robot.toml: a symbolic link that leads out",
    ),
    "linked folder": (link("meshes", "../secret"), "symbolic link that leads out"),
    "hidden link": (
        both(
            link(".hidden", "../secret"),
            insert('<asset><mesh file=".hidden/hull.stl"/></asset>'),
        ),
        OUT,
    ),
    "a pipe": (fifo, "neither a file nor a folder"),
    "includes itself": (included('<include file="part.xml"/>'), "includes itself"),
    "entity": (
        lambda f: (f / "model.xml").write_text(
            '<!DOCTYPE m [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + (f / "model.xml").read_text()
        ),
        "document type",
    ),
    "replicate": (
        insert(f'<replicate count="1000000000">{GEOM}</replicate>', "<camera"),
        r"elements, copies included; valid: up to 20,000",
    ),
    "replicate in replicate": (
        insert(
            '<replicate count="400"><replicate count="400">' + GEOM + "</replicate></replicate>",
            "<camera",
        ),
        r"valid: up to 20,000",
    ),
    "texture without end": (
        insert(
            '<asset><texture name="t" type="2d" builtin="flat" width="90000" height="90000"/>'
            "</asset>"
        ),
        "valid: up to 8192",
    ),
    "memory": (insert('<size memory="500G"/>'), "remove <size>"),
    "NaN mass": (insert('<geom size=".1" mass="nan"/>', "<camera"), "<geom mass='nan'> .*finite"),
    "infinite mass": (insert('<geom size=".1" mass="inf"/>', "<camera"), "not finite"),
    "NaN inertia": (
        insert('<inertial pos="0 0 0" mass="1" diaginertia="1 nan 1"/>', "<camera"),
        "<inertial diaginertia='1 nan 1'> .*finite",
    ),
    "NaN place": (insert('<geom size=".1" pos="0 nan 0"/>', "<camera"), "not finite"),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_each_way_out_is_refused_with_file_and_reason(rover: Path, attack: str):
    spoil, reason = ATTACKS[attack]
    spoil(rover)
    with pytest.raises(FileFormatError, match=reason) as raised:
        get_robot(str(rover))
    assert "\n" not in str(raised.value)
    assert str(rover) in str(raised.value)


def test_what_stays_inside_is_read(rover: Path, tmp_path: Path):
    (rover / "assets").mkdir()
    trimesh.creation.icosphere(1, radius=0.1).export(rover / "assets" / "hull.stl")
    (rover / "assets" / "again.stl").symlink_to("hull.stl")
    included('<asset><mesh name="two" file="again.stl"/></asset>')(rover)
    insert('<compiler meshdir="assets"/><asset><mesh name="one" file="hull.stl"/></asset>')(rover)
    seen = 'contype="0" conaffinity="0" mass="0" type="mesh"'
    insert(f'<geom {seen} mesh="one"/><geom {seen} mesh="two"/>', "<camera")(rover)
    insert(f'<replicate count="20" offset=".01 0 0">{GEOM}</replicate>', "<camera")(rover)
    insert('<site name="inf"/>', "<camera")(rover)
    robot = get_robot(str(rover))
    assert robot.build_model().ngeom == 1 + 5 + 2 + 20  # the floor beneath it
    copy = Path(keep(robot, tmp_path / "run"))
    assert get_robot(str(copy)).content_sha256 == robot.content_sha256
    assert not any(path.is_symlink() for path in copy.rglob("*"))


def test_a_link_to_the_folder_itself_is_fine(rover: Path, tmp_path: Path):
    (tmp_path / "linked").symlink_to(rover)
    assert get_robot(str(tmp_path / "linked")).name == "rover"
