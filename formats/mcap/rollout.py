"""A rollout as one MCAP file: exact, checked, quick, and it opens in Foxglove."""

from pathlib import Path

from ..core.errors import FileFormatError
from ..core.rollout import Rollout
from .facts import METADATA_NAME, rollout_facts, rollout_fields
from .recording import Contents, open_recording, read_recording
from .state import decode_states
from .topics import STATE_TOPIC, event_messages, motion_messages, state_messages, write_in_order

SHOW_EVERY = 5  # samples between what Foxglove shows: 20 Hz


def write_rollout(path: Path, rollout: Rollout) -> None:
    """Write `rollout` atomically; the same rollout gives the same data section.

    Every sample is on /state with exact doubles. Transforms, base pose and joint states at 20 Hz
    and events are there for Foxglove; all else is in the metadata record `vlnpe.rollout`.
    """
    with open_recording(path) as recording:
        recording.writer.write_metadata(METADATA_NAME, rollout_facts(rollout))
        write_in_order(
            state_messages(recording, rollout),
            motion_messages(recording, rollout, SHOW_EVERY),
            event_messages(recording, rollout),
        )


def read_rollout(path: Path) -> Rollout:
    """Read what `write_rollout` wrote, exactly."""
    return rollout_of(read_recording(path), path)


def rollout_of(contents: Contents, path: Path) -> Rollout:
    """Return the rollout in the contents of a file."""
    if METADATA_NAME not in contents.metadata:
        raise FileFormatError(path, f"no rollout: metadata {METADATA_NAME} is missing")
    fields = rollout_fields(contents.metadata[METADATA_NAME], path)
    states = [message.data for message in contents.messages.get(STATE_TOPIC, [])]
    if len(states) != fields.pop("samples"):
        raise FileFormatError(path, "state messages are missing")
    fields.update(decode_states(states, path))
    return Rollout(**fields)
