"""A robot's folder reads nothing outside itself and cannot exhaust memory or disk."""

import json
import os
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from tests.security.hostile import not_files, put, refusal
from tests.support.robot_folders import edit, written_rover
from vlnpe.collectors.locomotion.runtime.card import load_card
from vlnpe.collectors.locomotion.runtime.onnx_runtime import OnnxNetwork
from vlnpe.collectors.locomotion.runtime.policy import policy_files
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.pipeline.inputs.crews import keep

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
    "a URDF": (
        lambda f: (f / "model.xml").write_text(
            '<robot name="go2"><mujoco><compiler meshdir="../m"/></mujoco></robot>'
        ),
        "is a URDF; valid: MJCF.*--import robot.urdf",
    ),
    "an SDF": (lambda f: (f / "model.xml").write_text("<sdf/>"), "begins with 'sdf'; valid: MJCF"),
    "NaN mass": (insert('<geom size=".1" mass="nan"/>', "<camera"), "<geom mass='nan'> .*finite"),
    "infinite mass": (insert('<geom size=".1" mass="inf"/>', "<camera"), "not finite"),
    "NaN inertia": (
        insert('<inertial pos="0 0 0" mass="1" diaginertia="1 nan 1"/>', "<camera"),
        "<inertial diaginertia='1 nan 1'> .*finite",
    ),
    "NaN place": (insert('<geom size=".1" pos="0 nan 0"/>', "<camera"), "not finite"),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_each_path_out_of_the_folder_is_refused_with_file_and_reason(rover: Path, attack: str):
    spoil, reason = ATTACKS[attack]
    spoil(rover)
    with pytest.raises(FileFormatError, match=reason) as raised:
        get_robot(str(rover))
    assert "\n" not in str(raised.value)
    assert str(rover) in str(raised.value)


def test_files_inside_the_folder_are_read(rover: Path, tmp_path: Path):
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
    copy = keep(robot, tmp_path / "run").folder
    assert copy is not None
    assert get_robot(str(copy)).content_sha256 == robot.content_sha256
    assert not any(path.is_symlink() for path in copy.rglob("*"))


def test_a_link_to_the_folder_itself_is_fine(rover: Path, tmp_path: Path):
    (tmp_path / "linked").symlink_to(rover)
    assert get_robot(str(tmp_path / "linked")).name == "rover"


def chained(folder: Path) -> None:
    """Twenty files, each of which includes the next one twice: a million elements."""
    for k in range(20):
        twice = f'<include file="part{k + 1}.xml"/>' * 2 if k < 19 else GEOM
        (folder / f"part{k}.xml").write_text(f"<mujocoinclude>{twice}</mujocoinclude>")
    insert('<include file="part0.xml"/>', "<camera")(folder)


def long_chain(folder: Path) -> None:
    for k in range(3000):
        part = f'<mujocoinclude><include file="part{k + 1}.xml"/></mujocoinclude>'
        (folder / f"part{k}.xml").write_text(part)
    insert('<include file="part0.xml"/>', "<camera")(folder)


def png_bomb(folder: Path) -> None:
    """The header of a PNG of 1 TB; a decoder would believe it."""
    head = struct.pack(">IIBBBBB", 1 << 20, 1 << 20, 8, 2, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + b"IHDR" + head
    (folder / "big.png").write_bytes(start + struct.pack(">I", zlib.crc32(b"IHDR" + head)))
    insert('<asset><texture type="2d" name="t" file="big.png"/></asset>')(folder)


def huge(folder: Path) -> None:
    with (folder / "hull.stl").open("wb") as stream:
        stream.truncate(1 << 40)


def facts(text: str) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        path = folder / "robot.toml"
        path.write_text(text + path.read_text())

    return spoil


BOMBS = {
    "includes that double": (chained, "elements, copies included"),
    "a long chain of includes": (long_chain, "nested more"),
    "deep elements": (insert("<body>" * 50_000 + "</body>" * 50_000, "<camera"), "nested more"),
    "PNG": (png_bomb, "1048576 × 1048576 pixels"),
    "a file of a terabyte": (huge, "too large"),
    "nested TOML": (facts("x = " + "[" * 100_000 + "\n"), "nested too deeply|not valid TOML"),
    "dotted TOML": (facts(".".join("x" * 3000) + " = 1\n"), "nested too deeply"),
    "an enormous key": (facts("x" * 500_000 + " = 1\n"), "is unknown"),
    "an enormous value": (
        edit("robot.toml", "footprint_radius_m =", f"footprint_radius_m = [{'1,' * 99_999}] #"),
        "footprint_radius_m is",
    ),
    "robot.toml of megabytes": (facts("#" * (1 << 20) + "\n"), "too large"),
    "an endless number": (facts("x = " + "9" * 5000 + "\n"), "not valid TOML"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_before_they_cost_anything(rover: Path, name: str) -> None:
    spoil, reason = BOMBS[name]
    spoil(rover)
    assert re.search(reason, refusal(lambda: get_robot(str(rover))).reason)


@not_files
@pytest.mark.parametrize("name", ["robot.toml", "model.xml", "hull.stl"])
def test_only_regular_files_are_read(rover: Path, name: str, kind: str) -> None:
    if (rover / name).exists():
        (rover / name).unlink()
    put(kind, rover / name)
    if (name, kind) != ("hull.stl", "a folder"):
        refusal(lambda: get_robot(str(rover)))


def test_too_many_files_are_refused(rover: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VLNPE_LIMITS", "robot_files=5")
    for k in range(5):
        (rover / f"{k}.txt").write_text("")
    assert "more than 5 files" in refusal(lambda: get_robot(str(rover))).reason


# The policy of a robot that walks: a network and its card. ONNX is Protobuf, written by hand here.


type Ports = tuple[tuple[int, bytes], ...]


def message(*parts: tuple[int, bytes | int | float]) -> bytes:
    """Return a Protobuf message of (field number, value)."""
    out = b""
    for number, value in parts:
        if isinstance(value, float):
            out += bytes([number << 3 | 5]) + struct.pack("<f", value)
        elif isinstance(value, int):
            out += bytes([number << 3]) + varint(value)
        else:
            out += bytes([number << 3 | 2]) + varint(len(value)) + value
    return out


def varint(value: int) -> bytes:
    out = b""
    while value >= 128:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def tensor(name: bytes, dims: tuple[int, ...], data: bytes, *more: tuple[int, int]) -> bytes:
    return message(*((1, d) for d in dims), (2, 1), (8, name), (9, data), *more)


def port(name: bytes, width: int) -> bytes:
    shape = message((1, message((2, b"batch"))), (1, message((1, width))))
    return message((1, name), (2, message((1, message((1, 1), (2, shape))))))


INPUT, OUTPUT = (11, port(b"observation", 4)), (12, port(b"action", 2))


def network(*, weights: bytes, node: bytes = b"", ports: Ports = (INPUT, OUTPUT)) -> bytes:
    node = node or message((1, b"observation"), (1, b"w"), (2, b"action"), (4, b"MatMul"))
    graph = message((1, node), (5, weights), *ports)
    return message((1, 8), (7, graph), (8, message((2, 17))))


EXTERNAL = (14, 1)
ONES = struct.pack("<8f", *range(8))
INNER = message((5, tensor(b"w", (1,), b"", EXTERNAL)), (1, message((4, b"Relu"))))
NETWORKS = {
    "external weights": (network(weights=tensor(b"w", (4, 2), b"", EXTERNAL)), "another file"),
    "external weights of a constant": (
        network(
            weights=tensor(b"w", (4, 2), ONES),
            node=message(
                (2, b"c"),
                (4, b"Constant"),
                (5, message((1, b"value"), (5, tensor(b"c", (1,), b"", EXTERNAL)))),
            ),
        ),
        "another file",
    ),
    "external weights in a branch": (
        network(
            weights=tensor(b"w", (4, 2), ONES),
            node=message(
                (1, b"observation"),
                (2, b"action"),
                (4, b"If"),
                (5, message((1, b"then"), (6, INNER))),
            ),
        ),
        "another file",
    ),
    "a loop": (
        network(weights=b"", node=message((1, b"observation"), (2, b"action"), (4, b"Loop"))),
        "Loop is not supported",
    ),
    "counts that lie": (network(weights=tensor(b"w", (1 << 40, 1 << 40), ONES)), "are damaged"),
    "a negative size": (
        network(weights=tensor(b"w", (2**64 - 4, 2**64 - 2), ONES)),
        "are damaged",
    ),
    "a size without end and none": (
        network(weights=tensor(b"w", (0, 1 << 62), b"")),
        "are damaged",
    ),
    "a name on two lines": (
        network(weights=b"", ports=((11, port(b"a\nb", 1 << 40)), OUTPUT)),
        "cannot read it",
    ),
    "an operator on two lines": (
        network(weights=b"", node=message((1, b"observation"), (2, b"action"), (4, b"M\nx"))),
        "cannot read it",
    ),
    "NaN": (
        network(weights=tensor(b"w", (4, 2), struct.pack("<8f", *[float("nan")] * 8))),
        "finite",
    ),
    "a NaN factor": (
        network(
            weights=tensor(b"w", (4, 2), ONES),
            node=message(
                (1, b"observation"),
                (1, b"w"),
                (2, b"action"),
                (4, b"Gemm"),
                (5, message((1, b"alpha"), (2, float("nan")))),
            ),
        ),
        "'alpha' is nan",
    ),
    "a layer without end": (
        network(weights=tensor(b"w", (4, 9000), bytes(16 * 9000))),
        "its output is",
    ),
    "no input": (network(weights=tensor(b"w", (4, 2), ONES), ports=(OUTPUT,)), "cannot read it"),
    "no output": (network(weights=tensor(b"w", (4, 2), ONES), ports=(INPUT,)), "its output is"),
    "an input without end": (
        network(weights=b"", ports=((11, port(b"observation", 1 << 40)), OUTPUT)),
        "cannot read it",
    ),
    "a layer without weights": (
        network(weights=b"", node=message((1, b"observation"), (2, b"action"), (4, b"Gemm"))),
        "cannot read it",
    ),
    "a cut": (network(weights=tensor(b"w", (4, 2), ONES))[:-5], "ONNX"),
    "nothing": (b"", "ONNX"),
    "no Protobuf": (b"\xff" * 100, "ONNX"),
    "deep": (b"\x3a\x7f" * 50_000, "ONNX"),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_hostile_networks_are_refused(name: str) -> None:
    content, reason = NETWORKS[name]
    assert reason in refusal(lambda: OnnxNetwork(Path("policy.onnx"), content)).reason


def test_the_network_written_by_hand_is_sound() -> None:
    content = network(weights=tensor(b"w", (4, 2), ONES))
    assert OnnxNetwork(Path("policy.onnx"), content).outputs == 2


CARD = json.loads(policy_files(get_robot("aliengo"))[1].read_text())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 100_000, "nested"),
        ("[]", "object"),
        ("{}", "not a policy card"),
        (json.dumps({**CARD, "training": json.loads("[" * 300 + "]" * 300)}), "nested"),
        (json.dumps({**CARD, "kp": [float("nan")] * 12}), "kp is nan"),
        (json.dumps({**CARD, "action_clip": float("inf")}), "action_clip is inf"),
        (
            json.dumps({**CARD, "gait": {**CARD["gait"], "frequency_hz": float("nan")}}),
            "frequency_hz",
        ),
        (json.dumps({**CARD, "gait": {"x" * 10_000: 1}}), "not a policy card"),
        (json.dumps({**CARD, "gait": 5}), "not a policy card"),
        (json.dumps({**CARD, "observation": "x" * 10_000}), "not a policy card"),
    ],
)
def test_hostile_cards_are_refused(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "policy.json"
    path.write_text(text)
    assert reason in refusal(lambda: load_card(path)).reason
