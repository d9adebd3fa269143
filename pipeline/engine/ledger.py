"""The record of a run: one row per work item, safe against being killed at any moment.

`manifest.json` holds the rows, and the size and SHA-256 of every file that they name; while a run
is going, each finished item is appended to `manifest.journal.jsonl` at once (rewriting the manifest
per item would cost quadratic time), and folded into the manifest at the next `save`. The manifest
and each line of the journal carry a checksum of their own.
"""

import os
import shutil
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ...formats.core.atomic import write_bytes
from ...formats.core.errors import FileFormatError, did_you_mean
from ...formats.core.journal import journal_line, parse_journal_line
from .checksums import json_text, read_signed, signed
from .files import FileRecord, Records, files_in, lost, path_in_run, records_of
from .rows import Row

MANIFEST_NAME = "manifest.json"
JOURNAL_NAME = "manifest.journal.jsonl"
QUARANTINE_NAME = "quarantine.json"


def _runs_in(folder: Path) -> list[str]:
    """Return the names of the runs directly in a folder."""
    return sorted(manifest.parent.name for manifest in folder.glob(f"*/{MANIFEST_NAME}"))


class Ledger:
    """Rows of one folder, by (stage, item), and records of its files, by output.

    Attributes:
        damaged_lines: Numbers of the journal's lines that cannot be used, from 1. A killed run
            leaves one at most, the last; the items of all of them run again.
        hashed: Whether the manifest was written by a version that keeps records of files.
        command: The command line that works in the folder, if it can be repeated.
        unfinished: The command line of a run that has begun work and not ended; empty without one.
        finished: The command line of the last run that has done work and ended; empty without one.
    """

    def __init__(self, root: Path):
        """Open the ledger in `root`; a missing one is empty."""
        self.root = root
        self._rows: dict[tuple[str, str], Row] = {}
        self._files: dict[str, Records] = {}
        self._values: dict[str, dict[str, str]] = {}
        self.hashed = True
        self.command = self.unfinished = self.finished = ""
        self.damaged_lines: list[int] = []
        manifest = root / MANIFEST_NAME
        if manifest.exists():
            try:
                content = read_signed(manifest)
                rows = [Row.parse(row) for row in content["rows"]]
                self._rows = {(row.stage, row.item): row for row in rows}
                self.hashed = "files" in content
                self._files = dict(content.get("files", {}))
                self._values = dict(content.get("parts", {}))
                self.unfinished = str(content.get("unfinished", ""))
                self.finished = str(content.get("finished", ""))
            except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
                raise FileFormatError(manifest, f"not a vlnpe manifest: {error!r}") from error
        journal = root / JOURNAL_NAME
        if journal.exists():
            lines = journal.read_bytes().split(b"\n")
            for number, line in enumerate(lines, start=1):
                try:
                    if line:
                        self._replay(parse_journal_line(line))
                except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
                    self.damaged_lines.append(number)

    @staticmethod
    def existing(root: Path) -> "Ledger":
        """Open an existing ledger: in `root`, or in the run folder that contains `root`."""
        for folder in (root, *root.absolute().parents[:2]):  # a dataset is two folders deep
            if any((folder / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME)):
                return Ledger(folder)
        if root.exists():
            runs = _runs_in(root)
            within = f"; runs in it: {', '.join(runs)}" if runs else ""
            raise FileFormatError(root, f"not a run folder ({MANIFEST_NAME} is missing){within}")
        raise FileFormatError(
            root, f"no such folder{did_you_mean(root.name, _runs_in(root.parent))}"
        )

    def rows(self, stage: str | None = None) -> list[Row]:
        """Return the current rows of all stages or of one, in item order."""
        return [row for row in self.all_rows(stage) if row.current]

    def done(self, stage: str | None = None) -> list[Row]:
        """Return the current rows of items that are done, in item order."""
        return [row for row in self.rows(stage) if row.status == "done"]

    def all_rows(self, stage: str | None = None) -> list[Row]:
        """Return the rows of all stages or of one, those of earlier options too, in item order."""
        return [self._rows[key] for key in sorted(self._rows) if stage in (None, key[0])]

    def records(self, row: Row) -> dict[str, Records]:
        """Return the records of the files of an item's outputs, by output."""
        return {output: self._files[output] for output in row.outputs if output in self._files}

    def relative(self, path: Path) -> str:
        """Return a path as rows name it."""
        return os.path.relpath(path, self.root)

    def select(self, stage: str, scope: str, names: Collection[str]) -> None:
        """Make `names` the current items of a stage among those that start with `scope`."""
        for (row_stage, item), row in self._rows.items():
            if row_stage == stage and item.startswith(scope):
                self._rows[(row_stage, item)] = replace(row, current=item in names)

    def row(self, stage: str, item: str) -> Row | None:
        """Return the row of one item, or None."""
        return self._rows.get((stage, item))

    def is_done(self, stage: str, item: str, key: str) -> bool:
        """Return whether the item was done under this key and nothing of it is lost."""
        row = self.row(stage, item)
        return row is not None and row.status == "done" and row.key == key and not self.lost(row)

    def lost(self, row: Row) -> str:
        """Return which file of an item's outputs is missing or resized; empty if none."""
        problems = (lost(self.root, path, self._files.get(path, {})) for path in row.outputs)
        return next(filter(None, problems), "")

    def begin(self) -> None:
        """Note durably that the command has work to do."""
        if self.command and self.unfinished != self.command:
            self.unfinished = self.command
            self._append([{"begun": self.command}])

    def add(self, row: Row, files: Mapping[str, Records] | None = None) -> None:
        """Record a finished item durably.

        Args:
            files: Records of the files of its outputs, by output.
        """
        self._rows[(row.stage, row.item)] = row
        self._files.update(files or {})
        self._append([{**asdict(row), **({"files": dict(files)} if files else {})}])

    def values(self) -> Mapping[str, Mapping[str, str]]:
        """Return the values of what items were made of, by digest; see `explain`."""
        return self._values

    def describe(self, values: Mapping[str, dict[str, str]]) -> None:
        """Keep the values of what items are made of, by digest."""
        new = {name: entry for name, entry in values.items() if entry and name not in self._values}
        if new:
            self._values.update(new)
            self._append([{"parts": new}])

    def record(self, outputs: Iterable[Path]) -> None:
        """Record files and folders that were written beside the items, durably."""
        files = {self.relative(path): records_of(path) for path in outputs}
        changed = {name: records for name, records in files.items() if records}
        if any(self._files.get(name) != records for name, records in changed.items()):
            self._files.update(changed)
            self._append([{"record": changed}])

    def unrecord(self, outputs: Iterable[Path]) -> None:
        """Drop the records of files and folders that were removed, durably."""
        names = [self.relative(path) for path in outputs]
        recorded = [name for name in names if self._files.pop(name, None) is not None]
        if recorded:
            self._append([{"unrecord": recorded}])

    def record_new(self, folder: Path) -> None:
        """Record the files in a folder that have no record yet, and drop the records of lost ones.

        For caches that workers add files to, and never change one.
        """
        paths = files_in(folder)
        self.record(p for p in paths if self.relative(p) not in self._files)
        below = f"{self.relative(folder)}/"
        recorded = [self.root / name for name in self._files if name.startswith(below)]
        self.unrecord(path for path in recorded if not path.exists())

    def files(self) -> dict[str, FileRecord]:
        """Return the record of every file, by its path relative to `root`."""
        try:
            return {
                path_in_run(output, name): FileRecord.parse(record)
                for output, records in self._files.items()
                for name, record in records.items()
            }
        except (AttributeError, TypeError, ValueError) as error:
            raise FileFormatError(
                self.root / MANIFEST_NAME, f"damaged file records: {error!r}"
            ) from error

    def forget(self, stage: str, items: Collection[str]) -> None:
        """Drop rows durably before their outputs are replaced.

        Otherwise a run killed between the new output and its row would leave new content under
        the old key, and going back to the old options would take it for theirs.
        """
        recorded = [item for item in items if (stage, item) in self._rows]
        self._drop(stage, recorded)
        if recorded:
            self._append([{"forget": [stage, recorded]}])

    def discard(self, stage: str, scope: str) -> None:
        """Delete rows and files of a stage's items that are not current and start with `scope`.

        For folders that are handed on as they are: nothing may lie in them that was not asked for.
        """
        old = {
            item: row
            for (row_stage, item), row in self._rows.items()
            if row_stage == stage and item.startswith(scope) and not row.current
        }
        self.forget(stage, old)
        current = {path for row in self._rows.values() for path in row.outputs}
        for path in {path for row in old.values() for path in row.outputs} - current:
            if (self.root / path).is_dir():
                shutil.rmtree(self.root / path)
            else:
                (self.root / path).unlink(missing_ok=True)
        if old:
            self.save()

    def save(self) -> None:
        """Fold the journal into the manifest, and list what is quarantined."""
        write_bytes(self.root / MANIFEST_NAME, self.manifest_text())
        write_bytes(self.root / QUARANTINE_NAME, self.quarantine_text())
        (self.root / JOURNAL_NAME).unlink(missing_ok=True)

    def manifest_text(self, without: Collection[str] = ()) -> bytes:
        """Return the content of the manifest.

        Args:
            without: Paths of files relative to `root`; outputs that have one of them are left out,
                and so are their rows.
        """
        left_out = {
            output
            for output, records in self._files.items()
            if without and any(path_in_run(output, name) in without for name in records)
        }
        rows = [row for row in self.all_rows() if left_out.isdisjoint(row.outputs)]
        files = {output: entry for output, entry in self._files.items() if output not in left_out}
        used = {digest for row in rows for digest in row.parts.values()}
        values = {digest: entry for digest, entry in self._values.items() if digest in used}
        content = {"files": files, "parts": values, "rows": [asdict(r) for r in rows]}
        commands = {"unfinished": self.unfinished, "finished": self.finished}
        return signed(json_text({**content, **{k: v for k, v in commands.items() if v}}))

    def finish(self) -> None:
        """End a run whose rows are saved; ledgers that are copied elsewhere complete the copy."""

    def quarantine_text(self) -> bytes:
        """Return the content of the list of quarantined items."""
        bad = [
            {"stage": r.stage, "item": r.item, **r.error}
            for r in self.rows()
            if r.status == "quarantined"
        ]
        return json_text({"count": len(bad), "items": bad})

    def _append(self, lines: list[dict[str, Any]]) -> None:
        with (self.root / JOURNAL_NAME).open("a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")  # after a line that a kill cut short
            for line in lines:
                stream.write(journal_line(line))
            stream.flush()
            os.fsync(stream.fileno())

    def _replay(self, line: dict[str, Any]) -> None:
        if "begun" in line:
            self.unfinished = str(line["begun"])
        elif "forget" in line:
            stage, items = line["forget"]
            self._drop(stage, [items] if isinstance(items, str) else items)
        elif "parts" in line and "stage" not in line:
            self._values.update(line["parts"])
        elif "unrecord" in line:
            for name in line["unrecord"]:
                self._files.pop(name, None)
        elif "record" in line:
            self._files.update(line["record"])
        else:
            files = line.pop("files", {})
            row = Row.parse(line)
            self._rows[(row.stage, row.item)] = row
            self._files.update(files)

    def _drop(self, stage: str, items: Iterable[str]) -> None:
        """Remove rows, and the records of outputs that no other row has."""
        outputs = {
            path
            for item in items
            if (row := self._rows.pop((stage, item), None))
            for path in row.outputs
        }
        if outputs:
            for row in self._rows.values():
                outputs.difference_update(row.outputs)
        for path in outputs:
            self._files.pop(path, None)
