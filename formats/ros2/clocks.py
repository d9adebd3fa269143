"""When the messages of a topic were measured: their own clock against the recorder's."""

from array import array
from collections.abc import Iterable, Mapping
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


def tracks_by_time(
    topics: Mapping[str, Stamped], start_ns: int, doubts: list[str]
) -> dict[str, Track]:
    """Return the values of each topic that has any, by the recorder's clock.

    Topics on one other clock are shifted as one, by the least of their median latencies: how they
    lie to each other is known, and how long the quickest took is not.

    Args:
        start_ns: From where times count, by the recorder's clock [ns].
        doubts: What was adjusted is added here.
    """
    times_ns, late_s = dict[str, NDArray[np.int64]](), dict[str, float]()
    for name, topic in topics.items():
        stamps, logs = np.array(topic.stamp_ns, np.int64), np.array(topic.log_ns, np.int64)
        if topic.skipped:
            many = f"{topic.skipped} of {topic.skipped + len(stamps)} messages"
            doubts.append(f"{name}: {many} do not hold what they should; left out")
        if not len(stamps):
            continue
        late = float(np.median(logs - stamps)) / NANOSECONDS
        times_ns[name] = stamps
        if len(stamps) < 2:
            times_ns[name] = stamps if abs(late) <= OTHER_CLOCK_S else logs
        elif fault := _fault(stamps, logs):
            doubts.append(f"{name}: its clock {fault}; the recorder's times are used")
            times_ns[name] = logs
        elif (stamps != logs).any():
            late_s[name] = late
    for names in _clocks(late_s):
        near = any(abs(late_s[name]) <= OTHER_CLOCK_S for name in names)
        shift_s = 0.0 if near else late_s[names[0]]
        if shift_s:
            told = f"clock {shift_s:.3f} s behind the recorder's; shifted"
            doubts.append(f"{', '.join(names)}: {told}")
        for name in names:
            times_ns[name] = times_ns[name] + round(shift_s * NANOSECONDS)
            if abs(late := late_s[name] - shift_s) > _LATE_S:
                doubts.append(f"{name}: recorded {late:.3f} s after its stamps, which are believed")
    result = {}
    for name, times in times_ns.items():
        time_s, first = np.unique((times - start_ns) / NANOSECONDS, return_index=True)
        values = np.array(topics[name].values).reshape(len(times), -1)
        result[name] = Track(time_s, values[first])
    return result


def _clocks(late_s: Mapping[str, float]) -> list[list[str]]:
    """Return the topics of each clock, by the seconds that they are behind, least first."""
    clocks: list[list[str]] = []
    for name in sorted(late_s, key=late_s.__getitem__):
        if clocks and late_s[name] - late_s[clocks[-1][0]] <= OTHER_CLOCK_S:
            clocks[-1].append(name)
        else:
            clocks.append([name])
    return clocks


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
