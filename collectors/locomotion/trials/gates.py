"""The requirements on a gait, checked against its evaluation table."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

# How discrete actions may be carried out; both are measured, the second one is judged.
TIMED, CLOSED_LOOP = "actions_timed", "actions_closed_loop"
# Of time before the end of a trial: a step of the policy, in which it ends, and more.
LAST_S = 0.05


@dataclass(frozen=True)
class Gate:
    """One requirement on one number of an evaluation table.

    Attributes:
        name: what is judged, in few words.
        unit: of the number; "%" numbers are kept as shares of 1.
        limit: the number must not be worse.
        at_least: the number must be at least the limit, not at most.
        tables: parts of the table that hold it; the worst of them counts. A trailing * stands for
            all parts that begin so.
        key: the number's name there.
        trial_s: how long trials were watched, where the number is a time that may not be over by
            their end [s].
    """

    name: str
    unit: str
    limit: float
    at_least: bool
    tables: tuple[str, ...]
    key: str
    trial_s: float | None = None


@dataclass(frozen=True)
class GateResult:
    """A gate and what was measured.

    Attributes:
        measured: None when the table does not hold it.
    """

    gate: Gate
    measured: float | None

    @property
    def name(self) -> str:
        """Name of the gate."""
        return self.gate.name

    @property
    def limit(self) -> float:
        """Limit of the gate."""
        return self.gate.limit

    @property
    def passed(self) -> bool:
        """Whether it was measured and is no worse than the limit."""
        if self.measured is None:
            return False
        if self.gate.at_least:
            return self.measured >= self.limit
        return self.measured <= self.limit

    def __str__(self) -> str:
        """Return one line: ✓ or ✗, name, measured and limit."""
        sign = "≥" if self.gate.at_least else "≤"
        share = self.gate.unit == "%"
        scale, form = (100.0, "{:.4g}") if share else (1.0, "{:.3g}")
        unit = " %" if share else f" {self.gate.unit}" if self.gate.unit else ""
        measured = "not measured"
        if self.measured is not None:
            measured = form.format(scale * self.measured) + unit
            if self.gate.trial_s is not None and self.measured > self.gate.trial_s - LAST_S:
                measured = f"not in {self.gate.trial_s:g}{unit}"
        mark = "✓" if self.passed else "✗"
        limit = form.format(scale * self.limit) + unit
        return f"{mark} {self.name:<44} {measured:>14}  {sign} {limit}"


GATES: tuple[Gate, ...] = (
    Gate("velocity error, 27 commands", "m/s", 0.05, False, ("grid_*",), "linear_error_mean_m_s"),
    Gate("turn rate error, 27 commands", "rad/s", 0.08, False, ("grid_*",), "yaw_error_mean_rad_s"),
    Gate("discrete actions, position, 90 %", "m", 0.08, False, (CLOSED_LOOP,), "position_p90_m"),
    Gate("discrete actions, heading, 90 %", "°", 6.0, False, (CLOSED_LOOP,), "heading_p90_deg"),
    Gate("12 m paths reached, flat", "%", 0.99, True, ("paths_flat",), "reached"),
    Gate("12 m paths, falls, flat", "", 0, False, ("paths_flat",), "falls"),
    Gate("12 m paths reached, 4 cm noise", "%", 0.97, True, ("paths_noise_4cm",), "reached"),
    Gate("12 m paths reached, 6 cm noise", "%", 0.90, True, ("paths_noise_6cm",), "reached"),
    Gate("survived pushes of 0.5 m/s for 20 s", "%", 0.95, True, ("pushes",), "survived"),
    Gate(
        "upright after a push of 0.5 m/s, standing", "%", 0.98, True, ("push_standing",), "upright"
    ),
    Gate(
        "upright after a push of 0.8 m/s, standing",
        "%",
        0.98,
        True,
        ("push_standing_hard",),
        "upright",
    ),
    Gate("12 m paths reached, 60 ms late", "%", 0.90, True, ("paths_60ms_late",), "reached"),
    Gate("upright 3 s after a stop at speed", "%", 0.99, True, ("stopping",), "upright"),
    Gate(
        "upright 5 s after a stop on 4 cm plates", "%", 0.98, True, ("stopping_plates",), "upright"
    ),
    Gate("time to rest, 99 % of stops", "s", 1.5, False, ("stopping",), "rest_s_p99", trial_s=3.0),
    Gate("slip of feet on the ground", "m/s", 0.1, False, ("grid_*",), "foot_slip_m_s"),
)


def gate_results(evaluation: Mapping[str, Any]) -> list[GateResult]:
    """Compare an evaluation table (`PolicyCard.evaluation`) with all gates, in their order."""
    return [GateResult(gate, worst_of(gate, evaluation)) for gate in GATES]


def worst_of(gate: Gate, evaluation: Mapping[str, Any]) -> float | None:
    """Return the worst of the numbers that a gate judges, None where the table holds none."""
    numbers = [
        float(evaluation[name][gate.key])
        for name in _matching(gate.tables, evaluation)
        if gate.key in evaluation[name]
    ]
    if not numbers:
        return None
    # NaN (nothing was left to measure) must never pass, and min and max may drop it.
    if any(number != number for number in numbers):
        return float("nan")
    return min(numbers) if gate.at_least else max(numbers)


def _matching(patterns: Iterable[str], evaluation: Mapping[str, Any]) -> list[str]:
    return [
        name
        for name in evaluation
        for pattern in patterns
        if name == pattern or (pattern.endswith("*") and name.startswith(pattern[:-1]))
    ]
