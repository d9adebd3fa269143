"""Keys cover the code that a job imports, no less and no more."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.onnx_runtime import EXTRA
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.process import source
from vlnpe.pipeline.engine.work import Job, work_item
from vlnpe.pipeline.stages.rollouts.replay_job import ReplayJob, Walker
from vlnpe.pipeline.stages.scenes.repair import RepairJob
from vlnpe.pipeline.stages.scenes.repair_splats import SplatRepairJob
from vlnpe.scene_repair.config import RepairConfig

pytestmark = pytest.mark.chain

EPISODE = Episode(
    "0", "0", "s", "train", 0, np.zeros(3), 0.0, np.zeros(3), np.zeros((2, 3)), 0.0, "Stop."
)
H1 = Walker(get_robot("h1"), ReplayConfig("h1"))
ROOT = Path(__file__).resolve().parents[3]
JOBS = {
    "scan": "stages.scenes.scan",
    "scan as splats": "stages.scenes.scan_splats",
    "repair": "stages.scenes.repair",
    "repair of splats": "stages.scenes.repair_splats",
    "sample": "stages.episodes.jobs",
    "name": "stages.instructions.name_things",
    "instruct": "stages.instructions.instruct_job",
    "replay": "stages.rollouts.replay_job",
    "render": "stages.rollouts.render_job",
    "pictures": "stages.rollouts.pictures_job",
    "export": "stages.datasets.export_job",
    "look": "stages.instructions.visibility",
    "mcap": "stages.datasets.mcap_job",
    "report": "report.job",
}
# Prints the digests of the untouched copy and after each edit alone, one JSON object a line.
DIGESTS = """
import json, sys
from functools import cache
from pathlib import Path
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.process import source

jobs, edits = json.load(sys.stdin)
parse = source._source.__wrapped__

@cache
def parsed(module, content):
    return parse(module)

# Only what an edit changed is parsed again.
source._source = lambda module: parsed(module, source._path(module).read_bytes())

def show():
    source.imported_modules.cache_clear()
    source.code_digest.cache_clear(), source.source_digest.cache_clear()
    print(json.dumps({s: source.source_digest("pipeline." + job) for s, job in jobs.items()}))

show()
for name, old, new in edits:
    path = Path(source.__file__).parents[2] / name
    text = path.read_text()
    assert old in text, (name, old)
    path.write_text(text.replace(old, new, 1))
    show()
    path.write_text(text)
"""
# File, text in it, its replacement; the stages that must run again, and no others may.
EDITS = {
    "a bookshelf": (
        "apartments/building/furniture/storage.py",
        "\nfrom .",
        "\nCOLOUR = 1\nfrom .",
        {"scan", "scan as splats"},
    ),
    "a shader": (
        "rendering/kernels/surface_light.py",
        "\nfrom .",
        "\nBRIGHTER = 2\nfrom .",
        {"render", "pictures", "look", "name"},
    ),
    "how gaits run": (
        "collectors/locomotion/runtime/observation.py",
        "\nfrom .",
        "\nSCALE = 2\nfrom .",
        {"replay"},
    ),
    "the gait trainer": (
        "collectors/locomotion/training/rewards.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        set(),
    ),
    "the report's template": ("pipeline/report/page.html.j2", "<body>", "<body >", {"report"}),
    "reading USD, by a name that only the child process imports": (
        "scene_repair/usd/read_stage.py",
        "\nfrom .",
        "\nDEEPER = 2\nfrom .",
        {"repair", "repair of splats"},
    ),
    "how splats are drawn": (
        "geometry/splatting/blend.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        {"repair of splats", "render", "pictures", "look", "name"},
    ),
    "how depth is fused, which the virtual scanner does, too": (
        "geometry/fusion/volume.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        {"scan", "scan as splats", "repair of splats"},
    ),
    "where virtual cameras stand": (
        "scene_repair/splats/closer.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        {"repair of splats"},
    ),
    "reading a format of splats": (
        "formats/splats/packed.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        {"repair of splats"},
    ),
    "where a capture has Gaussians": (
        "apartments/scanner/splats.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        {"scan as splats"},
    ),
    "the stage runner": (
        "pipeline/execution/processes.py",
        "\nfrom .",
        "\nMORE = 2\nfrom .",
        set(),
    ),
    "a docstring": (
        "collectors/replay/replay.py",
        '"""Replay an episode',
        '"""Play an episode',
        set(),
    ),
    "a comment": (
        "formats/core/frames.py",
        "\nimport ",
        "\n# Why.\nimport ",
        set(),
    ),
    "the frames that all share": (
        "formats/core/atomic.py",
        "\nimport ",
        "\nMORE = 2\nimport ",
        set(JOBS),
    ),
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the package that may be edited."""
    root = tmp_path_factory.mktemp("tree") / "vlnpe"
    for folder in (
        *("apartments", "collectors", "datasets", "formats", "geometry", "instruction_gen"),
        *("pipeline", "rendering", "scene_repair", "trajectory_sampler", "wayfinding"),
    ):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return root


def command_in(tree: Path, code: str) -> list[str]:
    """Return a command that runs Python code which finds the copy before the installed package."""
    first = f"import sys; sys.path.insert(0, {str(tree.parent)!r}); sys.meta_path[:] = ["
    first += "f for f in sys.meta_path if '__editable__' not in str(f)]\n"
    return [sys.executable, "-c", first + code]


def run_in(tree: Path, code: str, stdin: str = "") -> str:
    """Return what the code prints."""
    command = command_in(tree, code)
    return subprocess.run(
        command, input=stdin, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def test_edits_repeat_the_stages_they_matter_to_and_no_others(tree):
    edits = [edit[:3] for edit in EDITS.values()]
    lines = run_in(tree, DIGESTS, json.dumps([JOBS, edits])).splitlines()
    before, *after = map(json.loads, lines)
    assert set(before) == set(JOBS) and len(after) == len(EDITS)
    wrong = {}
    for (what, (*_, stages)), digests in zip(EDITS.items(), after, strict=True):
        again = {stage for stage in JOBS if digests[stage] != before[stage]}
        if again != stages:
            wrong[what] = {"again": sorted(again), "expected": sorted(stages)}
    assert wrong == {}


HELPER = """from numba import njit

@njit(inline="never")
def helper(x):
    return x + 1
"""
CALLER = """from .process.kernel import kernel
from .trial_helper import helper

@kernel()
def caller(x):
    return helper(x)
"""


def test_a_kernel_is_compiled_again_when_a_helper_of_another_module_changes(tree):
    helper, caller = tree / "formats/trial_helper.py", tree / "formats/trial_caller.py"
    caller.write_text(CALLER)
    code = "from vlnpe.formats.trial_caller import caller\nprint(caller(1), end=' ')\n"
    code += "print(sum(caller.stats.cache_hits.values()))"
    results = []
    # Of another length, too: CPython takes a file of the same second and length for unchanged.
    for text in (HELPER, HELPER, HELPER.replace("x + 1", "x + 1 + 1")):
        helper.write_text(text)
        results.append(run_in(tree, code).split())
    helper.unlink()
    caller.unlink()
    assert results == [["2", "0"], ["2", "1"], ["3", "0"]]


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(tree):
    (tree / "formats/trial_twice.py").write_text(
        "from .process.kernel import kernel\n\n"
        "@kernel()\ndef twice(x):\n    return sorted([x, x])\n"
    )
    code = "from vlnpe.formats.trial_twice import twice\nprint('ready', flush=True)\ninput()\n"
    code += "twice(1)\nprint(sum(twice.stats.cache_hits.values()))"
    command = command_in(tree, code)
    pipe = subprocess.PIPE
    with (
        subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as one,
        subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other,
    ):
        assert {p.stdout.readline() for p in (one, other) if p.stdout} == {"ready\n"}
        for process in (one, other):
            assert process.stdin
            process.stdin.write("\n")
            process.stdin.flush()
        assert sorted(p.stdout.read() for p in (one, other) if p.stdout) == ["0\n", "1\n"]


@pytest.mark.parametrize(
    ("job", "library", "changes"),
    [
        (RepairJob(Path("a.glb"), Path("out"), RepairConfig()), "open3d", False),
        (RepairJob(Path("a.ply"), Path("out"), RepairConfig()), "open3d", True),
        (RepairJob(Path("a.glb"), Path("out"), RepairConfig()), "trimesh", True),
        (SplatRepairJob(Path("a.splat"), Path("out"), RepairConfig()), "msgpack", False),
        (SplatRepairJob(Path("a.usdz"), Path("out"), RepairConfig()), "msgpack", True),
        (ReplayJob(Path("s"), EPISODE, H1, Path("m"), Path("o")), EXTRA, False),
        (ReplayJob(Path("s"), EPISODE, H1, Path("m"), Path("o")), "onnx", False),
        (ReplayJob(Path("s"), EPISODE, H1, Path("m"), Path("o")), "mujoco", True),
    ],
)
def test_installing_a_library_repeats_only_work_that_may_use_it(
    monkeypatch: pytest.MonkeyPatch, job: Job, library: str, changes: bool
) -> None:
    keys = []
    for installed in (None, "1.0", "2.0"):
        versions = {library: installed}
        monkeypatch.setattr(source, "_version", lambda name, v=versions: v.get(name, "0"))
        monkeypatch.setattr(source, "_owners", lambda: {library: [library]})
        source.source_digest.cache_clear()
        keys.append(work_item("stage", "item", job, (Path("out"),)).key)
    monkeypatch.undo()
    source.source_digest.cache_clear()
    assert len(set(keys)) == (3 if changes else 1)
