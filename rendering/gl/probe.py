"""Probe of this machine's OpenGL, in a separate process.

Drivers may crash, and a context that is created before workers fork cannot be used in them.
"""

import functools
import json
import os
import subprocess
import sys
from pathlib import Path

TIMEOUT_S = 60
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")
_PROBE = """
import json, os, sys
try:
    from mujoco.egl import GLContext
    context = GLContext(16, 16)
    context.make_current()
    from OpenGL import GL
    name = GL.glGetString(GL.GL_RENDERER).decode()
    print(json.dumps({"renderer": name}))
except BaseException as error:
    message = str(error).strip().replace(chr(10), " ") or "no EGL device"
    print(json.dumps({"reason": f"{type(error).__name__}: {message}"}))
sys.stdout.flush()
os._exit(0)
"""


def graphics_card() -> str:
    """Return the name of the graphics card that EGL draws with; empty when there is none.

    Without a card's device file EGL is not started, since that takes a second.
    """
    devices = [*Path("/dev/dri").glob("renderD*"), *Path("/dev").glob("nvidia[0-9]*")]
    if not devices:
        return ""
    name = _answer().get("renderer", "")
    return "" if any(word in name.lower() for word in SOFTWARE) else name


def why_no_gl() -> str:
    """Return why EGL cannot draw on this machine; empty when it can, if only in software."""
    return _answer().get("reason", "")


@functools.cache
def _answer() -> dict[str, str]:
    environment = {**os.environ, "MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "egl"}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"reason": f"EGL does not respond within {TIMEOUT_S} s"}
    try:
        return json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        tail = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        return {"reason": f"EGL crashes the process that uses it ({tail[0]})"}
