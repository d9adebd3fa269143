"""What the stand-in for the Hugging Face hub holds: repositories, commits, files."""

import hashlib
import threading
from dataclasses import dataclass, field
from typing import Any

LARGE = (".parquet", ".mp4", ".png", ".mcap")  # kept as LFS objects


@dataclass(frozen=True)
class Entry:
    """A file of a commit."""

    data: bytes
    large: bool

    @property
    def git_oid(self) -> str:
        return hashlib.sha1(b"blob %d\0" % len(self.data) + self.data).hexdigest()

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.data).hexdigest()

    @property
    def etag(self) -> str:
        return self.sha256 if self.large else self.git_oid

    def info(self, path: str) -> dict[str, Any]:
        value = {"type": "file", "path": path, "size": len(self.data), "oid": self.git_oid}
        if self.large:
            value["lfs"] = {"oid": self.sha256, "size": len(self.data), "pointerSize": 130}
        return value


@dataclass
class Repo:
    """A data set's repository with one branch, main."""

    private: bool
    commits: dict[str, dict[str, Entry]] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    tags: dict[str, str] = field(default_factory=dict)
    head: str = ""

    def commit(self, files: dict[str, Entry], message: str) -> str:
        listed = "".join(f"{path} {entry.etag}\n" for path, entry in sorted(files.items()))
        text = f"{self.head}\n{message}\n{listed}"
        self.head = hashlib.sha1(text.encode()).hexdigest()
        self.commits[self.head] = files
        self.messages.append(message)
        return self.head

    def resolve(self, revision: str) -> str | None:
        if revision == "main":
            return self.head
        return self.tags.get(revision, revision if revision in self.commits else None)


@dataclass
class Hub:
    """State of the stand-in.

    Attributes:
        repos: by `user/name`.
        blobs: uploaded LFS objects by SHA-256.
        calls: `METHOD path` of all requests, in order.
        unknown: of those that it does not know.
        drops: (method, part of a path) of requests whose connection is cut halfway, each once.
    """

    url: str = ""
    repos: dict[str, Repo] = field(default_factory=dict)
    blobs: dict[str, bytes] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    drops: list[tuple[str, str]] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def take_drop(self, method: str, path: str) -> bool:
        with self.lock:
            for drop in self.drops:
                if drop[0] == method and drop[1] in path:
                    self.drops.remove(drop)
                    return True
        return False
