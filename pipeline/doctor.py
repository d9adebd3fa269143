"""`vlnpe doctor`: what this machine can do, and the one command that adds what is missing."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from .executors import available_cores


@dataclass(frozen=True)
class Finding:
    """One line of the doctor: a subject, whether it is there, what was seen, how to add it."""

    subject: str
    good: bool
    seen: str
    remedy: str = ""


def examine(out: Path) -> list[Finding]:
    """Look at this machine; `out` is where runs would be written. Nothing is changed."""
    uv = find_uv()
    findings = [
        Finding("python", True, f"{platform.python_version()} at {sys.executable}"),
        Finding("cores", True, f"{available_cores()} usable, {_memory()}"),
        _disk(out),
        Finding("physics", True, f"MuJoCo {version('mujoco')}"),
        Finding(
            "renderer embree", True, f"embreex {version('embreex')} (no GPU or display needed)"
        ),
        _guarded("renderer gl", _gl, "install a GPU driver with EGL, or the system's libegl1"),
        _guarded("GPU", _gpu, ""),
        _guarded("video", _codecs, ""),
        _extra("train", ["torch", "lerobot", "rsl_rl", "onnx"], uv),
        _extra("scan", ["open3d"], uv),
        Finding("uv", uv is not None, uv or "not found", "" if uv else "make setup"),
    ]
    return findings


def _guarded(subject: str, look: Callable[[], str], remedy: str) -> Finding:
    try:
        return Finding(subject, True, look())
    except Exception as error:
        text = str(error).strip().splitlines()
        return Finding(subject, False, text[0] if text else type(error).__name__, remedy)


def _gl() -> str:
    # In a child process: a broken driver may abort the whole interpreter.
    code = (
        "import mujoco; c = mujoco.GLContext(64, 64); c.make_current();"
        "from OpenGL import GL; print(GL.glGetString(GL.GL_RENDERER).decode())"
    )
    environment = {"MUJOCO_GL": "egl", **os.environ}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env=environment,
        check=False,
    )
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no EGL"])[-1])
    return f"EGL through {done.stdout.strip().splitlines()[-1]}"


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
    free = shutil.disk_usage(folder).free / 1024**3
    writable = os.access(folder, os.W_OK)
    seen = f"{free:.1f} GiB free at {folder}" + ("" if writable else ", not writable")
    return Finding("disk", writable and free > 1, seen, "" if writable else "choose another OUT")


def _memory() -> str:
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return "memory unknown"
    return f"{total / 1024**3:.1f} GiB of memory"


def find_uv(tool: str = "uv") -> str | None:
    """Path of uv (or `uvx`): the user's, or the copy that the set-up keeps in .tools."""
    own = Path(__file__).resolve().parents[1] / ".tools" / "bin" / tool
    return shutil.which(tool) or (str(own) if own.is_file() else None)


def _extra(name: str, modules: list[str], uv: str | None) -> Finding:
    missing = [m for m in modules if importlib.util.find_spec(m) is None]
    if missing:
        remedy = f"{uv or 'uv'} sync --inexact --extra {name}"
        return Finding(f"extra {name}", False, f"without {', '.join(missing)}", remedy)
    return Finding(f"extra {name}", True, ", ".join(modules))
