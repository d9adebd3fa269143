"""Paths in a run folder, and names of files."""

import errno
import hashlib
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from ...formats.core.errors import InputError

_SEEN_SUFFIX = ".seen.json"
MINIMUM_FREE_BYTES = 256 * 1024**2


def safe_name(text: str) -> str:
    """Return `text` as a file name: anything but letters, digits, `.`, `_`, `-` becomes `-`."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-.") or "unnamed"


MAX_NAME_BYTES = 150  # of 255 that file systems allow; suffixes and temporary names come on top


def file_name(text: str) -> str:
    """Return a file name that no other text has; texts that `safe_name` keeps stay as they are.

    Other characters become their UTF-8 bytes as `%2F`. Very long texts end with their digest.
    """
    if text == safe_name(text) and len(text) <= MAX_NAME_BYTES:
        return text
    quoted = quote(text, safe="").replace("~", "%7E")
    # Hidden names, `..`, and what Windows cuts off.
    for end in ("-", "."):
        quoted = re.sub(rf"^\{end}|\{end}$", f"%{ord(end):02X}", quoted)
    if len(quoted) > MAX_NAME_BYTES:
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        return f"{quoted[:MAX_NAME_BYTES]}~{digest}"
    return quoted or "~"


def file_names(texts: Sequence[str]) -> list[str]:
    """Return a file name for each of several different texts, also where case is ignored.

    Texts that differ in case alone get their capitals as bytes; one without capitals stays.
    """
    names = [file_name(text) for text in texts]
    count = Counter(name.casefold() for name in names)
    return [
        name if count[name.casefold()] == 1 else re.sub(r"(?<!%)(?<!%.)[A-Z]", _as_byte, name)
        for name in names
    ]


def _as_byte(letter: re.Match[str]) -> str:
    return f"%{ord(letter[0]):02X}"


@dataclass(frozen=True)
class SightFiles:
    """The records of what is seen along paths, and named in scenes, in one folder.

    In a run this is its folder of facts; beside a single output it is that of its ledger.
    """

    folder: Path

    def seen(self, share: str) -> Path:
        """Return what the robot's camera sees along the paths of a scene, or a split of it."""
        return self.folder / f"{share}{_SEEN_SUFFIX}"

    def named(self, scene: str) -> Path:
        """Return what a vision-language model names in a scene without labels."""
        return self.folder / f"{scene}{_named_suffix()}"

    def all_seen(self) -> list[Path]:
        """Return every record of what is seen that is there."""
        return sorted(self.folder.glob(f"*{_SEEN_SUFFIX}"))

    def all_named(self) -> list[Path]:
        """Return every record of what is named that is there."""
        return sorted(self.folder.glob(f"*{_named_suffix()}"))


def _named_suffix() -> str:
    # Only now, because it imports numerical libraries, which `--help` must not wait for.
    from ...instruction_gen.facts.named import SUFFIX

    return SUFFIX


@dataclass(frozen=True)
class RunFolder:
    """Paths in the folder of one run; see docs/design/architecture.md."""

    root: Path

    def scan(self, scene: str) -> Path:
        """Return the folder of a generated scan."""
        return self.root / "scans" / scene

    @property
    def scenes(self) -> Path:
        """Folder of repaired scenes."""
        return self.root / "scenes"

    def episodes(self, name: str) -> Path:
        """Return an episode file."""
        return self.root / "episodes" / f"{name}.json.gz"

    @property
    def sights(self) -> SightFiles:
        """Records of things seen along the paths, and of names in scenes without labels."""
        return SightFiles(self.root / "facts")

    def facts(self, scene: str) -> Path:
        """Return the facts records of the paths of a scene."""
        return self.root / "facts" / f"{scene}.json.gz"

    @property
    def models(self) -> Path:
        """Compiled physics models, kept for the next worker and the next run."""
        return self.root / "models"

    @property
    def rollouts(self) -> Path:
        """Rollouts, by robot and controller."""
        return self.root / "rollouts"

    @property
    def frames(self) -> Path:
        """Rendered frames, by robot, controller and view."""
        return self.root / "frames"

    @property
    def report(self) -> Path:
        """The report page's folder."""
        return self.root / "report"


def open_run_folder(root: Path) -> RunFolder:
    """Create the run folder."""
    existing = root
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"output folder {root}: {existing} is a file; choose another --out")
    created = [p for p in (root, *root.parents) if p != existing and p.is_relative_to(existing)]
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=root, prefix=".vlnpe-"):
            pass
        free = shutil.disk_usage(root).free
        if free < MINIMUM_FREE_BYTES:
            for folder in created:
                folder.rmdir()
            raise InputError(
                f"output folder {root}: only {free / 1024**2:.0f} MiB free on its disk; "
                f"at least {MINIMUM_FREE_BYTES // 1024**2} MiB are needed"
            )
    except OSError as error:
        reason = error.strerror or errno.errorcode.get(error.errno or 0, "unknown")
        raise InputError(
            f"output folder {root}: {existing} is not writable ({reason}); choose another --out"
        ) from error
    return RunFolder(root.resolve())
