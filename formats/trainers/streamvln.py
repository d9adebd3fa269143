"""StreamVLN: one record for each episode, with all of its instructions and actions."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .answers import KIND_OF
from .subset import ANNOTATIONS_NAME, Layout, Subset, Written, folder_of, write_array, write_lines
from .walks import Walk, WalkSource

START = -1  # stands before the first frame; loaders shift the actions by one and append STOP
SHORTEST, LONGEST = 4, 498  # numbers of actions that are read


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of a subset."""
    frames, kinds = [], []
    records: list[dict[str, Any]] = []
    summary: list[dict[str, Any]] = []
    for number, source in enumerate(sources):
        walk = Walk.open(source)
        steps = walk.steps()
        if not SHORTEST <= len(steps.action) <= LONGEST:
            frames.append(None)
            continue
        folder = folder_of(out / "images" / source.key / "rgb")
        walk.write_jpegs(
            steps.frame, [folder / f"{k + 1:03d}.jpg" for k in range(len(steps.frame))]
        )
        frames.append(steps.frame)
        kinds += [KIND_OF[a] for a in steps.action.tolist()] * len(source.texts)
        record = {
            "id": number,
            "video": f"images/{source.key}",
            "instructions": list(source.texts),
            "actions": [START, *steps.action[:-1].tolist()],
        }
        columns = walk.unit.columns
        records.append(record)
        named = {key: columns[key] for key in ("trajectory_id", "scene_id")}
        summary.append(record | named)
    write_array(out / ANNOTATIONS_NAME, records)
    write_lines(out / "summary.json", summary)
    counts = Counter(kinds)
    return Written(frames, len(records), counts, counts)


STREAMVLN = Layout("streamvln", "StreamVLN", write, labels=True)
