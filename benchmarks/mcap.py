"""MCAP: megabytes written and read per second, beside lower bounds of the cost.

The episodes are those of the chain's run. References are measured in the same process, round by
round in turn: for writing, the SDK logging the same finished messages with the same settings, and a
copy of the file; for reading, the Python reader of the MCAP project, checking all checksums as we
do, and reading the file's bytes.
"""

import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import foxglove
from mcap.reader import make_reader

from vlnpe.formats.convert.episodes import mcap_from_unit, unit_from_mcap
from vlnpe.formats.mcap.episode import write_episode_mcap
from vlnpe.formats.mcap.recording import Contents, open_recording, read_recording
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.pipeline.engine.ledger import Ledger

EPISODES = 6
ROUNDS = 3
MEGABYTE = 1e6


@dataclass(frozen=True)
class Episode:
    """Inputs of one MCAP file."""

    rollout: Path
    frames: Path


def report(run: Path) -> str:
    """Return a Markdown section; `run` is a folder that `vlnpe collect` filled."""
    ledger = Ledger.existing(run)
    rows = [row for row in ledger.rows("render") if row.status == "done"][:EPISODES]
    episodes = [Episode(run / str(r.facts["rollout"]), run / r.outputs[0]) for r in rows]
    with tempfile.TemporaryDirectory(dir=run) as scratch:
        return _report(episodes, Path(scratch))


def _report(episodes: list[Episode], scratch: Path) -> str:
    rollouts = [read_rollout(e.rollout) for e in episodes]
    paths = [scratch / f"{n}.mcap" for n in range(len(episodes))]
    units = [scratch / f"unit-{n}" for n in range(len(episodes))]

    def write() -> None:
        for path, rollout, episode in zip(paths, rollouts, episodes, strict=True):
            write_episode_mcap(path, rollout, episode.frames)

    write()
    contents = [read_recording(path) for path in paths]
    again = scratch / "again.mcap"

    def log_again() -> None:
        for content in contents:
            _log(again, content)

    def copy() -> None:
        for path in paths:
            shutil.copyfile(path, again)

    def read() -> None:
        for path in paths:
            read_recording(path)

    def read_by_mcap() -> None:
        for path in paths:
            with path.open("rb") as file:
                sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())

    def read_bytes() -> None:
        for path in paths:
            path.read_bytes()

    def to_units() -> None:
        for path, unit in zip(paths, units, strict=True):
            unit_from_mcap(path, unit)

    def to_mcap() -> None:
        for unit in units:
            mcap_from_unit(unit, again)

    size = sum(path.stat().st_size for path in paths) / MEGABYTE
    raw = sum(len(m.data) for c in contents for ms in c.messages.values() for m in ms) / MEGABYTE
    frames = sum(len(c.messages["/camera/rgb"]) for c in contents)
    operations: list[tuple[str, Callable[[], None]]] = [
        ("**write** an episode: videos decoded, depth to 16 bit, messages, zstd", write),
        ("write, reference: the SDK logs the same finished messages", log_again),
        ("write, reference: copy the file", copy),
        ("**read** all records, every checksum", read),
        ("read, reference: `mcap`'s reader, every checksum", read_by_mcap),
        ("read, reference: the file's bytes", read_bytes),
        ("**MCAP → LeRobot** unit: colour copied, depth encoded", to_units),
        ("**LeRobot → MCAP**", to_mcap),
    ]
    best = _fastest(operations)
    lines = [
        "## MCAP",
        "",
        f"{len(episodes)} episodes with {frames} frames of colour and depth: {size:.1f} MB of",
        f"files, {raw:.1f} MB of messages. CPU seconds of one process, the fastest of {ROUNDS}",
        "rounds each.",
        "",
        "| what | MB/s of files | MB/s of messages | ms per frame |",
        "| --- | ---: | ---: | ---: |",
        *(
            f"| {name} | {size / s:,.0f} | {raw / s:,.0f} | {1000 * s / frames:.2f} |"
            for (name, _), s in zip(operations, best, strict=True)
        ),
        "",
        f"Writing takes {best[0] / best[1]:.1f} times as long as the SDK's logging alone, reading "
        f"{best[3] / best[4]:.2f} times as long as `mcap`'s own reader.",
    ]
    return "\n".join(lines) + "\n"


def _fastest(operations: list[tuple[str, Callable[[], None]]]) -> list[float]:
    """Return CPU seconds of each way's fastest round.

    The ways take turns, so that load hits all alike.
    """
    best = [float("inf")] * len(operations)
    for _ in range(ROUNDS):
        for number, (_, run) in enumerate(operations):
            started = time.process_time()
            run()
            best[number] = min(best[number], time.process_time() - started)
    return best


def _log(path: Path, contents: Contents) -> None:
    """Write finished messages with our settings."""
    with open_recording(path) as recording:
        channels = {}
        for key, channel in contents.channels.items():
            schema = contents.schemas[channel.schema_id]
            channels[key] = foxglove.Channel(
                channel.topic,
                schema=foxglove.Schema(
                    name=schema.name, encoding=schema.encoding, data=schema.data
                ),
                message_encoding=channel.message_encoding,
                context=recording.context,
            )
        messages = [m for batch in contents.messages.values() for m in batch]
        for message in sorted(messages, key=lambda m: m.log_time):
            channels[message.channel_id].log(message.data, log_time=message.log_time)
