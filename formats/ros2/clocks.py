"""When the messages of a topic were measured: their own clock against the recorder's."""

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .bag import NANOSECONDS

# A topic's clock that is this far from the recorder's is another clock, not latency.
OTHER_CLOCK_S = 1.0
# From here on it may be either, which is worth knowing.
_LATE_S = 0.2


@dataclass(frozen=True)
class Track:
    """Values by ascending time since the bag's start.

    Attributes:
        time_s: (N,) [s].
        values: (N, D).
    """

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values interpolated linearly; before the first and after the last, those."""
        columns = [np.interp(times_s, self.time_s, column) for column in self.values.T]
        return np.stack(columns, axis=-1) if columns else np.empty((len(times_s), 0))

    def last_at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the last value of each time; before the first one, NaN."""
        index = np.searchsorted(self.time_s, times_s, side="right") - 1
        values = self.values[np.maximum(index, 0)]
        return np.where((index >= 0)[:, None], values, np.nan)


@dataclass
class Stamped:
    """Messages of one topic, in the order of their log times.

    Attributes:
        values: As many of each message, one after the other.
        skipped: Messages that were left out, since what they say is no number.
    """

    stamp_ns: array[int] = field(default_factory=lambda: array("q"))
    log_ns: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    skipped: int = 0

    def add(self, stamp_ns: int, log_ns: int, values: Iterable[float]) -> None:
        """Add a message."""
        self.stamp_ns.append(stamp_ns)
        self.log_ns.append(log_ns)
        self.values.extend(values)

    def track(self, name: str, start_ns: int, doubts: list[str]) -> Track | None:
        """Return the values by time, if there are any; what was adjusted is added to `doubts`."""
        stamps, logs = np.array(self.stamp_ns, np.int64), np.array(self.log_ns, np.int64)
        if self.skipped:
            many = f"{self.skipped} of {self.skipped + len(stamps)} messages"
            doubts.append(f"{name}: {many} do not hold what they should; left out")
        if not len(stamps):
            return None
        time_s = (_measured(name, stamps, logs, doubts) - start_ns) / NANOSECONDS
        time_s, first = np.unique(time_s, return_index=True)
        return Track(time_s, np.array(self.values).reshape(len(stamps), -1)[first])


def _measured(
    name: str, stamps: NDArray[np.int64], logs: NDArray[np.int64], doubts: list[str]
) -> NDArray[np.int64]:
    """Return the times [ns] by the recorder's clock at which messages were measured."""
    late_s = float(np.median(logs - stamps)) / NANOSECONDS
    if len(stamps) < 2:
        return stamps if abs(late_s) <= OTHER_CLOCK_S else logs
    if fault := _fault(stamps, logs):
        doubts.append(f"{name}: its clock {fault}; the recorder's times are used")
        return logs
    if abs(late_s) > OTHER_CLOCK_S:
        doubts.append(f"{name}: its clock is {late_s:.3f} s behind the recorder's; shifted")
        return stamps + round(late_s * NANOSECONDS)
    if abs(late_s) > _LATE_S:
        doubts.append(f"{name}: recorded {late_s:.3f} s after its stamps, which are believed")
    return stamps


def _fault(stamps: NDArray[np.int64], logs: NDArray[np.int64]) -> str:
    """Return what makes a clock useless; empty if it goes as the recorder's does."""
    steps, other = np.diff(stamps), OTHER_CLOCK_S * NANOSECONDS
    if not steps.any():
        return "stands still"
    if steps.min() < 0:
        return "runs backwards"
    if (steps - np.diff(logs)).max() > other:
        return "leaps ahead"
    late, part = logs - stamps, max(1, len(stamps) // 10)
    if abs(np.median(late[-part:]) - np.median(late[:part])) > other:
        return "runs at another speed"
    return ""
