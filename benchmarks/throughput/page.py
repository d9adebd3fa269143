"""The section of the page, from results that are kept in runs/bench/throughput.json."""

import json
from pathlib import Path
from typing import Any

from benchmarks.throughput.parts import FRAMES_PER_SECOND, measure_parts
from benchmarks.throughput.runs import (
    EPISODES,
    ROBOTS,
    ROOT,
    SCENES,
    STAGES,
    episodes_per_hour,
    measure_run,
)

RESULTS = ROOT / "runs" / "bench" / "throughput.json"


def keep(kind: str, measured: dict[str, Any]) -> None:
    """Add what was measured to the kept results, in the place of an earlier one of its kind."""
    stored = results()
    same = ("scene", "robot", "workers")
    stored[kind] = [
        entry for entry in stored[kind] if any(entry.get(k) != measured.get(k) for k in same)
    ] + [measured]
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    RESULTS.write_text(json.dumps(stored, indent=1))


def results() -> dict[str, list[dict[str, Any]]]:
    return json.loads(RESULTS.read_text()) if RESULTS.is_file() else {"runs": [], "parts": []}


def section() -> str:
    """Return the Markdown section of all that is kept."""
    stored = results()
    lines = ["## Throughput", ""]
    if stored["runs"]:
        lines += [
            f"`vlnpe collect` in a prepared scene, 256 × 256 RGB-D at {FRAMES_PER_SECOND} frames/s:"
            " wall seconds by stage; CPU and waiting per frame (waiting: workers without an item,",
            "process start included).",
            "",
            "| scene | robot | workers | episodes | frames | "
            + " | ".join(STAGES)
            + " | CPU-ms a frame | waiting, ms a frame | peak MiB | **episodes/h** |",
            "| --- | --- |" + " ---: |" * (len(STAGES) + 7),
            *(_run_line(run) for run in stored["runs"]),
            "",
            *_speed_ups(stored["runs"]),
        ]
    labels = sorted({label for entry in stored["parts"] for label in entry["ms_per_frame"]})
    if labels:
        heads = [f"{entry['scene']}, {entry['robot']}" for entry in stored["parts"]]
        lines += [
            "One process, CPU-ms per frame:",
            "",
            "| part | " + " | ".join(heads) + " |",
            "| --- |" + " ---: |" * len(heads),
            *(_part_line(label, stored["parts"]) for label in labels),
            "| **sum** | "
            + " | ".join(f"**{sum(o['ms_per_frame'].values()):.1f}**" for o in stored["parts"])
            + " |",
            "| imports of a worker, CPU-s | "
            + " | ".join(f"{entry['imports_s']:.1f}" for entry in stored["parts"])
            + " |",
            "| first episode beyond that: scene, models, kernels, CPU-s | "
            + " | ".join(f"{entry['first_episode_s']:.1f}" for entry in stored["parts"])
            + " |",
            "",
        ]
    return "\n".join(lines)


def _run_line(run: dict[str, Any]) -> str:
    stages = run["stages"]
    cells = [run["scene"], run["robot"], run["workers"], run["episodes"], run["frames"]]
    cells += [f"{stages[stage]['wall_s']:.1f}" for stage in STAGES]
    for kind in ("cpu_s", "waiting_s"):
        cells.append(f"{1e3 * sum(s[kind] for s in stages.values()) / run['frames']:.1f}")
    cells += [f"{run['peak_mib']:,.0f}", f"**{episodes_per_hour(run):,.0f}**"]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def _speed_ups(runs: list[dict[str, Any]]) -> list[str]:
    """Return how much faster two workers on two cores are than one on one core."""
    alone = {(r["scene"], r["robot"]): r for r in runs if r["workers"] == r.get("cores") == 1}
    lines = []
    for run in runs:
        entry = alone.get((run["scene"], run["robot"]))
        if entry is None or run["workers"] < 2:
            continue
        faster = episodes_per_hour(run) / episodes_per_hour(entry)
        dearer = _cpu_per_frame(run) / _cpu_per_frame(entry)
        lines.append(
            f"{run['scene']}, {run['robot']}: {run['workers']} workers on as many cores collect "
            f"{faster:.2f} times as fast as one on one core; a frame then costs {dearer:.2f} times "
            "the CPU time."
        )
    return [*lines, ""] if lines else []


def _cpu_per_frame(run: dict[str, Any]) -> float:
    return sum(stage["cpu_s"] for stage in run["stages"].values()) / run["frames"]


def _part_line(label: str, parts: list[dict[str, Any]]) -> str:
    values = (entry["ms_per_frame"].get(label, 0.0) for entry in parts)
    return f"| {label} | " + " | ".join(f"{value:.2f}" for value in values) + " |"


def report(_: Path) -> str:
    """Measure everything and return the section."""
    for scene in SCENES:
        for robot in ROBOTS:
            keep("parts", measure_parts(scene, robot))
            for workers in (1, 2):
                keep("runs", measure_run(scene, robot, workers, EPISODES))
    return section()
