"""Options of the commands for instructions: `instruct`, `check-text`, `review`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from . import check_is_no_folder, check_port, must_exist
from .shared import Parallel, Wording


@dataclass(frozen=True)
class Instruct(Wording, Parallel):
    """Write instructions for the episodes that have none."""

    episodes: tyro.conf.Positional[Path]
    """Episode file of `sample` or `align`, or run folder of `collect`."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    out: Path = Path("instructed.json.gz")
    """Episode file to write."""
    per_instruction: bool = False
    """Write one episode per instruction. By default a path is one episode that carries all."""
    robot: str = "aliengo"
    """Robot whose camera determines which landmarks are visible along the path, or `none` to use
    the map alone, which is faster."""
    cache: Path | None = None
    """Cache folder for model responses; default `llm_cache` next to the output."""
    facts: Path | None = None
    """Also write the facts records behind the texts, as compressed JSON."""
    show: int = 0
    """Print a map and the texts of this many paths, of those that just got texts first."""
    seed: int = 0
    """Random seed of the phrasing."""
    max_failed: int = 0
    """Maximum number of episodes without a valid instruction; exit with code 1 above it."""

    def check(self) -> None:
        """Raise InputError if an input is missing or an output is a folder."""
        must_exist(self.episodes, self.scenes)
        check_is_no_folder("--out", self.out)
        check_is_no_folder("--facts", self.facts)


@dataclass(frozen=True)
class CheckText:
    """Check texts of any origin against the paths that they describe."""

    episodes: tyro.conf.Positional[Path]
    """Run folder of `collect`, or an episode file (outside of a run, --scenes is required)."""
    texts: Path
    """JSON lines {"path": trajectory id, "text": ..., "claims": [...]}; claims are optional."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    json: bool = False
    """Print one JSON object as the last line: {"texts": [{"path", "text", "refused", "problems",
    "unchecked"}, ...]}."""

    def check(self) -> None:
        """Raise InputError if a file or folder is missing."""
        must_exist(self.episodes, self.texts, self.scenes)


@dataclass(frozen=True)
class Review:
    """Review the instructions of a run on a local page (127.0.0.1); decisions apply at export."""

    run: tyro.conf.Positional[Path]
    """A run folder, or an episode file of `instruct` (outside of a run, --scenes is required); or
    what `convert` wrote of robots' logs, for which texts are written beside their films."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    decisions: Path | None = None
    """Append-only file of decisions; by default review.jsonl in the run folder, or beside the
    file. Of logs: the texts that convert's --instruction reads; by default texts.json."""
    port: int = 0
    """Port of the page; 0 selects a free one."""
    open: bool = False
    """Open the page in the default browser."""

    def check(self) -> None:
        """Raise InputError if an input is missing, or an output or the port is impossible."""
        must_exist(self.run, self.scenes)
        check_is_no_folder("--decisions", self.decisions)
        check_port(self.port)
