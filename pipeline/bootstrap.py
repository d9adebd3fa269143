"""Install vlnpe's environment into `.venv`, from the committed lock; Python 3.6 or newer runs this.

uv is taken from `.tools` or PATH, or else installed into `.tools`. It uses a Python 3.12 or 3.13
on PATH or of pyenv, or fetches one. A stamp of the lock makes every further call a no-op.

usage: python3 pipeline/bootstrap.py core|test|full [extra,...]   (VERBOSE=1 shows the packages)
"""

import glob
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from urllib.request import Request, urlopen

ROOT = Path(__file__).resolve().parents[1]
TOOLS, ENVIRONMENT = ROOT / ".tools", ROOT / ".venv"
UV, UV_MINIMUM = "uv==0.13.8", (0, 8)
PIP = "pip-24.3.1-py3-none-any.whl"  # runs from its wheel where Python came without pip
# Core and test never remove what `full` has installed.
SYNC = {"core": ["--inexact"], "test": ["--inexact", "--group", "test"]}
SYNC["full"] = ["--all-extras", "--group", "dev"]


def output(*command):
    """Return what a command prints; empty if it cannot run or fails."""
    try:
        return subprocess.check_output(command, stderr=subprocess.DEVNULL).decode().strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def find_uv():
    """Return a uv that is new enough, installed into `.tools` if need be."""
    own = str(TOOLS / "bin" / "uv")
    for uv in (own, "uv", str(Path.home() / ".local" / "bin" / "uv")):
        version = output(uv, "--version").split()[1:2]
        if version and tuple(map(int, version[0].split(".")[:2])) >= UV_MINIMUM:
            return uv
    pip = [sys.executable, "-m", "pip"]
    if not output(*pip, "--version"):
        pip = [sys.executable, str(download_pip() / "pip")]
    subprocess.check_call([*pip, "install", "-q", "--target", str(TOOLS), UV])
    return own


def download_pip():
    """Return the wheel of pip, fetched from PyPI and checked."""
    accept = {"Accept": "application/vnd.pypi.simple.v1+json"}
    files = json.loads(urlopen(Request("https://pypi.org/simple/pip/", headers=accept)).read())
    (entry,) = (file for file in files["files"] if file["filename"] == PIP)
    data = urlopen(entry["url"]).read()
    if hashlib.sha256(data).hexdigest() != entry["hashes"]["sha256"]:
        sys.exit("setup: the downloaded %s does not match its SHA-256" % PIP)
    TOOLS.mkdir(exist_ok=True)
    (TOOLS / PIP).write_bytes(data)
    return TOOLS / PIP


def find_python():
    """Return a Python 3.12 or 3.13, on PATH or of pyenv; empty if there is none."""
    pyenv = os.environ.get("PYENV_ROOT") or str(Path.home() / ".pyenv")
    versions = sorted(glob.glob(pyenv + "/versions/3.1[23].*/bin/python3"))
    test = "import sys; print(sys.executable if (3, 12) <= sys.version_info < (3, 14) else '')"
    names = ("python3.12", "python3.13", "python3", *versions)
    return next(filter(None, (output(name, "-c", test) for name in names)), "")


def main(kind="", extras="", *further):
    """Bring `.venv` to the state of the lock; exit with what went wrong otherwise."""
    if kind not in SYNC or further:
        sys.exit((__doc__ or "").split("\n\n")[-1].strip())
    names = sorted(extras.replace(",", " ").split())
    files = (ROOT / "uv.lock", ROOT / "pyproject.toml", Path(__file__))
    state = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    # In the environment, so that whoever deletes it deletes the stamp, too.
    own, *others = (ENVIRONMENT / (".vlnpe-" + n) for n in ("-".join([kind, *names]), "full"))
    if any(stamp.is_file() and stamp.read_text() == state for stamp in (own, *others)):
        return
    uv, python = find_uv(), os.environ.get("UV_PYTHON") or find_python()
    what = "setup: %s with %s\n" % (" and ".join([kind, *names]), python or "a Python of uv's")
    sys.stderr.write(what)
    command = [uv, "sync", "--frozen", "--project", str(ROOT), *SYNC[kind]]
    command += [word for name in names for word in ("--extra", name)]
    command += [] if os.environ.get("VERBOSE") else ["--quiet"]
    environment = {name: v for name, v in os.environ.items() if name != "VIRTUAL_ENV"}
    if subprocess.call(command, env={**environment, **({"UV_PYTHON": python} if python else {})}):
        sys.exit("setup: uv failed; VERBOSE=1 shows what it did")
    link = (
        ENVIRONMENT / "types" / "vlnpe"
    )  # pyright finds the package, whatever the checkout's name
    if not link.exists():
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(Path("..", ".."))
    own.write_text(state)


if __name__ == "__main__":
    main(*sys.argv[1:])
