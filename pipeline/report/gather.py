"""Metrics of a run, read from its ledger."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from ...formats.core.errors import DivergedError
from ...formats.core.rollout import EndReason
from ..engine.ledger import Ledger, Row


@dataclass(frozen=True)
class RobotRow:
    """Averages of one robot under one controller: metres for TL and NE, else percent.

    Diverged episodes are set aside, but they count: as episodes, and as failures.

    Attributes:
        driven: the controller, and how it carried discrete actions out.
        episodes: how many paths were tried; a path is walked once for all its instructions.
        instructions: how many those paths carry.
        sr_by_instruction: SR where a path counts once for each of its instructions.
        collected: that ended as a success; SR, OS, SPL follow VLN-CE.
        tl: mean length walked.
        ne: mean over the episodes whose goal could still be reached from where they ended.
        os, sr, spl, ndtw: see `formats.core.rollout.Metrics`.
        fr, str: rates of falls and of stuck robots.
        fr_down: rate of falls after which the robot was down a second later; the others stumbled.
        recovered, down: how many of the falls the robot stood up from by itself, and after how
            many it was down a second later.
        falls, stuck, timeouts, stopped_near, stopped_far, blocked_starts, diverged: counts by end
            reason.
        collisions: episodes in which the robot touched an obstacle, or started inside one.
    """

    robot: str
    controller: str
    driven: str
    episodes: int
    instructions: int
    sr_by_instruction: float
    collected: float
    tl: float | None
    ne: float | None
    os: float
    sr: float
    spl: float
    ndtw: float | None
    fr: float
    str: float
    falls: int
    recovered: int
    down: int
    fr_down: float
    stuck: int
    timeouts: int
    stopped_near: int
    stopped_far: int
    blocked_starts: int
    diverged: int
    collisions: int


@dataclass(frozen=True)
class LeftOut:
    """A robot under one controller that lies in a run's folder, but not on the run's paths.

    Attributes:
        actions: how the controller `speed` executed discrete actions; empty for others.
    """

    robot: str
    controller: str
    actions: Mapping[str, Any]
    paths: int
    datasets: tuple[str, ...]


def left_out(ledger: Ledger) -> list[LeftOut]:
    """Return the robots whose walks lie in the folder and no table shows."""
    shown = {_crew(row) for row in ledger.rows("replay")}
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in ledger.all_rows("replay"):
        if row.status == "done" and _crew(row) not in shown:
            groups[_crew(row)].append(row)
    datasets = [row for row in ledger.all_rows("dataset") if not row.current]
    return [
        LeftOut(
            robot,
            rows[0].facts["controller"],
            rows[0].facts.get("actions") or {},
            len(rows),
            tuple(
                row.item
                for row in datasets
                if row.item.startswith(f"{robot}-{label}-")
                and (ledger.root / row.outputs[0]).is_dir()
            ),
        )
        for (robot, label), rows in groups.items()
    ]


def _crew(row: Row) -> tuple[str, str]:
    robot, label, _ = row.item.split("/", 2)
    return robot, label


def diverged_rows(ledger: Ledger) -> list[Row]:
    """Return the rows of episodes whose physics diverged, which have no rollout."""
    return [row for row in ledger.rows("replay") if row.error.get("type") == DivergedError.__name__]


def robot_rows(ledger: Ledger) -> list[RobotRow]:
    """Return one row per robot and controller, in name order."""
    return _robot_rows(_walks(ledger))


Counts = dict[tuple[str, str], tuple[Counter[str], Counter[str]]]


def answer_counts(rows: Iterable[Row]) -> Counts:
    """Return the answers of each kind before and after balancing, by layout and subset."""
    counts: Counts = {}
    for row in rows:
        if row.facts.get("before"):
            before, after = counts.setdefault(
                (row.stage, row.facts["subset"]), (Counter(), Counter())
            )
            before.update(row.facts["before"])
            after.update(row.facts["after"])
    return counts


def shared_paths_note(ledger: Ledger) -> str:
    """Return what to say of rows that are averages over different paths; nothing if none are."""
    walks = _walks(ledger)
    seeds = {facts.get("seed") for walked in walks.values() for facts in walked.values() if facts}
    paths = [set(walked) for walked in walks.values()]
    shared = set[str]().union(*paths).intersection(*paths)
    if all(walked == shared for walked in paths) and len(seeds) <= 1:
        return ""
    note = "The rows are averages over different paths"
    if not shared or len(seeds) > 1:  # another seed may sample other paths of the same names
        return f"{note}."
    common = {crew: {name: walked[name] for name in shared} for crew, walked in walks.items()}
    rates = ", ".join(f"{r.robot} {r.driven}: {r.sr:.1f}" for r in _robot_rows(common))
    which = "1 path" if len(shared) == 1 else f"{len(shared)} paths"
    return f"{note}. SR % on the {which} that all walked: {rates}."


# The facts of a rollout; None of an episode whose physics diverged.
_Facts = dict[str, Any] | None


def _walks(ledger: Ledger) -> dict[tuple[str, str], dict[str, _Facts]]:
    """Return what each robot did under each controller, by path."""
    walks: dict[tuple[str, str], dict[str, _Facts]] = defaultdict(dict)
    for row in [*ledger.done("replay"), *diverged_rows(ledger)]:
        walks[_crew(row)][row.item.rsplit("/", 1)[-1]] = row.facts or None
    return dict(sorted(walks.items()))


def _robot_rows(walks: Mapping[tuple[str, str], Mapping[str, _Facts]]) -> list[RobotRow]:
    facts = {crew: [fact for fact in walked.values() if fact] for crew, walked in walks.items()}
    seeds = {fact.get("seed") for walked in facts.values() for fact in walked}
    return [
        _robot_row(robot, label, measured, len(walks[robot, label]) - len(measured), len(seeds) > 1)
        for (robot, label), measured in facts.items()
    ]


def _robot_row(
    robot: str, label: str, facts: list[dict[str, Any]], diverged: int, with_seed: bool
) -> RobotRow:
    controller = facts[0]["controller"] if facts else label
    metrics = [f["metrics"] for f in facts]
    ends = Counter(EndReason(f["end_reason"]) for f in facts)
    tried = len(facts) + diverged

    def percent(key: str) -> float:
        return 100 * sum(m[key] or 0.0 for m in metrics) / tried

    def mean(key: str, scale: float = 1.0) -> float | None:
        # An unreachable goal has no finite distance; it must not hide the others' mean.
        values = [m[key] for m in metrics if m[key] is not None]
        return scale * fmean(values) if values else None

    # The number of instructions of a diverged episode was not recorded; each counts as one.
    texts = [max(1, f.get("instructions", 1)) for f in facts]
    good = sum(n * bool(m["success"]) for n, m in zip(texts, metrics, strict=True))
    return RobotRow(
        robot=robot,
        controller=controller,
        driven=driven(controller, facts, with_seed),
        episodes=tried,
        instructions=sum(texts) + diverged,
        sr_by_instruction=100 * good / (sum(texts) + diverged),
        collected=100 * ends[EndReason.SUCCESS] / tried,
        tl=mean("trajectory_length_m"),
        ne=mean("navigation_error_m"),
        os=percent("oracle_success"),
        sr=percent("success"),
        spl=percent("spl"),
        ndtw=mean("ndtw", 100.0),
        fr=percent("fall"),
        str=percent("stuck"),
        falls=ends[EndReason.FALL],
        recovered=sum(bool(m.get("recovered")) for m in metrics),
        down=sum(bool(m.get("down")) for m in metrics),
        fr_down=100 * sum(bool(m.get("down")) for m in metrics) / tried,
        stuck=ends[EndReason.STUCK],
        timeouts=ends[EndReason.TIMEOUT],
        stopped_near=ends[EndReason.STOPPED_NEAR],
        stopped_far=ends[EndReason.STOPPED_FAR],
        blocked_starts=ends[EndReason.COLLISION_START],
        diverged=diverged,
        collisions=sum(bool(f["contacts"]) for f in facts),
    )


def driven(controller: str, facts: Sequence[Mapping[str, Any]], with_seed: bool = False) -> str:
    """Return the controller in words, e.g. `speed, open loop, 50 steps` or `speed, closed loop`.

    Args:
        with_seed: Add their seed, where a run has several.
    """
    ways = {
        "closed loop"
        if f["actions"]["closed_loop"]
        else f"open loop, {f['actions']['steps']} steps"
        for f in facts
        if f.get("actions")
    }
    ways |= {"estimated state" for f in facts if f.get("state") == "estimated"}
    seeds = {f"seed {f['seed']}" for f in facts if with_seed and "seed" in f}
    return ", ".join([controller, *sorted(ways), *sorted(seeds)])
