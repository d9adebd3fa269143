"""The outcomes of work items: one as the ledger keeps it, and a stage's counts of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Status = Literal["done", "quarantined"]


@dataclass(frozen=True)
class Row:
    """The outcome of one work item.

    Attributes:
        key: digest of config, inputs and code that made it.
        status: `done`, or `quarantined` when it raised.
        failed: done, but with a bad outcome (a fall, a stuck robot): data, and counted apart.
        outputs: produced files and folders, relative to the ledger's folder.
        seconds: wall time it took.
        cpu_seconds: CPU time it took, of all threads; 0 in rows written before it was kept.
        compile_seconds: wall time of it in which numba compiled kernels.
        facts: whatever later stages and the report want to know (JSON values).
        error: `type` and `reason` of a quarantined item.
        current: whether the latest run asked for it. Rows of earlier options stay, so that going
            back to them costs nothing, but the report and the counts leave them out.
        parts: digests of what it was made of, by name; see `explain`.
    """

    stage: str
    item: str
    key: str
    status: Status
    failed: bool = False
    outputs: tuple[str, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    compile_seconds: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)
    error: dict[str, str] = field(default_factory=dict)
    current: bool = True
    parts: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def parse(value: Mapping[str, Any]) -> "Row":
        """Return a row from JSON values."""
        return Row(**{**value, "outputs": tuple(value["outputs"])})


@dataclass
class StageSummary:
    """Counts of one stage's run; `rows` are all its items' rows, reused ones too.

    `done` counts what this run did, `reused` what it found done; `failed` those of both with a bad
    outcome.
    """

    stage: str
    done: int = 0
    reused: int = 0
    failed: int = 0
    quarantined: int = 0
    seconds: float = 0.0
    rows: list[Row] = field(default_factory=list)
    compile_seconds: float = 0.0

    def counts(self) -> dict[str, int | float]:
        """Return plain numbers for tables and `--json`."""
        counts = {name: getattr(self, name) for name in ("done", "reused", "failed", "quarantined")}
        return counts | {"seconds": round(self.seconds, 2)}

    def joined(self, other: "StageSummary") -> "StageSummary":
        """Return both runs of one stage (for two robots, …) as one."""
        return StageSummary(
            self.stage,
            self.done + other.done,
            self.reused + other.reused,
            self.failed + other.failed,
            self.quarantined + other.quarantined,
            self.seconds + other.seconds,
            [*self.rows, *other.rows],
            self.compile_seconds + other.compile_seconds,
        )

    def good(self) -> dict[str, Row]:
        """Return the rows of items that are done, by item name."""
        return {r.item: r for r in self.rows if r.status == "done"}

    def count(self, row: Row) -> None:
        """Add an item that this run did."""
        self.rows.append(row)
        self.compile_seconds += row.compile_seconds
        self.done += row.status == "done"
        self.failed += row.failed
        self.quarantined += row.status == "quarantined"

    def quarantined_episode(self, name: str, kind: str, reason: str) -> Row:
        """Add an episode that the stage cannot use; return its row, for the ledger."""
        error = {"type": kind, "reason": reason}
        row = Row(self.stage, f"episode {name}", "", "quarantined", error=error)
        self.count(row)
        return row
