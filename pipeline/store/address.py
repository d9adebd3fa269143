"""Addresses of run folders in an object store, and the local folder that each is worked on in."""

import hashlib
import os
import re
from pathlib import Path

from ..engine.run_folder import safe_name

SCRATCH_VARIABLE = "VLNPE_SCRATCH"
MARKER_NAME = ".vlnpe-store.json"  # in the scratch folder: what the store held at last


def store_url(path: Path | str) -> str | None:
    """Return the URL that a path from the command line stands for; None for a local path.

    `pathlib` writes `s3://bucket/run` as `s3:/bucket/run`, and options hold paths.
    """
    match = re.fullmatch(r"([a-z][a-z0-9+.-]+):/{1,2}([^/].*?)/*", str(path))
    return f"{match[1]}://{match[2]}" if match else None


def scratch_folder(url: str) -> Path:
    """Return the local folder in which a run folder of a store is worked on.

    It lies in the folder that `VLNPE_SCRATCH` names, by default in the user's cache.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    base = os.environ.get(SCRATCH_VARIABLE)
    folder = Path(base) if base else cache / "vlnpe" / "scratch"
    digest = hashlib.sha256(url.encode()).hexdigest()[:12]
    return folder.absolute() / digest / safe_name(url.rsplit("/", 1)[-1])
