"""Publish a LeRobot dataset or environment on the Hugging Face hub: plan, check, upload, tag."""

import hashlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..formats.convert.dataset import ROLLOUTS_PATH
from ..formats.core.atomic import TEMPORARY_PREFIX, file_digest
from ..formats.core.errors import FileFormatError, InputError, MissingExtraError, VlnpeError
from ..formats.core.licences import UNKNOWN, licence_id, may_pass_on, why_not
from ..formats.lerobot.episode_columns import EDITED_ADVICE
from ..formats.lerobot.info import read_info
from ..formats.lerobot.layout import CODEBASE_VERSION, PROVENANCE_PATH
from ..formats.untrusted.documents import read_json_object

CARD = "README.md"
REPO = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*/[A-Za-z0-9][A-Za-z0-9._-]*")
TAG = re.compile(r"[A-Za-z][A-Za-z0-9._-]{0,95}")
# LeRobot takes tags that look like versions to be versions of the format.
VERSION_LIKE = re.compile(r"v?\d+(\.\d+)*", re.IGNORECASE)
DATASET, ENV = "dataset", "model"  # kinds of repositories; LeRobot looks for env.py in the latter
# Files of an earlier release; replaced as a whole.
OURS = {
    DATASET: ["data/*", "meta/*", "videos/*", f"{ROLLOUTS_PATH.partition('/')[0]}/*", "*.png"],
    ENV: ["scenes/*", "robots/*"],
}


Hub = Any  # `huggingface_hub.HfApi`, or a stand-in


class HubError(VlnpeError):
    """The Hub refused the request, or could not be reached."""


@dataclass(frozen=True)
class Release:
    """A release that can be uploaded.

    Attributes:
        tag: of the release; it never moves.
        private: of a repository that does not exist yet.
        files: size [bytes] by path in the repository.
        content_sha256: of all paths and contents.
        refusals: why the scenes' licences do not let the data be published; empty when they do.
        kind: of the repository, `DATASET` or `ENV`.
    """

    root: Path
    repo: str
    tag: str
    private: bool
    files: Mapping[str, int]
    content_sha256: str
    refusals: tuple[str, ...]
    kind: str = DATASET

    @property
    def address(self) -> str:
        """Return the path of the repository on the hub."""
        return f"datasets/{self.repo}" if self.kind == DATASET else self.repo

    @property
    def url(self) -> str:
        """Return the address of the release."""
        endpoint = os.environ.get("HF_ENDPOINT", "https://huggingface.co").rstrip("/")
        return f"{endpoint}/{self.address}/tree/{self.tag}"

    @property
    def named_by_content(self) -> bool:
        """Return whether the tag derives from the content's digest."""
        return self.tag == content_tag(self.content_sha256)


@dataclass(frozen=True)
class Upload:
    """An uploaded release: its commit, and whether this call uploaded it."""

    commit: str
    new: bool


def content_tag(content_sha256: str) -> str:
    """Return the name of a release of this content."""
    return f"data-{content_sha256[:12]}"


def plan_release(root: Path, repo: str, tag: str | None = None, private: bool = False) -> Release:
    """Plan the release of a dataset without using the network.

    Args:
        tag: name of the release; by default one made of the content's digest.
    """
    read_info(root)
    if not (root / CARD).is_file():
        raise FileFormatError(
            root / CARD, f"missing; a dataset is not published without its card; {EDITED_ADVICE}"
        )
    path = root / PROVENANCE_PATH
    scenes = read_json_object(path).get("scenes") if path.is_file() else None
    return released(root, repo, tag, private, scenes=scenes, kind=DATASET)


def released(
    root: Path, repo: str, tag: str | None, private: bool, *, scenes: Any, kind: str
) -> Release:
    """Return the release of a folder; see `plan_release`.

    Args:
        scenes: Facts of the source of each scene by name, of which `licence` matters.
        kind: `DATASET` or `ENV`.

    Raises:
        InputError: If the Hub does not take a name.
    """
    if not REPO.fullmatch(repo):
        raise InputError(f"--repo {repo!r}: valid: user/name of letters, digits, '-', '_' and '.'")
    if tag is not None and (not TAG.fullmatch(tag) or VERSION_LIKE.fullmatch(tag)):
        raise InputError(
            f"--tag {tag!r}: valid: letters, digits, '-', '_' and '.', beginning with a letter, "
            "and not a version number, which LeRobot reads as its format version"
        )
    files = {path.relative_to(root).as_posix(): path.stat().st_size for path in _files(root)}
    content = _content(root, files)
    tag = tag or content_tag(content)
    return Release(root, repo, tag, private, files, content, _refusals(scenes), kind)


def demand_licence(release: Release) -> None:
    """Raise InputError when a scene's licence does not let the data be published."""
    if release.refusals:
        raise InputError(
            f"{release.root.name} is not published: {'; '.join(release.refusals)}. "
            "If you have the owners' permission, pass --licence-ok"
        )


def upload(release: Release, hub: Hub = None) -> Upload:
    """Upload a release as one commit, and tag it.

    The release's tag comes last: until it is there an interrupted upload is done again, and only
    files that are not on the hub yet travel. A release that is there already, named by its content,
    is left as it is.

    Args:
        hub: the hub; huggingface_hub's own client when None, which takes the token from HF_TOKEN or
            from `hf auth login`.

    Raises:
        HubError: the hub refused, or could not be reached.
    """
    hub = hub or _hub()
    kind = {"repo_type": release.kind}
    try:
        taken = _tags(hub, release) if hub.repo_exists(release.repo, **kind) else {}
        if release.tag in taken:
            if release.named_by_content:
                return Upload(taken[release.tag], new=False)
            raise InputError(
                f"{release.repo} already has a release {release.tag}, and releases never change; "
                "choose another --tag"
            )
        hub.create_repo(release.repo, private=release.private, exist_ok=True, **kind)
        commit = hub.upload_folder(
            repo_id=release.repo,
            folder_path=str(release.root),
            commit_message=f"Release {release.tag}",
            allow_patterns=list(release.files),
            delete_patterns=OURS[release.kind],
            **kind,
        ).oid
        # LeRobot looks for this tag; it names the format of the newest data, and moves with it.
        if release.kind == DATASET:
            if CODEBASE_VERSION in taken:
                hub.delete_tag(release.repo, tag=CODEBASE_VERSION, **kind)
            hub.create_tag(release.repo, tag=CODEBASE_VERSION, revision=commit, **kind)
        hub.create_tag(release.repo, tag=release.tag, revision=commit, **kind)
    except VlnpeError:
        raise
    except Exception as error:  # the client raises its own, httpx's and the system's
        raise HubError(f"{release.repo}: {_reason(error)}") from error
    return Upload(str(commit), new=True)


def _tags(hub: Hub, release: Release) -> dict[str, str]:
    """Return the commit of each tag."""
    refs = hub.list_repo_refs(release.repo, repo_type=release.kind).tags
    return {ref.name: str(ref.target_commit) for ref in refs}


def _reason(error: Exception) -> str:
    """Return what went wrong and what to do, in one line."""
    status = getattr(getattr(error, "response", None), "status_code", None)
    if status == 401:
        return "the Hub requires a token (401): set HF_TOKEN, or run `hf auth login`"
    if status == 403:
        return "the token has no write access there (403): use one that has"
    reason = " ".join(str(error).split())
    cause = error.__cause__
    if cause is not None and str(cause) not in reason:
        reason += f" ({type(cause).__name__}: {' '.join(str(cause).split())})"
    return (
        f"{type(error).__name__}: {reason}. The release is not complete; run the same command "
        "again to continue where it stopped"
    )


def _hub() -> Hub:
    if os.environ.get("HF_HUB_OFFLINE", "").upper() in {"1", "ON", "YES", "TRUE"}:
        raise InputError("HF_HUB_OFFLINE is set: nothing can be uploaded")
    try:
        from huggingface_hub import HfApi
    except ImportError as error:
        raise MissingExtraError("publishing on the hub", "train") from error
    return HfApi()


def _files(root: Path) -> list[Path]:
    """Return the dataset's files, without hidden and unfinished ones."""
    hidden = {TEMPORARY_PREFIX[0]}
    return [
        path
        for path in sorted(root.rglob("*"))
        if path.is_file() and not any(p[0] in hidden for p in path.relative_to(root).parts)
    ]


def _content(root: Path, files: Mapping[str, int]) -> str:
    state = hashlib.sha256()
    for name in sorted(files):
        state.update(f"{name}\0{file_digest(root / name)}\n".encode())
    return state.hexdigest()


def _refusals(scenes: Any) -> tuple[str, ...]:
    if not isinstance(scenes, dict) or not scenes:
        return (f"{PROVENANCE_PATH} names no scene, so {why_not(UNKNOWN)}",)
    licences = {
        name: licence_id(str((source or {}).get("licence") or ""))
        for name, source in scenes.items()
    }
    return tuple(
        f"scene {name}: {why_not(licence)}"
        for name, licence in licences.items()
        if not may_pass_on(licence)
    )
