"""MCAP ↔ LeRobot v3: nothing is lost on the way, and damage is named."""

import contextlib
import dataclasses
import json
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.mcap.test_episode import decode, small_links, small_map, write_frame_folder
from tests.formats.mcap.test_rollout import assert_same
from tests.support.lerobot_data import write_unit, write_units
from tests.support.mcap_copies import rewritten
from tests.support.rollouts import make_rollout
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.convert.episodes import (
    dataset_from_units,
    joint_facts,
    mcap_from_unit,
    unit_from_dataset,
    unit_from_mcap,
)
from vlnpe.formats.convert.facts import DatasetFacts
from vlnpe.formats.convert.frame_rollout import frame_rollout
from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import FileLimits, assemble_dataset, read_episode_unit
from vlnpe.formats.lerobot.units.rows import row_arrays
from vlnpe.formats.mcap.depth_images import decode_depth, depth_encoding, encode_depth
from vlnpe.formats.mcap.episode import extract_contents, write_episode_mcap
from vlnpe.formats.mcap.recording import open_recording, read_recording
from vlnpe.formats.mcap.robot_links import robot_topics
from vlnpe.formats.mcap.rollout import read_rollout, write_rollout
from vlnpe.formats.mcap.shown import map_topic
from vlnpe.formats.video.depth_codes import MAX_CODE
from vlnpe.formats.video.id_video import IdVideoWriter, read_id_video
from vlnpe.formats.video.mp4 import read_depth_video
from vlnpe.formats.video.mux import iterate_bitstream
from vlnpe.pipeline import cli
from vlnpe.pipeline.engine.ledger import Ledger

LAYOUT = Path(__file__).resolve().parents[3] / "docs" / "reference" / "foxglove_layout.json"
SECONDS = (2.0, 0.0, 3.0)
SHOWN = (map_topic((0.0, small_map())), *robot_topics(small_links(make_rollout(1.0))))
ASSEMBLY: dict[str, Any] = {
    "provenance": {"config": "abc", "scenes": {"two_rooms": {"licence": "MIT"}}},
    "licence": "mit",
    "title": "Two rooms",
    "limits": FileLimits(files_per_chunk=2, data_mb=0.001, video_mb=0.02),
}


def files(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()
    }


def export_mcap(root: Path, rollout: Rollout, name: str = "a", rate: int = 4) -> Path:
    frames = root / f"frames-{name}"
    write_frame_folder(frames, rollout, rate)
    path = root / "mcap" / f"{name}.mcap"
    write_episode_mcap(path, rollout, frames, shown=SHOWN)
    return path


@pytest.mark.parametrize(
    ("storage", "codec", "rate"), [("video", "h264", 4), ("image", "h264", 4), ("video", "av1", 10)]
)
def test_a_dataset_comes_back_from_mcap_byte_for_byte(
    tmp_path: Path, storage: str, codec: str, rate: int
) -> None:
    made = write_units(tmp_path, SECONDS, rate, storage, codec)
    assemble_dataset(made, tmp_path / "set", **ASSEMBLY)
    opened = open_dataset(tmp_path / "set")
    units = []
    for number in opened.episodes:
        folder = tmp_path / f"there-{number}"
        unit_from_dataset(tmp_path / "set", number, folder)
        mcap_from_unit(folder, tmp_path / f"{number}.mcap")
        unit_from_mcap(tmp_path / f"{number}.mcap", tmp_path / f"back-{number}")
        units.append(tmp_path / f"back-{number}")
    facts = joint_facts(units, "unused", "unused", None)
    assert facts == opened.facts and facts.limits == ASSEMBLY["limits"]
    dataset_from_units(units, tmp_path / "again", facts)
    before, after = files(tmp_path / "set"), files(tmp_path / "again")
    assert before.keys() == after.keys()
    if codec == "av1":  # its header is written again, from the packets
        for key in [k for k in before if k.startswith("videos/observation.images.rgb")]:
            (tmp_path / "x.mp4").write_bytes(before.pop(key))
            (tmp_path / "y.mp4").write_bytes(after.pop(key))
            streams = [list(iterate_bitstream(tmp_path / f"{name}.mp4")) for name in "xy"]
            assert streams[0] == streams[1]
    assert [key for key in before if before[key] != after[key]] == []


@pytest.mark.parametrize(("rate", "discrete"), [(4, True), (10, False), (25, True)])
def test_an_episode_comes_back_from_a_dataset_message_for_message(
    tmp_path: Path, rate: int, discrete: bool
) -> None:
    rollout = make_rollout(2.0, 3, discrete=discrete, fall=True)
    path = export_mcap(tmp_path, rollout, rate=rate)
    unit_from_mcap(path, tmp_path / "unit")
    facts = joint_facts([tmp_path / "unit"], "Converted", "mit", {"from": "mcap"})
    assert facts.provenance == {"converted": {"from": "mcap"}}
    dataset_from_units([tmp_path / "unit"], tmp_path / "set", facts)
    unit_from_dataset(tmp_path / "set", 0, tmp_path / "back")
    mcap_from_unit(tmp_path / "back", tmp_path / "b.mcap")
    one, two = read_recording(path), read_recording(tmp_path / "b.mcap")
    assert one.messages.keys() == two.messages.keys()
    for topic, messages in one.messages.items():
        pairs = zip(messages, two.messages[topic], strict=True)
        assert all((a.log_time, a.data) == (b.log_time, b.data) for a, b in pairs), topic
    assert two.metadata == one.metadata | {"vlnpe.dataset": two.metadata["vlnpe.dataset"]}
    assert {k: a.data for k, a in one.attachments.items()} == {
        k: a.data for k, a in two.attachments.items()
    }
    assert_same(rollout, read_rollout(tmp_path / "b.mcap"))


def test_labels_are_converted_too(tmp_path: Path) -> None:
    rollout, frames = make_rollout(2.0), tmp_path / "frames-a"
    write_frame_folder(frames, rollout)
    ids = np.random.default_rng(0).integers(0, 65_536, (9, 64, 96))
    with IdVideoWriter(frames / "semantic.mov", 4) as writer:
        for image in ids:
            writer.write(image)
    (frames / "labels.json").write_text('{"semantic": {"2": "table"}}')
    meta = json.loads((frames / "meta.json").read_text())
    meta["semantic"] = {"file": "semantic.mov", "codec": "png"}
    (frames / "meta.json").write_text(json.dumps(meta))
    write_episode_mcap(tmp_path / "a.mcap", rollout, frames)
    for k, (_, message) in enumerate(decode(tmp_path / "a.mcap")["/camera/semantic"]):
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(image, ids[k])
    unit_from_mcap(tmp_path / "a.mcap", tmp_path / "unit")
    dataset_from_units([tmp_path / "unit"], tmp_path / "set", DatasetFacts("a", "mit", {}))
    unit_from_dataset(tmp_path / "set", 0, tmp_path / "back")
    mcap_from_unit(tmp_path / "back", tmp_path / "b.mcap")
    seen = extract_contents(
        read_recording(tmp_path / "b.mcap"), tmp_path / "b.mcap", tmp_path / "there"
    )
    np.testing.assert_array_equal(read_id_video(tmp_path / "there" / "semantic.mov"), ids)
    assert seen.frames.facts == meta
    assert (tmp_path / "there/labels.json").read_text() == (frames / "labels.json").read_text()
    (frames / "semantic.mov").unlink()
    with pytest.raises(FileFormatError, match=r"semantic\.mov"):
        write_episode_mcap(tmp_path / "c.mcap", rollout, frames)


def test_the_unit_of_an_mcap_file_is_the_exporters(tmp_path: Path) -> None:
    rollout = make_rollout(2.0, 1, discrete=True)
    made = write_unit(tmp_path, rollout, 0, counted=False)
    unit_from_mcap(export_mcap(tmp_path, rollout), tmp_path / "unit")
    one, two = json.loads((made / "unit.json").read_text()), (tmp_path / "unit" / "unit.json")
    assert one == json.loads(two.read_text())
    assert (made / "rows.parquet").read_bytes() == (tmp_path / "unit/rows.parquet").read_bytes()


def test_mcap_of_a_dataset_shows_what_the_rows_say(tmp_path: Path) -> None:
    rollout = make_rollout(2.0, 1, discrete=True)
    folder = write_unit(tmp_path, rollout, 1)
    mcap_from_unit(folder, tmp_path / "a.mcap")
    topics = decode(tmp_path / "a.mcap")
    rows = read_episode_unit(folder).rows()
    samples = rollout.frame_samples(4)
    for key in rows.schema.names:
        stored = [list(getattr(m, key.replace(".", "_"))) for _, m in topics["/dataset/frame"]]
        np.testing.assert_array_equal(
            np.ravel(stored), np.ravel(rows[key].to_pylist()), err_msg=key
        )
    for k, (at, message) in enumerate(topics["/tf"]):
        assert at == k * 250_000_000
        seen = message.transforms[0].translation
        truth = rollout.position_world_m[samples[k]]
        np.testing.assert_allclose([seen.x, seen.y, seen.z], truth, atol=1e-5)
    names = [joint.name for joint in topics["/joint_states"][0][1].joints]
    assert tuple(names) == rollout.joint_names
    assert [m["name"] for _, m in topics["/action"]][:3] == ["FORWARD", "LEFT", "RIGHT"]
    assert topics["/foot_contact"][3][1] == dict(
        zip(rollout.foot_names, rollout.foot_contact[samples[3]].tolist(), strict=True)
    )
    assert topics["/events"][-1][1].message == "end: success"
    shown = set(re.findall(r'"(/[a-z_/]+)', LAYOUT.read_text()))
    assert "/camera/rgb" in shown and shown - {"/map", "/robot"} <= topics.keys()


def test_the_floor_of_a_dataset_follows_the_stairs(tmp_path: Path) -> None:
    rollout = make_rollout(2.0, 1, discrete=True)
    position, count = rollout.position_world_m.copy(), len(rollout.position_world_m)
    position[:, 2] = rollout.floor_z_m[0] + 0.36 + np.linspace(0.0, 2.8, count)
    over = dataclasses.replace(
        rollout.episode, extra={**rollout.episode.extra, "staircases": [0], "levels": [0, 1]}
    )
    assert rollout.episode.level == 0
    rollout = dataclasses.replace(rollout, position_world_m=position, episode=over)
    unit = read_episode_unit(write_unit(tmp_path, rollout, 1))
    shown = frame_rollout(unit, row_arrays(unit.rows()))
    samples = rollout.frame_samples(4)
    np.testing.assert_allclose(shown.floor_z_m, position[samples, 2] - 0.36, atol=1e-5)


@pytest.mark.parametrize("far_m", [2.0, 5.0, 7.5, 8.0, 10.0, 20.0, 60.0])
def test_every_depth_code_comes_back(far_m: float) -> None:
    limits, codes = DepthRange(0.05, far_m), np.arange(MAX_CODE + 1, dtype=np.uint16)
    encoding, size = depth_encoding(limits)
    data = encode_depth(codes, limits)
    assert len(data) == size * len(codes)
    assert encoding == ("16UC1" if far_m >= 8 else "32FC1")
    np.testing.assert_array_equal(decode_depth(data, encoding, limits), codes)
    with pytest.raises(ValueError, match=r"that a video of 0 to .* m cannot hold"):
        decode_depth(np.full(4, 65_535, "<u2").tobytes(), "16UC1", limits)


def test_extracted_frames_are_those_that_went_in(tmp_path: Path) -> None:
    path = export_mcap(tmp_path, make_rollout(2.0))
    seen = extract_contents(read_recording(path), path, tmp_path / "frames")
    before = tmp_path / "frames-a"
    assert list(iterate_bitstream(before / "rgb.mp4")) == list(
        iterate_bitstream(seen.frames.rgb_video)
    )
    assert (before / "depth.mp4").read_bytes() == seen.frames.depth_video.read_bytes()
    limits = seen.frames.depth_range
    assert read_depth_video(seen.frames.depth_video, limits).shape == (9, 64, 96)
    assert json.loads((before / "meta.json").read_text()) == seen.frames.facts
    assert seen.shown == SHOWN


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        ("truncated", "truncated"),
        ("no colour", r"topic /camera/rgb: missing"),
        ("short depth", r"topic /camera/depth: 5 of 9 messages"),
        ("half a state", "state messages are missing"),
        ("a rollout", "a rollout without pictures"),
        ("another's", "no episode"),
        ("no frames", r"frames\.npz is missing"),
    ],
)
def test_bad_mcap_files_are_named(tmp_path: Path, damage: str, reason: str) -> None:
    rollout = make_rollout(2.0)
    good, path = export_mcap(tmp_path, rollout), tmp_path / "bad.mcap"
    match damage:
        case "truncated":
            path.write_bytes(good.read_bytes()[:-2000])
        case "no colour":
            rewritten(good, path, kept={"/camera/rgb": 0})
        case "short depth":
            rewritten(good, path, kept={"/camera/depth": 5})
        case "half a state":
            rewritten(good, path, kept={"/state": 100})
        case "a rollout":
            write_rollout(path, rollout)
        case "another's":
            with open_recording(path) as recording:
                recording.writer.write_metadata("other", {"a": "b"})
        case "no frames":
            rewritten(good, path, attachment=lambda name, data: None)
    with pytest.raises(FileFormatError, match=reason) as raised:
        unit_from_mcap(path, tmp_path / "out" / "unit")
    assert raised.value.path == path
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        ("no info", "not a LeRobot dataset"),
        ("v2.1", r"LeRobot v2\.1; valid: LeRobot v3\.0"),
        ("fewer episodes", "3 episodes listed"),
        ("cut video", "rgb"),
        ("cut rows", "rows"),
        ("no columns", "lacks vlnpe.s episode columns .episode_uid"),
    ],
)
def test_bad_datasets_are_named(tmp_path: Path, damage: str, reason: str) -> None:
    assemble_dataset(write_units(tmp_path, SECONDS), tmp_path / "set", **ASSEMBLY)
    root = tmp_path / "set"
    info = root / "meta" / "info.json"
    data = next((root / "data").rglob("*.parquet"))
    match damage:
        case "no info":
            info.unlink()
        case "v2.1":
            info.write_text(json.dumps(json.loads(info.read_text()) | {"codebase_version": "v2.1"}))
        case "fewer episodes":
            info.write_text(json.dumps(json.loads(info.read_text()) | {"total_episodes": 7}))
        case "cut video":
            video = next((root / "videos" / "observation.images.rgb").rglob("*.mp4"))
            video.write_bytes(video.read_bytes()[:200])
        case "cut rows":
            table = pq.read_table(data)
            pq.write_table(table.slice(0, table.num_rows - 2), data)
        case "no columns":
            episodes = next((root / "meta" / "episodes").rglob("*.parquet"))
            pq.write_table(pq.read_table(episodes).drop_columns(["episode_uid"]), episodes)
    with pytest.raises(FileFormatError, match=reason):
        for number in open_dataset(root).episodes:
            unit_from_dataset(root, number, tmp_path / f"out-{number}")


def test_a_card_that_is_no_text_only_loses_the_title(tmp_path: Path) -> None:
    assemble_dataset(write_units(tmp_path, (0.0,)), tmp_path / "set", **ASSEMBLY)
    card = tmp_path / "set" / "README.md"
    card.write_bytes(card.read_bytes().replace(b"pretty_name", b"\xffretty_name"))
    assert open_dataset(tmp_path / "set").facts.title == "set"


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_damage_to_a_dataset_is_named_or_harmless(
    small: Path, tmp_path: Path, data: st.DataObject
) -> None:
    root = tmp_path / "damaged"
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(small, root)
    path = data.draw(st.sampled_from(sorted(p for p in root.rglob("*") if p.is_file())))
    content = bytearray(path.read_bytes())
    place = data.draw(st.one_of(st.integers(0, 200), st.integers(0, len(content) - 1)))
    content[min(place, len(content) - 1)] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(FileFormatError):
        unit_from_dataset(root, open_dataset(root).episodes[0], tmp_path / "u")
        mcap_from_unit(tmp_path / "u", tmp_path / "a.mcap")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("small")
    assemble_dataset(write_units(root, (0.5,)), root / "set", **ASSEMBLY)
    return root / "set"


def test_a_rollout_of_another_episode_is_refused(tmp_path: Path) -> None:
    for number in (0, 1):
        path = export_mcap(tmp_path, make_rollout(2.0, number), str(number))
        unit_from_mcap(path, tmp_path / f"unit-{number}")
    (tmp_path / "unit-1" / "rollout.mcap").replace(tmp_path / "unit-0" / "rollout.mcap")
    with pytest.raises(FileFormatError, match="differs from the rows of unit-0"):
        mcap_from_unit(tmp_path / "unit-0", tmp_path / "a.mcap")


def test_units_of_several_datasets_say_where_they_are_from(tmp_path: Path) -> None:
    units = write_units(tmp_path, (0.0, 0.0))
    for name, unit in zip(("a", "b"), units, strict=True):
        facts = DatasetFacts(name, "mit", {"made": name})
        (unit / "dataset.json").write_text(json.dumps(facts.to_json()))
    facts = joint_facts(units, "Both", "unknown", "note")
    assert (facts.title, facts.licence) == ("Both", "mit")
    assert facts.provenance == {"converted": "note", "sources": [{"made": "a"}, {"made": "b"}]}


def test_published_splits_and_rollouts_survive(tmp_path: Path) -> None:
    unit_from_mcap(export_mcap(tmp_path, make_rollout(1.0)), tmp_path / "unit")
    facts = DatasetFacts("Set", "mit", {"held_out_scenes": ["two_rooms"]})
    dataset_from_units([tmp_path / "unit"], tmp_path / "set", facts)
    assert json.loads((tmp_path / "set/meta/splits.json").read_text()) == {"val": [0]}
    unit_from_dataset(tmp_path / "set", 0, tmp_path / "there")
    mcap_from_unit(tmp_path / "there", tmp_path / "a.mcap")
    unit_from_mcap(tmp_path / "a.mcap", tmp_path / "back")
    joint = joint_facts([tmp_path / "back"], "unused", "unused", None)
    dataset_from_units([tmp_path / "back"], tmp_path / "again", joint)
    before, after = files(tmp_path / "set"), files(tmp_path / "again")
    assert before.keys() == after.keys()
    kept = "rollouts/episode_000000.mcap"  # the same messages, but a summary in random order
    assert [k for k in before if before[k] != after[k] and k != kept] == []
    assert_same(read_rollout(tmp_path / "set" / kept), read_rollout(tmp_path / "again" / kept))


def test_units_of_one_dataset_bring_their_scenes_together(tmp_path: Path) -> None:
    units = write_units(tmp_path, (0.0, 0.0))
    for name, unit in zip(("a", "b"), units, strict=True):
        facts = DatasetFacts("Set", f"licence-{name}", {"v": 1, "scenes": {name: {"x": name}}})
        (unit / "dataset.json").write_text(json.dumps(facts.to_json()))
    joint = joint_facts(units, "unused", "unused", "note")
    assert joint.provenance == {"v": 1, "scenes": {"a": {"x": "a"}, "b": {"x": "b"}}}
    assert (joint.title, joint.licence) == ("Set", "other")


def test_the_command_goes_there_and_back(
    tmp_path: Path, inline: None, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in (0, 1):
        export_mcap(tmp_path, make_rollout(1.0, number), f"ep-{number}")
    there, back = tmp_path / "there", tmp_path / "back"
    call = ["convert", str(tmp_path / "mcap"), "--to", "lerobot", "--out", str(there)]
    assert cli.main([*call, "--licence", "mit", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["written"] == [str(there / "lerobot" / "mcap")]
    assert open_dataset(there / "lerobot" / "mcap").facts.licence == "mit"
    # Again: nothing is done twice.
    assert cli.main([*call, "--licence", "mit", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {s["done"] for s in result["stages"].values()} == {0}
    dataset = there / "lerobot" / "mcap"
    assert cli.main(["convert", str(dataset), "--to", "mcap", "--out", str(back)]) == 0
    made = sorted((back / "mcap" / "mcap").iterdir())
    assert [p.name for p in made] == ["episode_000000.mcap", "episode_000001.mcap"]
    for number, path in enumerate(made):
        assert_same(make_rollout(1.0, number), read_rollout(path))


def test_the_command_quarantines_bad_files_and_counts_them(
    tmp_path: Path, inline: None, capsys: pytest.CaptureFixture[str]
) -> None:
    good = export_mcap(tmp_path, make_rollout(1.0))
    (good.parent / "cut.mcap").write_bytes(good.read_bytes()[:-3000])
    rewritten(good, good.parent / "blind.mcap", kept={"/camera/rgb": 0})
    out = tmp_path / "out"
    call = ["convert", str(good.parent), "--to", "lerobot", "--out", str(out)]
    assert cli.main(call) == 1
    assert "2 items were quarantined" in capsys.readouterr().out
    reasons = {r.item: r.error["reason"] for r in Ledger(out).rows() if r.status == "quarantined"}
    assert "cut.mcap" in reasons["mcap/cut"] and "/camera/rgb" in reasons["mcap/blind"]
    assert open_dataset(out / "lerobot" / "mcap").episodes == (0,)
    assert cli.main([*call, "--max-failed", "2"]) == 0


def test_the_command_refuses_what_it_cannot_use(
    tmp_path: Path, inline: None, capsys: pytest.CaptureFixture[str]
) -> None:
    first = export_mcap(tmp_path, make_rollout(1.0, 0), "a")
    other = dataclasses.replace(make_rollout(1.0, 1), robot="h1")
    second = export_mcap(tmp_path, other, "b")
    out = str(tmp_path / "out")
    for source, to, words, *more in [
        (first.parent, "lerobot", [str(second), "h1", "different robot", str(first), "aliengo"]),
        (first.parent, "mcap", ["already has the format mcap"]),
        (tmp_path / "none", "mcap", ["no such file"]),
        (tmp_path / "frames-a", "mcap", ["nothing to convert"]),
        (first, "lerobot", ["--split val", "is mcap", "only from n1 or ros2"], "--split", "val"),
        (first, "lerobot", ["--every-frame:", "only to n1"], "--every-frame"),
        (first, "lerobot", ["only from n1 or ros2 or to ros2"], "--robot", "h1"),
    ]:
        assert cli.main(["convert", str(source), "--to", to, "--out", out, *more]) == 2
        output = capsys.readouterr().err
        assert all(word in output for word in words), output
