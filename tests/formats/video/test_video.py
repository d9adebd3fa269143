"""Videos: what is written comes back, at exact times, and damage is noticed."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.core.errors import FileFormatError, UnknownNameError
from vlnpe.formats.video.depth_codes import codes_to_depth, depth_to_codes
from vlnpe.formats.video.id_video import IdVideoWriter, read_id_video
from vlnpe.formats.video.mp4 import (
    read_depth_video,
    read_rgb_video,
    write_depth_video,
    write_rgb_video,
)
from vlnpe.formats.video.mux import concatenate_videos
from vlnpe.formats.video.stream import probe_video

RANGE = DepthRange(0.05, 20.0)


def rgb_frames(count: int, height: int = 96, width: int = 128, shift: int = 0) -> np.ndarray:
    """Smooth moving waves: they survive chroma subsampling, and each frame differs."""
    y, x = np.indices((height, width))
    phase = 0.4 * (np.arange(count) + shift)[:, None, None]
    waves = np.sin(x / 9 + phase), np.cos(y / 7 + phase), np.sin(x / 11 + 0 * phase)
    return (np.stack(waves, -1) * 100 + 128).astype(np.uint8)


def depth_frames(count: int, height: int = 96, width: int = 128) -> np.ndarray:
    rng = np.random.default_rng(0)
    frames = rng.uniform(0.05, 20.0, (count, height, width)).astype(np.float32)
    frames[:, :5] = 0.0
    return frames


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_rgb_comes_back_within_codec_loss(tmp_path: Path, codec: str) -> None:
    frames = rgb_frames(11)
    assert write_rgb_video(tmp_path / "a.mp4", frames, 4, codec) == 11
    back = read_rgb_video(tmp_path / "a.mp4")
    assert back.shape == frames.shape
    error = np.mean((back.astype(float) - frames) ** 2, axis=(1, 2, 3))
    assert np.all(10 * np.log10(255**2 / error) > 33)


@pytest.mark.parametrize("size", [(96, 128), (150, 200), (21, 37), (16, 16)])
def test_depth_comes_back_within_half_a_step(tmp_path: Path, size: tuple[int, int]) -> None:
    frames = depth_frames(5, *size)
    write_depth_video(tmp_path / "d.mp4", frames, 4, RANGE)
    back = read_depth_video(tmp_path / "d.mp4", RANGE)
    assert back.dtype == np.float32
    half_step = 0.5 * (frames + 3.5) * np.log(23.5 / 3.5) / 4095
    assert np.all(np.abs(back - frames) <= half_step * 1.01 + 1e-5)
    np.testing.assert_array_equal(back[:, :5], 0.0)


@settings(max_examples=50, deadline=None)
@given(near=st.floats(1e-4, 1.0), span=st.floats(0.5, 60.0), fraction=st.floats(0.0, 1.0))
def test_a_valid_depth_never_becomes_invalid(near: float, span: float, fraction: float) -> None:
    limits = DepthRange(near, near + span)
    depth = np.clip(np.float32(near + fraction * span), np.float32(near), np.float32(near + span))
    code = depth_to_codes(np.array([depth]), limits)
    assert 1 <= code[0] <= 4095
    assert abs(codes_to_depth(code, limits)[0] - depth) < 0.002 * (depth + 3.5)


@pytest.mark.parametrize("bad", [0.0, -1.0, 0.049, 20.01, np.nan, np.inf, -np.inf])
def test_depth_out_of_range_is_invalid(bad: float) -> None:
    codes = depth_to_codes(np.array([bad, 1.0], dtype=np.float32), RANGE)
    assert codes[0] == 0
    assert codes_to_depth(codes, RANGE)[0] == 0.0


def test_depth_codes_are_those_of_lerobot() -> None:
    from lerobot.datasets.depth_utils import dequantize_depth, quantize_depth

    depth = np.geomspace(0.05, 20.0, 200_000).astype(np.float32).reshape(400, 500)
    depth[:3] = 0.0
    ours = depth_to_codes(depth, RANGE)
    theirs = quantize_depth(depth, 0.0, 20.0, 3.5, True, video_backend=None)
    np.testing.assert_array_equal(ours, theirs)
    back = dequantize_depth(theirs, 0.0, 20.0, 3.5, True, output_unit="m", output_tensor=False)
    np.testing.assert_allclose(codes_to_depth(ours, RANGE), back[0], atol=2e-5)


@pytest.mark.parametrize("rate", [1, 4, 5, 10, 25, 50])
def test_concatenation_keeps_pixels_and_exact_times(tmp_path: Path, rate: int) -> None:
    lengths, parts = [5, 1, 8], []
    for k, length in enumerate(lengths):
        parts.append(tmp_path / f"{k}.mp4")
        write_rgb_video(parts[-1], rgb_frames(length, shift=10 * k), rate)
    assert concatenate_videos(parts, tmp_path / "all.mp4") == lengths
    expected = np.concatenate([read_rgb_video(p) for p in parts])
    np.testing.assert_array_equal(read_rgb_video(tmp_path / "all.mp4"), expected)
    with contextlib.closing(av.open(str(tmp_path / "all.mp4"))) as container:
        stream = container.streams.video[0]
        base = stream.time_base
        assert base is not None
        packets = [p for p in container.demux(stream) if p.dts is not None]
        assert [(p.pts or 0) * base * rate for p in packets] == list(range(sum(lengths)))
        assert (stream.duration or 0) * base * rate == sum(lengths)
        keys = [i for i, p in enumerate(packets) if p.is_keyframe]
    assert max(np.diff([*keys, len(packets)])) <= 2
    assert probe_video(tmp_path / "all.mp4").frames_per_second == rate


def test_depth_concatenation_is_lossless(tmp_path: Path) -> None:
    frames = depth_frames(6)
    write_depth_video(tmp_path / "a.mp4", frames[:3], 4, RANGE)
    write_depth_video(tmp_path / "b.mp4", frames[3:], 4, RANGE)
    concatenate_videos([tmp_path / "a.mp4", tmp_path / "b.mp4"], tmp_path / "all.mp4")
    back = read_depth_video(tmp_path / "all.mp4", RANGE)
    np.testing.assert_array_equal(depth_to_codes(back, RANGE), depth_to_codes(frames, RANGE))


def test_the_same_frames_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_rgb_video(tmp_path / f"rgb_{name}.mp4", rgb_frames(6), 4)
        write_depth_video(tmp_path / f"depth_{name}.mp4", depth_frames(6), 4, RANGE)
    for kind in ("rgb", "depth"):
        first, second = (tmp_path / f"{kind}_{n}.mp4" for n in "ab")
        assert first.read_bytes() == second.read_bytes()


ENCODE = """
import sys
from pathlib import Path
from tests.formats.video.test_video import RANGE, depth_frames, rgb_frames
from vlnpe.formats.video.codecs import CLIP_CODEC, WATCH_CODEC
from vlnpe.formats.video.mp4 import write_depth_video, write_rgb_video
for codec in ("h264", CLIP_CODEC, WATCH_CODEC):
    write_rgb_video(Path("a.mp4"), rgb_frames(14, 150, 200), 4, codec)
    sys.stdout.buffer.write(Path("a.mp4").read_bytes())
write_depth_video(Path("a.mp4"), depth_frames(14, 150, 200), 4, RANGE)
sys.stdout.buffer.write(Path("a.mp4").read_bytes())
"""


def test_bytes_do_not_depend_on_what_memory_held_before(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[3]
    encoded = [
        subprocess.run(
            [sys.executable, "-c", ENCODE],
            cwd=tmp_path,
            # glibc fills fresh memory with this byte, inverted.
            env=os.environ | {"MALLOC_PERTURB_": fill, "PYTHONPATH": str(root)},
            stdout=subprocess.PIPE,
            check=True,
        ).stdout
        for fill in ("0", "90", "201")
    ]
    assert encoded[0] == encoded[1] == encoded[2]


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([], "no frame"),
        ([np.zeros((8, 8), np.uint8)], r"valid: \(H, W, 3\) uint8"),
        ([np.zeros((8, 8, 3), np.float32)], r"valid: \(H, W, 3\) uint8"),
        ([np.zeros((33, 32, 3), np.uint8)], "even"),
        ([np.zeros((32, 32, 3), np.uint8), np.zeros((32, 34, 3), np.uint8)], "frame 1"),
    ],
)
def test_unusable_frames_leave_nothing_behind(tmp_path: Path, frames: list, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        write_rgb_video(tmp_path / "a.mp4", frames, 4)
    assert list(tmp_path.iterdir()) == []


def test_unknown_codec_names_the_valid_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="h264"):
        write_rgb_video(tmp_path / "a.mp4", rgb_frames(2), 4, "divx")


@pytest.mark.parametrize("damage", ["missing", "empty", "no video", "header lost", "tail lost"])
def test_damaged_videos_are_refused(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "a.mp4"
    write_rgb_video(path, rgb_frames(40), 4)
    content = path.read_bytes()
    if damage == "tail lost":  # with the index in front, as `concatenate_videos` writes it
        concatenate_videos([path], path)
        content = path.read_bytes()[: len(content) // 2]
    contents = {
        "empty": b"",
        "no video": b"not a video at all" * 100,
        "header lost": content[:-300],
    }
    path.write_bytes(contents.get(damage, content))
    if damage == "missing":
        path.unlink()
    for reader in (read_rgb_video, lambda p: concatenate_videos([p], tmp_path / "out.mp4")):
        with pytest.raises(FileFormatError, match=r"a\.mp4"):
            reader(path)
    assert not (tmp_path / "out.mp4").exists()


def test_parts_of_different_sizes_are_not_joined(tmp_path: Path) -> None:
    write_rgb_video(tmp_path / "a.mp4", rgb_frames(2), 4)
    write_rgb_video(tmp_path / "b.mp4", rgb_frames(2, 64, 64), 4)
    with pytest.raises(FileFormatError, match=r"b\.mp4"):
        concatenate_videos([tmp_path / "a.mp4", tmp_path / "b.mp4"], tmp_path / "all.mp4")
    assert not (tmp_path / "all.mp4").exists()


def test_ids_come_back_exactly(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 65536, (5, 33, 47))
    with IdVideoWriter(tmp_path / "ids.mov", 4) as writer:
        for frame in frames:
            writer.write(frame)
    np.testing.assert_array_equal(read_id_video(tmp_path / "ids.mov"), frames)
    content = (tmp_path / "ids.mov").read_bytes()
    (tmp_path / "ids.mov").write_bytes(content[: len(content) // 2])
    with pytest.raises(FileFormatError, match=r"ids\.mov"):
        read_id_video(tmp_path / "ids.mov")
    write_rgb_video(tmp_path / "rgb.mp4", rgb_frames(2), 4)
    with pytest.raises(FileFormatError, match="a video of ids has gray16be"):
        read_id_video(tmp_path / "rgb.mp4")


@pytest.mark.parametrize("bad", [np.full((4, 4), -1), np.full((4, 4), 65536), np.zeros((4, 5, 3))])
def test_unusable_ids_leave_nothing_behind(tmp_path: Path, bad: np.ndarray) -> None:
    with (
        pytest.raises(ValueError, match="valid:"),
        IdVideoWriter(tmp_path / "ids.mov", 4) as writer,
    ):
        writer.write(np.zeros((4, 4), dtype=int))
        writer.write(bad.astype(int))
    assert list(tmp_path.iterdir()) == []
