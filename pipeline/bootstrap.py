#!/usr/bin/env python
"""Set up the project's environment on a machine that has only a Python, whichever it is.

Runs before anything is installed and on any interpreter from 2.7 on, hence the old syntax: finds
or installs uv, finds a Python 3.12 or 3.13 (on PATH, or under pyenv's `versions/`, which need not
be on PATH) or lets uv fetch one, then syncs the committed lock into `.venv`. A stamp of the lock
makes every further call a no-op. What uv says is shown in full if it fails, or if the environment
variable VERBOSE is set.

usage: python pipeline/bootstrap.py core|test|full [extra,...]
"""

from __future__ import print_function

import difflib
import glob
import hashlib
import json
import os
import platform
import re
import stat
import subprocess
import sys
import zipfile

try:
    from urllib.request import urlopen
except ImportError:  # Python 2
    from urllib2 import urlopen  # pyright: ignore[reportMissingImports]

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TOOLS = os.path.join(ROOT, ".tools")
UV_VERSION = "0.13.8"
UV_MINIMUM = (0, 8)
PYTHONS = ((3, 12), (3, 13))
SYNC = {
    "core": ["--inexact"],  # never removes what `full` has already installed
    "test": ["--inexact", "--group", "test"],
    "full": ["--all-extras", "--group", "dev"],
}


def say(message):
    print("setup: " + message, file=sys.stderr)


def output_of(command):
    """Return the standard output of a command, or None if it cannot run or fails."""
    try:
        with open(os.devnull, "w") as null:
            return subprocess.check_output(command, stderr=null).decode("utf-8", "replace").strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def executable(*parts):
    name = os.path.join(*parts)
    return name + ".exe" if os.name == "nt" else name


def uv_works(path):
    text = output_of([path, "--version"])
    if not text:
        return False
    try:
        return tuple(int(p) for p in text.split()[1].split(".")[:2]) >= UV_MINIMUM
    except (IndexError, ValueError):
        return False


def wheel_tags():
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    if sys.platform == "darwin":
        return ["macosx", "arm64" if machine == "aarch64" else machine]
    if os.name == "nt":
        return ["win", "amd64" if machine == "x86_64" else "arm64"]
    libc = "manylinux" if platform.libc_ver()[0] == "glibc" else "musllinux"
    return [libc, machine]


def download_uv():
    """Unpack uv from its wheel on PyPI with the standard library alone, checked by its SHA-256."""
    with_tags = wheel_tags()
    page = json.loads(
        urlopen("https://pypi.org/pypi/uv/%s/json" % UV_VERSION).read().decode("utf-8")
    )
    for entry in page["urls"]:
        name = entry["filename"]
        if name.endswith(".whl") and all(tag in name for tag in with_tags):
            break
    else:
        raise RuntimeError("PyPI has no uv wheel for " + " ".join(with_tags))
    data = urlopen(entry["url"]).read()
    if hashlib.sha256(data).hexdigest() != entry["digests"]["sha256"]:
        raise RuntimeError("the downloaded uv wheel does not match its SHA-256")
    wheel = os.path.join(TOOLS, name)
    with open(wheel, "wb") as stream:
        stream.write(data)
    target = executable(TOOLS, "bin", "uv")
    folder = os.path.dirname(target)
    if not os.path.isdir(folder):
        os.makedirs(folder)
    archive = zipfile.ZipFile(wheel)
    for member in archive.namelist():
        if os.path.splitext(os.path.basename(member))[0] in ("uv", "uvx"):
            path = os.path.join(folder, os.path.basename(member))
            with open(path, "wb") as stream:
                stream.write(archive.read(member))
            os.chmod(path, os.stat(path).st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
    archive.close()
    os.remove(wheel)
    return target


def find_uv():
    candidates = [
        executable(TOOLS, "bin", "uv"),
        executable("uv"),
        executable(os.path.expanduser("~"), ".local", "bin", "uv"),
        executable(os.path.expanduser("~"), ".cargo", "bin", "uv"),
    ]
    for path in candidates:
        if uv_works(path):
            return path
    if not os.path.isdir(TOOLS):
        os.makedirs(TOOLS)
    say("uv is not installed; installing uv %s into .tools" % UV_VERSION)
    # pip first, because it knows the user's package index and certificates.
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--no-warn-script-location", "--target", TOOLS, "uv==" + UV_VERSION]
    if output_of(command) is not None and uv_works(candidates[0]):
        return candidates[0]
    say("this Python has no working pip; downloading uv's wheel from PyPI")
    path = download_uv()
    if not uv_works(path):
        raise RuntimeError("the downloaded uv does not run: " + path)
    return path


def find_python():
    """Return a Python 3.12 or 3.13, even if it is not on PATH, or None to let uv fetch one."""
    if os.environ.get("UV_PYTHON"):
        return os.environ["UV_PYTHON"]
    candidates = ["python%d.%d" % version for version in PYTHONS] + ["python3", "python"]
    pyenv = os.environ.get("PYENV_ROOT") or os.path.join(os.path.expanduser("~"), ".pyenv")
    for version in PYTHONS:
        pattern = os.path.join(pyenv, "versions", "%d.%d.*" % version, "bin", "python3")
        candidates += sorted(glob.glob(pattern), reverse=True)
    question = "import sys; print('%d.%d|%s' % (sys.version_info[:2] + (sys.executable,)))"
    for candidate in candidates:
        answer = output_of([candidate, "-c", question])
        version, _, path = (answer or "").partition("|")
        if version in ("%d.%d" % v for v in PYTHONS) and os.path.exists(path):
            return path
    return None


def digest():
    """Return the digest of what the environment depends on: lock, package list and this script."""
    state = hashlib.sha256()
    for name in ("uv.lock", "pyproject.toml", os.path.join("pipeline", "bootstrap.py")):
        with open(os.path.join(ROOT, name), "rb") as stream:
            state.update(stream.read())
    return state.hexdigest()


def known_extras():
    """Return the names of the optional dependencies in pyproject.toml."""
    with open(os.path.join(ROOT, "pyproject.toml")) as stream:
        text = stream.read()
    section = text.partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    return re.findall(r"^([\w-]+) *=", section, re.M)


def sync(command, environment):
    """Run uv and return its exit code; on a terminal one line says what it is doing."""
    if os.environ.get("VERBOSE"):
        return subprocess.call(command, env=environment)
    uv = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    lines = []
    assert uv.stdout is not None
    for line in iter(uv.stdout.readline, b""):
        lines.append(line.decode("utf-8", "replace").rstrip())
        if sys.stderr.isatty() and not lines[-1].startswith(" "):
            sys.stderr.write("\r\033[K%s" % lines[-1][:79])
            sys.stderr.flush()
    code = uv.wait()
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    shown = lines if code else [line for line in lines if line.startswith("Installed ")]
    for line in shown:
        say(line)
    return code


def link_package():
    """Make the package importable for pyright: it is the checkout, whatever its folder's name."""
    link = os.path.join(ROOT, ".venv", "types", "vlnpe")
    if os.name == "posix" and not os.path.islink(link):
        os.makedirs(os.path.dirname(link))
        os.symlink(os.path.join("..", ".."), link)


def main(arguments):
    if not 1 <= len(arguments) <= 2 or arguments[0] not in SYNC:
        say("usage: python pipeline/bootstrap.py " + "|".join(sorted(SYNC)) + " [extra,...]")
        return 2
    kind = arguments[0]
    extras = sorted(filter(None, ",".join(arguments[1:]).split(",")))
    for extra in extras:
        if extra not in known_extras():
            near = difflib.get_close_matches(extra, known_extras(), 1, 0.7)
            hint = " (did you mean %s?)" % near[0] if near else ""
            say("unknown extra %s%s; valid: %s" % (extra, hint, ", ".join(known_extras())))
            return 2
    # The stamp lives in the environment: deleting `.venv` deletes it too.
    names = ("full", "-".join(arguments[:1] + extras))
    stamps = [os.path.join(ROOT, ".venv", ".vlnpe-" + name) for name in names]
    wanted = digest()
    for stamp in stamps:
        if os.path.exists(stamp):
            with open(stamp) as stream:
                if stream.read() == wanted:
                    return 0
    try:
        uv = find_uv()
        python = find_python()
        environment = dict(os.environ)
        environment.pop("VIRTUAL_ENV", None)
        if python:
            environment["UV_PYTHON"] = python
        what = "the %s environment" % kind + "".join(" and %s" % extra for extra in extras)
        say("syncing %s (%s)" % (what, python or "Python fetched by uv"))
        command = [uv, "sync", "--project", ROOT, "--frozen"] + SYNC[kind]
        for extra in extras:
            command += ["--extra", extra]
        code = sync(command, environment)
        if code == 0:
            link_package()
    except (RuntimeError, EnvironmentError) as error:
        say("failed: %s" % error)
        return 1
    if code == 0:
        with open(stamps[1], "w") as stream:
            stream.write(wanted)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
