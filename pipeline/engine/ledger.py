"""What a run has done: one row per work item, safe against being killed at any moment.

`manifest.json` holds the rows; while a run is going, each finished item is appended to
`manifest.journal.jsonl` at once (rewriting the manifest per item would cost quadratic time), and
folded into the manifest at the next `save`.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Collection
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from ...formats.core.atomic import write_json
from ...formats.core.errors import FileFormatError

MANIFEST_NAME = "manifest.json"
JOURNAL_NAME = "manifest.journal.jsonl"
QUARANTINE_NAME = "quarantine.json"

Status = Literal["done", "quarantined"]


@dataclass(frozen=True)
class Row:
    """The outcome of one work item.

    Attributes:
        stage, item: which one.
        key: digest of config, inputs and code that made it.
        status: `done`, or `quarantined` when it raised.
        failed: done, but with a bad outcome (a fall, a stuck robot): data, and counted apart.
        outputs: produced files and folders, relative to the ledger's folder.
        seconds: wall time it took.
        facts: whatever later stages and the report want to know (JSON values).
        error: `type` and `reason` of a quarantined item.
        current: whether the latest run asked for it. Rows of earlier options stay, so that going
            back to them costs nothing, but the report and the counts leave them out.
    """

    stage: str
    item: str
    key: str
    status: Status
    failed: bool = False
    outputs: tuple[str, ...] = ()
    seconds: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)
    error: dict[str, str] = field(default_factory=dict)
    current: bool = True


class Ledger:
    """Rows of one folder, by (stage, item)."""

    def __init__(self, root: Path):
        """Open the ledger in `root`; a missing one is empty.

        Raises:
            FileFormatError: the manifest is not one of ours.
        """
        self.root = root
        self._rows: dict[tuple[str, str], Row] = {}
        manifest = root / MANIFEST_NAME
        if manifest.exists():
            try:
                rows = json.loads(manifest.read_text())["rows"]
                for row in rows:
                    self._keep(_row(row))
            except (KeyError, TypeError, ValueError) as error:
                raise FileFormatError(manifest, f"not a vlnpe manifest: {error!r}") from error
        journal = root / JOURNAL_NAME
        if journal.exists():
            for line in journal.read_text().splitlines():
                try:
                    self._replay(json.loads(line))
                except (KeyError, TypeError, ValueError):
                    continue  # a killed run's last line may be cut short: its item runs again

    @staticmethod
    def existing(root: Path) -> Ledger:
        """Open an existing ledger: in `root`, or in the run folder that contains `root`.

        Raises:
            FileFormatError: `root` holds no run, and is no part of one.
        """
        for folder in (root, root.absolute().parent):
            if any((folder / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME)):
                return Ledger(folder)
        raise FileFormatError(root, f"no run here ({MANIFEST_NAME} is missing)")

    def rows(self, stage: str | None = None) -> list[Row]:
        """Return the current rows of all stages or of one, in item order."""
        found = [self._rows[k] for k in sorted(self._rows) if stage in (None, k[0])]
        return [row for row in found if row.current]

    def select(self, stage: str, scope: str, names: Collection[str]) -> None:
        """Make `names` the current items of a stage among those that start with `scope`."""
        for (row_stage, item), row in self._rows.items():
            if row_stage == stage and item.startswith(scope):
                self._rows[(row_stage, item)] = replace(row, current=item in names)

    def row(self, stage: str, item: str) -> Row | None:
        """Return the row of one item, or None."""
        return self._rows.get((stage, item))

    def is_done(self, stage: str, item: str, key: str) -> bool:
        """Return whether the item was done under this key and its outputs still exist."""
        row = self.row(stage, item)
        return (
            row is not None
            and row.status == "done"
            and row.key == key
            and all((self.root / path).exists() for path in row.outputs)
        )

    def add(self, row: Row) -> None:
        """Record a finished item durably."""
        self._keep(row)
        self._append([asdict(row)])

    def forget(self, stage: str, items: Collection[str]) -> None:
        """Drop rows durably before their outputs are replaced.

        Otherwise a run killed between the new output and its row would leave new content under
        the old key, and going back to the old options would take it for theirs.
        """
        known = [item for item in items if (stage, item) in self._rows]
        for item in known:
            del self._rows[(stage, item)]
        if known:
            self._append([{"forget": [stage, item]} for item in known])

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
        kept = {path for row in self._rows.values() for path in row.outputs}
        for path in {path for row in old.values() for path in row.outputs} - kept:
            if (self.root / path).is_dir():
                shutil.rmtree(self.root / path)
            else:
                (self.root / path).unlink(missing_ok=True)
        if old:
            self.save()

    def save(self) -> None:
        """Fold the journal into the manifest, and list what is quarantined."""
        rows = [asdict(self._rows[k]) for k in sorted(self._rows)]
        write_json(self.root / MANIFEST_NAME, {"rows": rows})
        bad = [
            {"stage": r.stage, "item": r.item, **r.error}
            for r in self.rows()
            if r.status == "quarantined"
        ]
        write_json(self.root / QUARANTINE_NAME, {"count": len(bad), "items": bad})
        (self.root / JOURNAL_NAME).unlink(missing_ok=True)

    def _append(self, lines: list[dict[str, Any]]) -> None:
        with (self.root / JOURNAL_NAME).open("a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")  # after a line that a kill cut short
            for line in lines:
                stream.write(json.dumps(line, allow_nan=False).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())

    def _replay(self, line: dict[str, Any]) -> None:
        if "forget" in line:
            stage, item = line["forget"]
            self._rows.pop((stage, item), None)
        else:
            self._keep(_row(line))

    def _keep(self, row: Row) -> None:
        self._rows[(row.stage, row.item)] = row


def _row(value: dict[str, Any]) -> Row:
    return Row(**{**value, "outputs": tuple(value["outputs"])})
