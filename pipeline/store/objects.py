"""One folder of an object store: read, write and remove its objects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ...formats.core.errors import InputError, MissingExtraError
from .address import VALID

T = TypeVar("T")


class StoreError(InputError):
    """An object store cannot be used."""


@dataclass(frozen=True)
class ObjectFolder:
    """A folder of an object store; names are relative to it, with `/` between their parts.

    Attributes:
        files: File system of fsspec.
    """

    url: str
    files: Any
    path: str

    @staticmethod
    def open(url: str) -> "ObjectFolder":
        """Connect to the store of a URL."""
        scheme = url.split("://", maxsplit=1)[0]
        try:
            import fsspec

            files, path = fsspec.core.url_to_fs(url)
        except ImportError as error:
            if scheme in ("s3", "s3a") or error.name == "fsspec":
                raise MissingExtraError(url, "s3") from error
            raise StoreError(f"{url}: {error}") from error
        except ValueError as error:
            raise StoreError(f"{url}: {error}; valid: {VALID}") from error
        return ObjectFolder(url, files, path.rstrip("/"))

    def read(self, name: str) -> bytes | None:
        """Return an object's content; None if there is none of that name."""
        return self._try(lambda: self.files.cat_file(self._full(name)), missing=None)

    def write(self, name: str, content: bytes) -> None:
        """Write an object, replacing an earlier one."""
        self._make_folders([name])
        self._try(lambda: self.files.pipe_file(self._full(name), content))

    def create(self, name: str, content: bytes) -> bool:
        """Write an object unless there is one of that name; return whether it was written."""
        self._make_folders([name])

        def attempt() -> bool:
            try:
                self.files.pipe_file(self._full(name), content, mode="create")
            except FileExistsError:
                return False
            return True

        return self._try(attempt)

    def upload(self, files: Mapping[str, Path]) -> None:
        """Write objects from local files, several at a time."""
        if files:
            self._make_folders(files)
            sources = [str(path) for path in files.values()]
            targets = [self._full(name) for name in files]
            self._try(lambda: self.files.put(sources, targets))

    def download(self, files: Mapping[str, Path]) -> None:
        """Read objects into local files, several at a time."""
        if files:
            for path in files.values():
                path.parent.mkdir(parents=True, exist_ok=True)
            sources = [self._full(name) for name in files]
            targets = [str(path) for path in files.values()]
            self._try(lambda: self.files.get(sources, targets))

    def remove(self, names: Sequence[str]) -> None:
        """Remove objects; those that do not exist are no error."""
        for name in names:
            self._try(lambda name=name: self.files.rm_file(self._full(name)), missing=None)

    def names(self) -> list[str]:
        """Return the names of all objects."""
        return sorted(self.sizes())

    def sizes(self) -> dict[str, int | None]:
        """Return the size of each object [bytes] by its name; None where the store has no sizes."""
        listed = self._try(lambda: self.files.find(self.path, detail=True), missing={})
        return {
            name.removeprefix(f"{self.path}/"): entry.get("size") for name, entry in listed.items()
        }

    def _full(self, name: str) -> str:
        return f"{self.path}/{name}"

    def _make_folders(self, names: Sequence[str] | Mapping[str, Path]) -> None:
        """Create the folders of objects where the store has folders; S3 has none."""
        for folder in {self._full(name).rpartition("/")[0] for name in names}:
            if "s3" not in self.files.protocol:  # there it would try to create the bucket
                self._try(lambda folder=folder: self.files.makedirs(folder, exist_ok=True))

    def _try(self, action: Callable[[], T], **if_missing: Any) -> T:
        """Return what `action` returns, or `missing` where the object does not exist."""
        try:
            return action()
        except FileNotFoundError as error:
            if "missing" in if_missing:
                return if_missing["missing"]
            raise StoreError(f"{self.url}: {error or 'not found'}") from error
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            if "credentials" in reason.lower():
                reason += ": set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
            raise StoreError(f"{self.url}: {reason}") from error
