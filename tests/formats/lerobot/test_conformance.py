"""What others do with our datasets: LeRobot's loaders, aggregation, streaming and training."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.lerobot_data import DEPTH, RGB, load, write_units
from vlnpe.formats.lerobot import assemble_dataset

pytestmark = pytest.mark.usefixtures("offline")
ASSEMBLY: dict[str, Any] = {"provenance": {}, "licence": "mit", "title": "Two rooms"}
FIRST, SECOND = (3.0, 2.0), (1.5, 2.5, 1.0)
ENVIRONMENT = {**os.environ, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}


@pytest.fixture(scope="module", params=[("video", "h264"), ("image", "av1")], ids="-".join)
def datasets(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Two datasets of different episodes; once with our default codecs, once with free ones."""
    depth, codec = request.param
    roots = []
    for seconds in (FIRST, SECOND):
        folder = tmp_path_factory.mktemp("conform")
        units = write_units(folder, seconds, depth_storage=depth, rgb_codec=codec)
        roots.append(folder / "set")
        assemble_dataset(units, roots[-1], **ASSEMBLY)
    return roots


def only_default_codecs(root: Path) -> None:
    """Skip the other dataset where a test takes long and its codecs make no difference."""
    info = json.loads((root / "meta" / "info.json").read_text())
    if info["features"][DEPTH]["dtype"] == "image":
        pytest.skip("done once, with the default codecs")


def command(name: str, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of an installed package."""
    words = [str(Path(sys.executable).with_name(name)), *map(str, arguments)]
    return subprocess.run(words, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True)


def test_lerobot_aggregates_two_of_ours(datasets: list[Path], tmp_path: Path) -> None:
    from lerobot.datasets.aggregate import aggregate_datasets

    aggregate_datasets(["vlnpe/a", "vlnpe/b"], "vlnpe/both", datasets, tmp_path / "both")
    both = load(tmp_path / "both", depth_output_unit="m")
    parts = [load(root, depth_output_unit="m") for root in datasets]
    assert both.num_episodes == len(FIRST) + len(SECOND)
    assert len(both) == sum(map(len, parts))
    for part, offset in zip(parts, (0, len(parts[0])), strict=True):
        for i in (0, len(part) // 2, len(part) - 1):
            for key in (RGB, DEPTH, "action", "observation.state"):
                np.testing.assert_array_equal(both[offset + i][key], part[i][key], err_msg=key)
    first, all_ = parts[0].meta.stats["action"], both.meta.stats["action"]
    assert (all_["max"] >= first["max"]).all() and all_["count"] == [len(both)]


def test_windows_come_through_spawned_workers(datasets: list[Path]) -> None:
    from torch.utils.data import DataLoader

    only_default_codecs(datasets[0])
    deltas = {RGB: [-0.25, 0.0], "action": [0.0, 0.25, 0.5, 0.75]}
    dataset = load(datasets[1], delta_timestamps=deltas, depth_output_unit="m")
    plain = load(datasets[1], depth_output_unit="m")
    actions = [plain[index]["action"] for index in range(len(plain))]
    loader = DataLoader(dataset, batch_size=6, num_workers=1, multiprocessing_context="spawn")
    seen = 0
    for batch in loader:
        assert batch[RGB].shape[1:] == (2, 3, 64, 96)
        assert batch[DEPTH].shape[1:] == (1, 64, 96)
        for row, index in enumerate(batch["index"].tolist()):
            padded = batch["action_is_pad"][row].numpy()
            for k in range(4):
                expected = batch["action"][row, k] if padded[k] else actions[index + k]
                assert np.array_equal(batch["action"][row, k], expected), (index, k)
        seen += len(batch["index"])
    assert seen == len(plain)


def test_streaming_reads_all_frames(datasets: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    from lerobot.datasets import streaming_dataset
    from lerobot.datasets.video_utils import decode_video_frames

    try:
        import torchcodec  # noqa: F401
    except (ImportError, OSError, RuntimeError):
        # LeRobot streams colours through torchcodec alone, which needs the system's FFmpeg.
        def decode(path: Path, times: Any, tolerance_s: float, **options: Any) -> Any:
            return decode_video_frames(path, times, tolerance_s, "pyav", options["return_uint8"])

        monkeypatch.setattr(streaming_dataset, "decode_video_frames_torchcodec", decode)
    deltas: Any = {"action": [0.0, 0.25]}  # LeRobot declares other types than it reads
    options: Any = {"shuffle": False, "delta_timestamps": deltas, "depth_output_unit": "m"}
    stream = streaming_dataset.StreamingLeRobotDataset("vlnpe/test", root=datasets[1], **options)
    plain = load(datasets[1], depth_output_unit="m")
    seen = []
    for item in stream:
        seen.append(int(item["index"]))
        same = plain[seen[-1]]
        assert item["action"].shape == (2, 3)
        np.testing.assert_array_equal(item["action"][0], same["action"])
        np.testing.assert_allclose(item[RGB], same[RGB], atol=1e-6)
        np.testing.assert_allclose(np.ravel(item[DEPTH]), np.ravel(same[DEPTH]), atol=1e-6)
    assert sorted(seen) == list(range(len(plain)))


def test_lerobot_doctor_finds_no_fault(datasets: list[Path], tmp_path: Path) -> None:
    done = command("lerobot-doctor", "check", "--ci", datasets[0], cwd=tmp_path)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    report = json.loads(done.stdout[done.stdout.index("{") : done.stdout.rindex("}") + 1])
    assert report["summary"]["FAIL"] == 0
    passed = {check["name"] for check in report["checks"] if check["severity"] == "PASS"}
    # It warns of what made-up walks are: short, with noise for joints.
    assert passed >= {"Metadata & Format Compliance", "Temporal Consistency"}
    assert passed >= {"Video Integrity", "Feature Consistency"}
