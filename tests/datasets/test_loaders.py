"""Loaders against LeRobot's own reader, and against the walks they were written from."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn.utils.rnn import pad_packed_sequence

from tests.support.lerobot_data import DEPTH, RGB, write_unit, write_units
from tests.support.paths import integrate_motion
from tests.support.rollouts import make_frames
from tests.support.training_data import WORDS, make_walk, write_dataset
from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.instructions import InstructionChoice
from vlnpe.datasets.local import open_dataset
from vlnpe.datasets.navigation import NavigationConfig, NavigationDataset
from vlnpe.datasets.poses import future_poses, relative
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences, pack
from vlnpe.datasets.tokens import Tokens, tokens_of_file, training_tokens
from vlnpe.datasets.windows import WaypointWindows, WindowConfig
from vlnpe.formats.core.errors import FileFormatError, InputError, UnknownNameError
from vlnpe.formats.lerobot import FileLimits, assemble_dataset
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.formats.vlnce.groups import group_by_path

pytestmark = pytest.mark.usefixtures("offline")
SECONDS = (3.0, 0.0, 4.5, 2.0)
STARTS = np.concatenate([[0], np.cumsum([13, 1, 19, 9])])


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("walks"), "aliengo", SECONDS)


@pytest.fixture(scope="module")
def tokens() -> Tokens:
    return training_tokens(WORDS[:2], 12)


@pytest.mark.parametrize("storage", ["video", "image"])
def test_items_equal_lerobots_with_the_same_windows(storage: str, tmp_path: Path) -> None:
    units = write_units(tmp_path, SECONDS, depth_storage=storage)
    limits = FileLimits(data_mb=0.012, video_mb=0.004)  # several files of each kind
    assemble_dataset(
        units, tmp_path / "set", provenance={}, licence="mit", title="walks", limits=limits
    )
    back, ahead = [-0.5, -0.25, 0.0], [0.0, 0.25, 0.5, 0.75]
    deltas = {RGB: back, DEPTH: back, "action": ahead, "action.discrete": ahead}
    bare: Any = open_dataset(
        tmp_path / "set", delta_timestamps=deltas, video_backend="pyav", return_uint8=True
    )
    ours = NavigationDataset(tmp_path / "set", NavigationConfig(history=3, future=4))
    assert len(ours) == len(bare) == STARTS[-1]
    for number in (41, 0, 1, 12, 13, 14, 15, 16, 31, 32, 33, 20):
        our_item, theirs = ours[number], bare[number]
        for key, value in our_item.items():
            if key in ("robot", "uid"):
                continue
            if not torch.is_tensor(value):
                assert value == theirs[key]
                continue
            assert value.shape == theirs[key].shape, key
            tolerance = 1e-6 if key == DEPTH else 0.0
            torch.testing.assert_close(
                value, theirs[key].to(value.dtype), atol=tolerance, rtol=0.0, msg=key
            )
        assert our_item["robot"] == "aliengo"


def test_one_frame_has_no_time_axis_and_images_can_be_scaled(root: Path) -> None:
    item = NavigationDataset(root, NavigationConfig(size_px=32, depth=False))[14]
    assert item[RGB].shape == (3, 32, 32) and item[RGB].dtype == torch.uint8
    assert DEPTH not in item and f"{RGB}_is_pad" not in item
    assert item["action"].shape == (3,) and item["action.discrete"].shape == ()
    with pytest.raises(UnknownNameError, match=r"observation\.joints"):
        NavigationDataset(root, NavigationConfig(columns=("observation.legs",)))


def test_only_common_columns_of_several_robots_are_given(root: Path, tmp_path: Path) -> None:
    other = write_dataset(tmp_path, "h1", (1.0, 1.5))
    both = NavigationDataset(select_all([root, other]))
    assert len(both) == STARTS[-1] + 5 + 7
    assert {both[0]["robot"], both[len(both) - 1]["robot"]} == {"aliengo", "h1"}
    assert both[0].keys() == both[len(both) - 1].keys()
    with pytest.raises(UnknownNameError, match=r"observation\.joints"):
        config = NavigationConfig(columns=("observation.joints",))
        NavigationDataset(select_all([root, other]), config)


def test_sequences_are_the_walks_that_were_written(root: Path, tokens: Tokens) -> None:
    config = SequenceConfig(inflection_coefficient=2.5, future=8, every_frame=True)
    sequences = EpisodeSequences(select_all([root]), tokens, config)
    bare: Any = open_dataset(root, video_backend="pyav", return_uint8=True)
    for number, seconds in enumerate(SECONDS):
        rollout = make_walk(number, "aliengo", seconds)
        table = build_frame_table(rollout, make_frames(rollout), 4)
        item = sequences[number]
        actions = table.columns["action.discrete"][:, 0]
        count = len(actions)
        assert (int(item["length"]), bool(item["cut"])) == (count, False)
        np.testing.assert_array_equal(item["action"], actions)
        assert item["previous_action"].tolist() == [0, *(actions[:-1] + 1)]
        for step in range(count):
            changes = step == 0 or actions[step] != actions[step - 1]
            assert item["weight"][step] == (2.5 if changes else 1.0)
        np.testing.assert_allclose(item["motion"], table.columns["action"], atol=1e-5)
        path = integrate_motion(table.columns["action"], np.zeros(3))
        np.testing.assert_allclose(item["pose"][:, :2], path[:, :2], atol=1e-5)
        np.testing.assert_allclose(np.cos(item["pose"][:, 2].numpy() - path[:, 2]), 1.0, atol=1e-6)
        assert item["waypoint_valid"].sum(1).tolist() == [
            min(8, count - 1 - t) for t in range(count)
        ]
        for step in (0, count // 2, count - 1):
            frame = bare[int(STARTS[number]) + step]
            torch.testing.assert_close(item["rgb"][step], frame[RGB], atol=0, rtol=0)
            torch.testing.assert_close(item["depth"][step], frame[DEPTH], atol=1e-6, rtol=0)
        assert (item["rgb"].dtype, item["depth"].dtype) == (torch.uint8, torch.float32)


def test_sequences_are_discrete_steps_that_lead_to_the_end(root: Path, tokens: Tokens) -> None:
    """What a model learns to do ends where the robot did, and it sees what the robot saw there."""
    sequences = EpisodeSequences(select_all([root]), tokens, SequenceConfig(future=8))
    every = replace(sequences.config, every_frame=True)
    frames = EpisodeSequences(select_all([root]), tokens, every)
    for number in range(len(sequences)):
        item, whole = sequences[number], frames[number]
        actions, pose = item["action"].numpy(), item["pose"].numpy()
        assert actions[-1] == 0 and actions[:-1].all()
        assert item["previous_action"].tolist() == [0, *(actions[:-1] + 1)]
        done = execute(actions, np.zeros(3))[-1]
        assert np.hypot(*(done[:2] - whole["pose"][-1, :2].numpy())) < 0.5
        walked = integrate_motion(item["motion"].numpy(), np.zeros(3))
        np.testing.assert_allclose(walked[:, :2], pose[:, :2], atol=1e-5)
        seen = discrete_steps(whole["pose"].numpy().astype(float)).frame
        for key in ("rgb", "depth", "pose", "progress"):
            torch.testing.assert_close(item[key], whole[key][seen])
        assert item["waypoint_valid"].sum(1).tolist() == [
            min(8, len(seen) - 1 - t) for t in range(len(seen))
        ]


def test_a_long_episode_is_cut_and_marked(root: Path, tokens: Tokens) -> None:
    whole = EpisodeSequences(select_all([root]), tokens)[2]
    short = EpisodeSequences(select_all([root]), tokens, SequenceConfig(max_steps=6))[2]
    assert (int(short["length"]), bool(short["cut"])) == (6, True)
    for key in ("rgb", "depth", "action", "weight", "pose"):
        torch.testing.assert_close(short[key], whole[key][:6])


def test_episodes_are_padded_and_packed(root: Path, tokens: Tokens) -> None:
    sequences = EpisodeSequences(
        select_all([root]), tokens, SequenceConfig(size_px=16, every_frame=True)
    )
    items = [sequences[n] for n in range(4)]
    batch = collate_sequences(items)
    assert batch["rgb"].shape == (4, 19, 3, 16, 16)
    assert batch["tokens"].shape == (4, 12)
    assert batch["mask"].sum(1).tolist() == batch["length"].tolist() == [13, 1, 19, 9]
    assert batch["uid"][2] == items[2]["uid"]
    assert not batch["weight"][~batch["mask"]].any() and not batch["depth"][~batch["mask"]].any()
    back, lengths = pad_packed_sequence(pack(batch, "pose"), batch_first=True)
    torch.testing.assert_close(back, batch["pose"])
    torch.testing.assert_close(lengths, batch["length"])


def test_waypoints_lead_along_the_motions(root: Path, tokens: Tokens) -> None:
    windows = WaypointWindows(select_all([root]), tokens, WindowConfig(history=2, size_px=16))
    sequences = EpisodeSequences(
        select_all([root]), tokens, SequenceConfig(size_px=16, every_frame=True)
    )
    assert len(windows) == STARTS[-1]
    for episode, step in ((0, 0), (0, 5), (0, 12), (1, 0), (2, 3), (2, 15), (3, 8)):
        item, whole = windows[int(STARTS[episode]) + step], sequences[episode]
        count = int(whole["length"])
        assert (int(item["frame"]), item["uid"]) == (step, whole["uid"])
        assert item["waypoint_valid"].tolist() == [step + k < count for k in range(1, 9)]
        ahead = [min(step + k, count - 1) for k in range(8)]
        np.testing.assert_allclose(item["motions"], whole["motion"][ahead], atol=1e-5)
        motions = np.concatenate([item["motions"].numpy(), np.zeros((1, 3))])
        path = integrate_motion(motions, np.zeros(3))[1:]
        np.testing.assert_allclose(item["waypoints"], path, atol=1e-5)
        assert item["past_valid"].tolist() == [step - k >= 0 for k in (4, 3, 2, 1)]
        for k, valid in zip((4, 3, 2, 1), item["past_valid"], strict=True):
            expected = whole["motion"][step - k] if valid else torch.zeros(3)
            torch.testing.assert_close(item["past_motions"][4 - k], expected, atol=1e-5, rtol=0)
        torch.testing.assert_close(item["pose"], whole["pose"][step])
        assert item["stop_progress"] == (1.0 if count == 1 else np.float32(step / (count - 1)))
        torch.testing.assert_close(item["rgb"][1], whole["rgb"][step])
        torch.testing.assert_close(item["rgb"][0], whole["rgb"][max(step - 1, 0)])
        torch.testing.assert_close(item["depth"][1], whole["depth"][step])


POSES = st.lists(
    st.tuples(*[st.floats(-20, 20)] * 2, st.floats(-3.1, 3.1)), min_size=1, max_size=12
).map(lambda rows: np.array(rows, np.float64))


@settings(max_examples=60, deadline=None)
@given(POSES, st.integers(0, 11), st.tuples(*[st.floats(-9, 9)] * 3))
def test_relative_poses_do_not_depend_on_the_world_frame(
    poses: np.ndarray, frame: int, move: tuple[float, float, float]
) -> None:
    frame %= len(poses)
    x, y, yaw = move
    c, s = np.cos(yaw), np.sin(yaw)
    turned = np.column_stack(
        [poses[:, :2] @ np.array([[c, s], [-s, c]]) + (x, y), poses[:, 2] + yaw]
    )
    here, there = relative(poses, frame), relative(turned, frame)
    np.testing.assert_allclose(here[:, :2], there[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(here[:, 2] - there[:, 2]), 1.0, atol=1e-12)
    np.testing.assert_allclose(here[frame], 0.0, atol=1e-12)
    future = future_poses(poses, 3)
    later = np.minimum(frame + np.arange(1, 4), len(poses) - 1)
    np.testing.assert_allclose(future[frame][:, :2], here[later, :2], atol=1e-4)


def test_tokens_know_the_training_words_alone(root: Path, tokens: Tokens, tmp_path: Path) -> None:
    words = tokens.vocabulary.words
    assert words[:2] == ("<pad>", "<unk>")
    encoded = tokens.encode("Walk past the piano.")
    assert [words[k] for k in encoded[:5]] == ["walk", "past", "the", "<unk>", "."]
    assert encoded[5:].tolist() == [0] * 7
    assert len(tokens.encode("the " * 50)) == 12
    assert (tokens.encode("the " * 50) > 1).all()
    path = tmp_path / "train.json.gz"
    write_episodes(path, [make_walk(n, "aliengo", 0.0).episode for n in range(3)])
    of_file = tokens_of_file(path)
    assert of_file.encode(WORDS[2]).shape == (200,)
    assert 1 not in of_file.encode(WORDS[2])
    item = EpisodeSequences(select_all([root]), of_file, SequenceConfig(images=False))[1]
    np.testing.assert_array_equal(item["tokens"], of_file.encode(WORDS[1]))


def test_other_frame_rates_have_steps_but_no_actions(tokens: Tokens, tmp_path: Path) -> None:
    fast = write_dataset(tmp_path, "h1", (1.0,), rate=10)
    with pytest.raises(InputError, match="10 frames/s have no discrete actions"):
        EpisodeSequences(select_all([fast]), tokens, SequenceConfig(every_frame=True))
    assert EpisodeSequences(select_all([fast]), tokens)[0]["action"][-1] == 0
    assert WaypointWindows(select_all([fast]), tokens)[3]["waypoints"].shape == (8, 3)


@pytest.mark.parametrize("damage", ["half a video", "no rows", "no info"])
def test_damage_is_named(root: Path, tokens: Tokens, tmp_path: Path, damage: str) -> None:
    copy = tmp_path / "set"
    shutil.copytree(root, copy)
    match damage:
        case "half a video":
            path = next((copy / "videos" / RGB).rglob("*.mp4"))
            path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
        case "no rows":
            path = next((copy / "data").rglob("*.parquet"))
            path.write_bytes(b"")
        case _:
            path = copy / "meta" / "info.json"
            path.write_text("{}")
    with pytest.raises(FileFormatError, match=path.name):
        sequences = EpisodeSequences(select_all([read_index(copy)]), tokens)
        for number in range(4):
            sequences[number]


def test_any_of_a_path_s_instructions_is_drawn_by_seed_and_epoch(
    tokens: Tokens, tmp_path: Path
) -> None:
    units = []
    for number in range(6):
        walk = make_walk(number, "aliengo", 0.5)
        members = [
            replace(walk.episode, episode_id=f"{number}-{k}", instruction=f"{text} {number}")
            for k, text in enumerate(WORDS)
        ]
        members = [replace(m, extra={}) for m in members]
        (path,) = group_by_path(members)
        units.append(write_unit(tmp_path, replace(walk, episode=path), number))
    out = tmp_path / "set"
    assemble_dataset(units, out, provenance={}, licence="mit", title="x")
    index = read_index(out)
    entries = [index.entry(row) for row in range(6)]
    assert entries[2].instructions == tuple(f"{text} 2" for text in WORDS)
    table = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet")
    assert table["instruction_episode_ids"][2].as_py() == ["2-0", "2-1", "2-2"]
    assert [InstructionChoice().text(e) for e in entries] == [e.instructions[0] for e in entries]
    drawn = [[InstructionChoice("any", 3, epoch).text(e) for e in entries] for epoch in range(60)]
    assert drawn[4] == [InstructionChoice("any", 3, 4).text(e) for e in entries]
    for number, entry in enumerate(entries):
        assert {texts[number] for texts in drawn} == set(entry.instructions)
    chosen = EpisodeSequences(
        select_all([index]), tokens, SequenceConfig(images=False), InstructionChoice("any")
    )
    expected = tokens.encode(InstructionChoice("any").text(entries[1]))
    assert chosen[1]["tokens"].tolist() == expected.tolist()
    with pytest.raises(UnknownNameError, match="own"):
        InstructionChoice("all")
