"""What a run folder holds, decoded: equal for two runs of the same command, however interrupted."""

import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
from mcap.reader import make_reader

# How long work took, and digests of encoded files.
TIMED = {"seconds", "cpu_s", "cpu_seconds", "compile_seconds", "sha256", "files"}
LEDGER = {"manifest.json", "manifest.journal.jsonl"}


def content(root: Path) -> dict[str, str]:
    """Return a digest of the decoded content of every file below a run folder."""
    found = {}
    for path in sorted(p for p in root.rglob("*") if p.is_file()):
        state = hashlib.sha256()
        for part in _decoded(path):
            state.update(part)
        found[path.relative_to(root).as_posix()] = state.hexdigest()
    return found


def _decoded(path: Path) -> list[bytes]:
    raw = path.read_bytes()
    match path.suffix:
        case ".json":
            value = json.loads(raw)
            return [_json(value["rows"] if path.name in LEDGER else value)]
        case ".gz":
            return [gzip.decompress(raw)]
        case ".npz":
            with np.load(path) as data:
                return [name.encode() + data[name].tobytes() for name in sorted(data.files)]
        case ".parquet":
            return [_json(pq.read_table(path).to_pylist())]
        case ".mp4":
            with av.open(str(path)) as video:
                return [bytes(frame.planes[0]) for frame in video.decode(video=0)]
        case ".mcap":
            return _messages(path)
    return [raw]


def _messages(path: Path) -> list[bytes]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [
            f"{channel.topic} {message.log_time} ".encode() + message.data
            for _, channel, message in reader.iter_messages()
        ]
        found += [_json([m.name, dict(m.metadata)]) for m in reader.iter_metadata()]
        return found + [a.name.encode() + a.data for a in reader.iter_attachments()]


def _json(value: Any) -> bytes:
    return json.dumps(_without_times(value), sort_keys=True, default=str).encode()


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_times(v) for k, v in value.items() if k not in TIMED}
    if isinstance(value, list):
        return [_without_times(v) for v in value]
    return value
