"""The comparison of a recipe: policies trained on its mixtures, and their tests.

comparison:
  walks: 48                     # held-out episodes that each policy walks, at most
  tests:
    h1: {robot: h1, controller: speed}
  rows:                         # by default one per mixture
    h1: {mixture: h1}
    h1, twice the steps: {mixture: h1, train: {steps: 1200}}
    random: {policy: random}    # a policy of `vlnpe evaluate`, without training
  claims:
    - {text: more steps help, more: "h1, twice the steps", less: h1, metric: SR}
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...formats.core.errors import InputError, check_name

METRICS = ("SR", "OS", "SPL", "NE", "FR", "StR", "CR")  # columns of `evaluation.results`


@dataclass(frozen=True)
class Test:
    """Robot, controller and camera of a test, as `vlnpe evaluate` takes them.

    Attributes:
        robot, controller, light: their names.
        camera_height_m: above the floor; None for the robot's own.
        camera_pitch_deg: downward tilt; None for the robot's own.
    """

    __test__ = False  # not pytest's

    robot: str = "vlnce"
    controller: str = "auto"
    light: str = "baked"
    camera_height_m: float | None = None
    camera_pitch_deg: float | None = None


@dataclass(frozen=True)
class Row:
    """A policy that is compared.

    Attributes:
        mixture: what it is trained on; empty for a policy without training.
        policy: name of a policy of `vlnpe evaluate`; empty for a trained one.
        tests: names of its tests; all of the comparison by default.
        train: settings that override the recipe's.
    """

    mixture: str = ""
    policy: str = ""
    tests: tuple[str, ...] = ()
    train: Mapping[str, Any] = field(default_factory=dict)

    @property
    def varies(self) -> bool:
        """True if seeds differ: of a training, or of the draws of `random`."""
        return bool(self.mixture) or self.policy == "random"

    def changes(self, train: Mapping[str, Any]) -> dict[str, Any]:
        """Return the row's settings; the recipe's `train` completes its model."""
        usual, own = train.get("model"), self.train.get("model")
        if isinstance(usual, dict) and isinstance(own, dict):
            return {**self.train, "model": usual | own}
        return dict(self.train)


@dataclass(frozen=True)
class Claim:
    """A difference between two rows that is expected, before it is measured, to be above zero.

    Attributes:
        text: what is said if it is.
        more, less: names of rows, or `row → test`. A row with a single test is compared in that.
        metric: a column of the results.
        tests: where other rows are compared; by default in all tests that both have.
    """

    text: str
    more: str
    less: str
    metric: str = "SR"
    tests: tuple[str, ...] = ()


ARROW = " → "
Cell = tuple[str, str]  # names of a row and of a test


@dataclass(frozen=True)
class Comparison:
    """Rows, tests and claims.

    Attributes:
        tests, rows: by name, in the order of the table.
        walks: number of held-out episodes that each policy walks, at most.
        note: what a reader must know beside the table.
    """

    tests: Mapping[str, Test]
    rows: Mapping[str, Row]
    claims: tuple[Claim, ...] = ()
    walks: int = 100
    note: str = ""

    def __post_init__(self) -> None:
        if not self.tests or not self.rows:
            raise InputError("comparison: has no test or no row; valid: at least one of each")
        if self.walks < 1:
            raise InputError(f"comparison: walks {self.walks}; valid: 1 or more")
        for name, row in self.rows.items():
            if bool(row.mixture) == bool(row.policy):
                raise InputError(f"comparison: row {name!r}; valid: either a mixture or a policy")
            for test in row.tests:
                check_name(f"test in the row {name!r}:", test, self.tests)
        for claim in self.claims:
            for test in claim.tests:
                check_name(f"test in the claim {claim.text!r}:", test, self.tests)
            check_name(f"metric in the claim {claim.text!r}:", claim.metric, METRICS)
            if not list(self.pairs(claim)):
                raise InputError(f"comparison: the rows of {claim.text!r} have no test in common")

    def cells(self) -> list[Cell]:
        """Return all rows with each of their tests."""
        return [(name, test) for name in self.rows for test in self.tests_of(name)]

    def tests_of(self, row: str) -> tuple[str, ...]:
        """Return the names of a row's tests."""
        return self.rows[row].tests or tuple(self.tests)

    def pairs(self, claim: Claim) -> Iterator[tuple[Cell, Cell]]:
        """Yield the cells that a claim compares: more, less."""
        more, less = self._sides(claim.more), self._sides(claim.less)
        if len(more) == len(less) == 1:
            yield more[0], less[0]
            return
        for test in claim.tests or self.tests:
            pair = [
                next((c for c in side if len(side) == 1 or c[1] == test), None)
                for side in (more, less)
            ]
            if pair[0] and pair[1]:
                yield pair[0], pair[1]

    def _sides(self, name: str) -> list[Cell]:
        """Return the cells of a side of a claim: those of a row, or the one `row → test`."""
        row, arrow, test = name.rpartition(ARROW)
        if name in self.rows or not arrow:
            check_name("row in a claim:", name, self.rows)
            return [(name, test) for test in self.tests_of(name)]
        check_name("row in a claim:", row, self.rows)
        check_name(f"test of the row {row!r} in a claim:", test, self.tests_of(row))
        return [(row, test)]

    def label(self, cell: Cell) -> str:
        """Return the name of a cell: its row, and its test where the row has several."""
        row, test = cell
        return f"{row}{ARROW}{test}" if len(self.tests_of(row)) > 1 else row
