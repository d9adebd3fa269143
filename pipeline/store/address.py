"""Addresses of run folders in an object store, and the local folder that each is worked on in."""

import hashlib
import os
import re
from pathlib import Path

from ...formats.core.checkout import user_cache
from ...formats.core.errors import InputError, brief
from ..engine.run_folder import safe_name

SCRATCH_VARIABLE = "VLNPE_SCRATCH"
VALID = "a local folder or s3://bucket/name"
_SCHEME = "[A-Za-z][A-Za-z0-9+.-]*"
MARKER_NAME = ".vlnpe-store.json"  # in the scratch folder: what the store held at last


def store_url(path: Path | str) -> str | None:
    """Return the URL that a path from the command line stands for; None for a local path.

    `pathlib` writes `s3://bucket/run` as `s3:/bucket/run`, and options hold paths.
    """
    url = re.fullmatch(rf"({_SCHEME}):(?:/{{1,2}}([^/].*?))?/*", str(path), re.DOTALL)
    if url is None:
        return None
    scheme, place = url[1].lower(), url[2] or ""
    if len(scheme) == 1 or not place or not place.isprintable():
        raise InputError(f"{brief(str(path))}: not the URL of a folder; valid: {VALID}")
    return f"{scheme}://{place}"


def without_password(text: str) -> str:
    """Return a text with `…` in the place of the password of a URL in it."""
    return re.sub(rf"({_SCHEME}:/{{1,2}}[^/:@]*:).*@", r"\1…@", text, flags=re.DOTALL)


def scratch_folder(url: str) -> Path:
    """Return the local folder in which a run folder of a store is worked on.

    It lies in the folder that `VLNPE_SCRATCH` names, by default in the user's cache.
    """
    base = os.environ.get(SCRATCH_VARIABLE)
    folder = Path(base) if base else user_cache() / "scratch"
    digest = hashlib.sha256(url.encode()).hexdigest()[:12]
    return folder.absolute() / digest / safe_name(url.rsplit("/", 1)[-1])
