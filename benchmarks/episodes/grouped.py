"""One walk per path or one per instruction: `python -m benchmarks.episodes.grouped SCENES OUT`.

SCENES is a folder of repaired scenes. Paths are sampled in them, described three times, and written
as R2R is: Habitat's coordinates, an episode per instruction, three episodes of a `trajectory_id`. A
second file has the same episodes, each with a `trajectory_id` of its own, as if they were different
paths. Both are aligned, replayed, rendered and exported by the commands of the product with
`--workers` processes. CPU seconds, disk and the largest process are measured, and extrapolated to
3,000 paths. A run that was stopped goes on with the stage it was in, from its beginning; the
measurements of the others are in OUT/measured.json.
"""

import argparse
import gzip
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.frames import transform_points, world_to_habitat_rotation
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.formats.vlnce.groups import TEXTS
from vlnpe.pipeline.inputs.folders import scenes_in

GROUPED, APART = "grouped", "apart"
INSTRUCTIONS = 3
PUBLISHED_PATHS = 3_000
STAGES = ("align", "replay", "render", "export")


def main() -> int:
    """Measure, print the table, and extrapolate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--paths", type=int, default=60)
    parser.add_argument("--image", type=int, default=256, help="width and height [px]")
    parser.add_argument("--robot", default="aliengo")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    journal = options.out / "measured.json"
    measured = json.loads(journal.read_text()) if journal.is_file() else {}
    fixture(options)
    for name in (GROUPED, APART):
        for stage, command, made in commands(options, name):
            key = f"{name} {stage}"
            if key not in measured:
                shutil.rmtree(made, ignore_errors=True)  # half a stage would look cheap
                measured[key] = run(command) | {"bytes": size(made)}
                journal.write_text(json.dumps(measured, indent=1))
            say(f"{key}: {measured[key]}")
    walks = {name: count_walks(options.out / name) for name in (GROUPED, APART)}
    tell(measured, walks)
    return 0


def fixture(options: argparse.Namespace) -> None:
    """Write both files, unless they are there."""
    out = options.out
    if (out / f"{APART}.json.gz").is_file():
        return
    scenes = list(scenes_in(options.scenes))
    count = -(-options.paths // len(scenes))
    sampled, instructed = out / "sampled.json.gz", out / "told.json.gz"
    workers = ["--workers", str(options.workers)]
    flags = ["--count", str(count), "--robot", options.robot, *workers]
    run(["sample", str(options.scenes), "--out", str(sampled), *flags])
    flags = ["--count", str(INSTRUCTIONS), "--robot", "none", *workers]
    files = [str(sampled), "--scenes", str(options.scenes), "--out", str(instructed)]
    run(["instruct", *files, *flags])
    paths = read_episodes(instructed)[: options.paths]
    bundles = {name: load_bundle(options.scenes / name) for name in scenes}
    for name in (GROUPED, APART):
        episodes = [
            r2r_episode(path, bundles[path.scene_id], number, k, name == GROUPED)
            for number, path in enumerate(paths)
            for k in range(INSTRUCTIONS)
        ]
        text = json.dumps({"episodes": episodes})
        (out / f"{name}.json.gz").write_bytes(gzip.compress(text.encode()))


def r2r_episode(
    path: Episode, bundle: SceneBundle, number: int, k: int, grouped: bool
) -> dict[str, Any]:
    """Return instruction `k` of a path as R2R's schema has it, in the source's coordinates."""
    back = np.linalg.inv(bundle.habitat_to_world)
    points = transform_points(back, path.reference_path_world_m).tolist()
    episode_id = INSTRUCTIONS * number + k + 1
    return {
        "episode_id": episode_id,
        "trajectory_id": number + 1 if grouped else episode_id,
        "scene_id": f"mp3d/{path.scene_id}/{path.scene_id}.glb",
        "start_position": points[0],
        "start_rotation": world_to_habitat_rotation(path.start_yaw_rad).tolist(),
        "info": {"geodesic_distance": path.geodesic_distance_m},
        "goals": [{"position": points[-1], "radius": 3.0}],
        "instruction": {"instruction_text": path.extra[TEXTS][k], "instruction_tokens": [0] * 200},
        "reference_path": points,
    }


def commands(options: argparse.Namespace, name: str) -> list[tuple[str, list[str], Path]]:
    """Return stage, command and output of every step for one of the two files."""
    out = options.out / name
    scenes = ["--scenes", str(options.scenes), "--workers", str(options.workers)]
    aligned, rollouts = out / "aligned.json.gz", out / "rollouts"
    frames, data = out / "frames", out / "data"
    camera = f"ego:{options.image}x{options.image}"
    out.mkdir(exist_ok=True)
    source, robot = str(options.out / f"{name}.json.gz"), ["--robot", options.robot]
    return [
        ("align", ["align", source, "--out", str(aligned), *scenes, *robot], aligned),
        ("replay", ["replay", str(aligned), "--out", str(rollouts), *scenes, *robot], rollouts),
        (
            "render",
            ["render", str(rollouts), "--out", str(frames), "--camera", camera, *scenes],
            frames,
        ),
        ("export", ["export", str(frames), "--out", str(data), *scenes], data),
    ]


def run(command: list[str]) -> dict[str, float]:
    """Run a command of vlnpe; return its seconds, and the memory of its largest process [MiB]."""
    # Its own interpreter, because the largest child of a process is known only over all children.
    script = (
        "import json, resource, subprocess, sys\n"
        "code = subprocess.run(sys.argv[1:], stdout=sys.stderr).returncode\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(json.dumps([code, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))\n"
    )
    vlnpe = str(Path(sys.executable).with_name("vlnpe"))
    start = time.perf_counter()
    whole = [sys.executable, "-c", script, vlnpe, *command]
    done = subprocess.run(whole, check=True, capture_output=True, text=True)
    code, cpu_s, largest = json.loads(done.stdout)
    if code:
        raise SystemExit(f"{' '.join(command)}: exit code {code}\n{done.stderr[-2000:]}")
    return {"cpu_s": round(cpu_s, 1), "s": time.perf_counter() - start, "mib": round(largest)}


def size(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
    return sum(p.stat().st_size for p in files)


def count_walks(folder: Path) -> int:
    """Return how many walks the folder has rollouts of."""
    return len(list((folder / "rollouts").rglob("*.mcap")))


def tell(measured: dict[str, dict[str, float]], walks: dict[str, int]) -> None:
    """Print the table and the extrapolation."""
    say(f"walks: {walks}")
    total: dict[str, list[float]] = {}
    for name in (GROUPED, APART):
        rows = [measured[f"{name} {stage}"] for stage in STAGES]
        total[name] = [sum(row[key] for row in rows) for key in ("cpu_s", "bytes")]
        largest = max(row["mib"] for row in rows)
        say(f"{name}: {total[name][0]:.1f} CPU-s, {total[name][1] / 1e6:.1f} MB, {largest} MiB")
    more = walks[APART] - walks[GROUPED]
    each = [(total[APART][k] - total[GROUPED][k]) / more for k in (0, 1)]
    once = total[GROUPED][0] - walks[GROUPED] * each[0]
    say(f"per further walk {each[0]:.2f} CPU-s and {each[1] / 1e6:.2f} MB; once {once:.0f} CPU-s")
    for name, factor in ((GROUPED, 1), (APART, INSTRUCTIONS)):
        count = factor * PUBLISHED_PATHS
        hours, gigabytes = count * each[0] / 3600, count * each[1] / 1e9
        say(f"extrapolated {name}, {count} walks: {hours:.1f} CPU-h, {gigabytes:.0f} GB")


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    raise SystemExit(main())
