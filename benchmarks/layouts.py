"""Layouts of trainers: cost, size and answers of the walks of two robots in two scenes."""

import json
import re
import resource
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.chain import collect
from vlnpe.formats.core.atomic import write_json
from vlnpe.formats.trainers.registry import LAYOUTS
from vlnpe.formats.trainers.subset import SIDECAR_NAME

_ROBOTS = (
    "--robot",
    "aliengo,jetbot",
    "--scene",
    "builtin:apartment*2",
    "--episodes",
    "8",
    "--no-mcap",
)
_ANSWER = re.compile(r"^\| (\w+) \| (\d+) \| (\d+) \|", re.MULTILINE)


def report(run: Path) -> str:
    """Convert walks to every layout, and return a Markdown section; what is measured is kept."""
    source = run.with_name(f"{run.name}-layouts")
    if not (source / "report" / "index.html").is_file():
        collect(source, *_ROBOTS)
    part = sorted((source / "lerobot").iterdir())[0]
    file = source.with_name(f"{source.name}.json")
    measured = json.loads(file.read_text()) if file.is_file() else {}
    for name in LAYOUTS:
        if name not in measured:
            outs = [source.with_name(f"{source.name}-{kind}") for kind in ("part", "all")]
            few, many = (_converted(s, name, o) for s, o in zip((part, source), outs, strict=True))
            measured[name] = many | {"few": few}
            write_json(file, measured)
    lines = [
        "## Layouts of trainers",
        "",
        "`vlnpe convert` of walks of Aliengo and Jetbot in two apartments, 256 × 256 px at 4",
        "frames/s, by one worker. A walk costs what both robots' walks cost more than one robot's.",
        "",
        "| layout | walks | to start | CPU-s a walk | MB a walk | forward : left : right : stop |",
        "| --- | ---: | ---: | ---: | ---: | --- |",
        *(_line(name, values) for name, values in measured.items()),
    ]
    return "\n".join(lines) + "\n"


def _converted(source: Path, name: str, out: Path) -> dict[str, Any]:
    """Convert afresh; return CPU time, bytes, walks and answers."""
    shutil.rmtree(out, ignore_errors=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "convert", str(source), "--to", name]
    subprocess.run([*command, "--out", str(out), "--workers", "1"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    written = [path for path in (out / name).rglob("*") if path.is_file()]
    answers: Counter[str] = Counter()
    for readme in (path for path in written if path.name == "README.md"):
        answers.update({kind: int(n) for kind, _, n in _ANSWER.findall(readme.read_text())})
    return {
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "bytes": sum(path.stat().st_size for path in written),
        "walks": sum(len(p.read_text().splitlines()) for p in written if p.name == SIDECAR_NAME),
        "answers": answers,
    }


def _line(name: str, values: dict[str, Any]) -> str:
    few, walks = values["few"], values["walks"]
    each = (values["cpu_s"] - few["cpu_s"]) / (walks - few["walks"])
    start = few["cpu_s"] - each * few["walks"]
    answers, total = values["answers"], sum(values["answers"].values())
    kinds = ("forward", "left", "right", "stop")
    shares = " : ".join(f"{100 * answers[k] / total:.0f}" for k in kinds) + " %" if total else "-"
    megabytes = values["bytes"] / walks / 1e6
    return f"| {name} | {walks} | {start:.1f} CPU-s | {each:.2f} | {megabytes:.1f} | {shares} |"
