"""What OpenGL can do here, asked in a process of its own.

Drivers may crash, and a context that was made before workers fork cannot be used in them.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from pathlib import Path

TIMEOUT_S = 60
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_ASK = """
import json, os, sys
try:
    from mujoco.egl import GLContext
    context = GLContext(16, 16)
    context.make_current()
    from OpenGL import GL
    name = GL.glGetString(GL.GL_RENDERER).decode()
    print(json.dumps({"renderer": name}))
except BaseException as error:
    said = str(error).strip().replace(chr(10), " ") or "no EGL device"
    print(json.dumps({"reason": f"{type(error).__name__}: {said}"}))
sys.stdout.flush()
os._exit(0)
"""


def graphics_card() -> str:
    """Name of the graphics card that EGL draws with; empty when there is none.

    Without any card's device file the question is not asked, since it takes a second.
    """
    devices = [*Path("/dev/dri").glob("renderD*"), *Path("/dev").glob("nvidia[0-9]*")]
    if not devices:
        return ""
    name = _answer().get("renderer", "")
    return "" if any(word in name.lower() for word in SOFTWARE) else name


def why_no_gl() -> str:
    """Why nothing can be drawn through EGL here; empty when something can, if only in software."""
    return _answer().get("reason", "")


@functools.cache
def _answer() -> dict[str, str]:
    environment = {**os.environ, "MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "egl"}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _ASK],
            env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"reason": f"EGL does not answer within {TIMEOUT_S} s"}
    try:
        return json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        tail = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        return {"reason": f"EGL ends the process that uses it ({tail[0]})"}
