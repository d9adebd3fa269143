"""The sheet that `vlnpe robots` shows of a robot: its facts and its policy's card."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..collectors.controllers import valid_controllers
from ..collectors.locomotion.runtime.card import PolicyCard
from ..collectors.locomotion.runtime.policy import GaitPolicy
from ..collectors.locomotion.trials.gates import GateResult, gate_results
from ..collectors.robots import TIMESTEP_S, RobotSpec
from ..formats.core.checkout import program
from ..formats.core.errors import FileFormatError
from ..rendering.figures.portraits import StandingRobot


@dataclass(frozen=True)
class RobotSheet:
    """One robot as numbers and words; JSON values throughout.

    Attributes:
        mover: `policy`, `wheels`, or `none` for what is only placed.
        mass_kg, height_m: of the whole robot.
        vx_m_s, vy_m_s, yaw_rad_s: lowest and highest command.
        footprint_radius_m: what planners keep free.
        samples, wall_s: its policy's training; None when the card does not say.
        anticipated_ms: the greatest delay that its gait learned to act ahead of; None where it did
            not.
        gates: the policy's requirements; empty where there is no policy.
        problem: why its policy cannot be read; empty where it can, or needs none.
        sources: where its facts come from.
    """

    name: str
    title: str
    mover: str
    mass_kg: float
    height_m: float
    camera_height_m: float
    camera_pitch_down_deg: float
    camera_px: tuple[int, int]
    camera_hfov_deg: float
    vx_m_s: tuple[float, float]
    vy_m_s: tuple[float, float]
    yaw_rad_s: tuple[float, float]
    footprint_radius_m: float
    controllers: tuple[str, ...]
    samples: int | None
    wall_s: float | None
    anticipated_ms: float | None
    gates: tuple[dict[str, object], ...]
    problem: str
    sources: tuple[str, ...]

    @property
    def gate_summary(self) -> str:
        """Return how many gates are passed, in words."""
        if self.mover == "wheels":
            return "no policy needed"
        if self.mover == "none":
            return "placed, not driven"
        if self.problem:
            return "no policy yet"
        measured = [gate for gate in self.gates if gate["measured"] is not None]
        if not measured:
            return "not measured"
        passed = sum(bool(gate["passed"]) for gate in measured)
        missing = len(self.gates) - len(measured)
        unmeasured = f", {missing} not measured" if missing else ""
        return f"{passed} of {len(measured)} passed{unmeasured}"


def sheet_of(robot: RobotSpec) -> RobotSheet:
    """Collect the facts of `robot`; a policy that cannot be read is listed as a problem."""
    standing, camera, limits = StandingRobot.of(robot), robot.camera, robot.command_limits
    mover = "wheels" if robot.drive is not None else "policy" if robot.joints else "none"
    card, problem = _card(robot) if mover == "policy" else (None, "")
    training = {} if card is None else card.training
    return RobotSheet(
        name=robot.name,
        title=robot.title,
        mover=mover,
        mass_kg=round(robot.mass_kg, 3),
        height_m=round(standing.height_m, 6),
        camera_height_m=round(standing.camera_height_m, 6),
        camera_pitch_down_deg=camera.pitch_down_deg,
        camera_px=(camera.model.width_px, camera.model.height_px),
        camera_hfov_deg=camera.model.hfov_deg,
        vx_m_s=limits.vx_m_s,
        vy_m_s=limits.vy_m_s,
        yaw_rad_s=limits.yaw_rad_s,
        footprint_radius_m=robot.footprint_radius_m,
        controllers=tuple(valid_controllers(robot)),
        samples=training.get("samples"),
        wall_s=training.get("wall_s"),
        anticipated_ms=_anticipated_ms(training),
        gates=() if card is None else tuple(_gate(g) for g in gate_results(card.evaluation)),
        problem=problem,
        sources=robot.sources,
    )


def _card(robot: RobotSpec) -> tuple[PolicyCard | None, str]:
    try:
        return GaitPolicy.load(robot).card, ""
    except FileFormatError as error:
        return None, str(error)


def _anticipated_ms(training: Mapping[str, Any]) -> float | None:
    """Return the greatest delay in a card's training; a user's card may say anything there."""
    facts = training.get("anticipation")
    substeps = facts.get("late_substeps") if isinstance(facts, dict) else None
    return 1000 * TIMESTEP_S * substeps if isinstance(substeps, int | float) else None


def _gate(result: GateResult) -> dict[str, object]:
    """Return a gate as JSON values; NaN was not measured."""
    measured, line = result.measured, str(result)
    return {
        "name": result.name,
        "measured": measured if measured is not None and math.isfinite(measured) else None,
        "limit": result.limit,
        "at_least": result.gate.at_least,
        "unit": result.gate.unit,
        "passed": result.passed,
        "line": line if measured is not None else f"–{line[1:]}",
    }


def table(sheets: Sequence[RobotSheet]) -> str:
    """Return one line per robot."""
    rows = [("robot", "mass", "height", "camera", "vx m/s", "vy m/s", "turn °/s", "radius",
             "controllers", "gates")]  # fmt: skip
    for s in sheets:
        tilt = f"{s.camera_pitch_down_deg:.0f}° down" if s.camera_pitch_down_deg else "level"
        rows.append(
            (
                s.name,
                f"{s.mass_kg:.3g} kg" if s.mover != "none" else "–",
                f"{s.height_m:.2f} m",
                f"{s.camera_height_m:.2f} m, {tilt}",
                _span(s.vx_m_s),
                _span(s.vy_m_s),
                _span((round(math.degrees(s.yaw_rad_s[0])), round(math.degrees(s.yaw_rad_s[1])))),
                f"{s.footprint_radius_m:.2f} m",
                " ".join(s.controllers),
                s.gate_summary,
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def missed_gates(sheets: Sequence[RobotSheet]) -> list[str]:
    """Return what a gate is and which ones the gaits miss, in words; nothing without any."""
    if not any(sheet.gates for sheet in sheets):
        return []
    missed = {
        sheet.name: [
            str(g["name"]) for g in sheet.gates if g["measured"] is not None and not g["passed"]
        ]
        for sheet in sheets
    }
    wide = max(map(len, missed))
    return [
        "",
        "gates: requirements on a trained gait, e.g. 99 % of 12 m paths reached on flat ground.",
        f"docs/results/gaits.md lists their limits; so does {program()} robots NAME. Missed:",
        *(f"  {name:<{wide}}  {'; '.join(names)}" for name, names in missed.items() if names),
    ]


def details(sheet: RobotSheet) -> str:
    """Return policy, gates and sources of one robot as text."""
    lines = [f"{sheet.title} ({sheet.name})"]
    if sheet.problem:
        lines.append(f"  {sheet.problem}")
    elif sheet.mover == "policy":
        samples = "?" if sheet.samples is None else f"{sheet.samples / 1e6:.3g} million"
        wall = "?" if sheet.wall_s is None else f"{sheet.wall_s / 3600:.2g} h"
        lines.append(f"  policy: {samples} samples in {wall}")
        if sheet.anticipated_ms is not None:
            lines.append(f"  anticipates delays: actions may be {sheet.anticipated_ms:.0f} ms late")
        lines += [f"  {gate['line']}" for gate in sheet.gates]
    lines += [f"  source: {source}" for source in sheet.sources]
    return "\n".join(lines)


def _span(limits: tuple[float, float]) -> str:
    low, high = limits
    if low == high == 0.0:
        return "–"
    return f"±{high:.3g}" if low == -high else f"{low:.2g} … {high:.2g}"
