"""`vlnpe review`: people accept, edit or reject instructions on a local page, or write them."""

import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from ...formats.convert.episodes import DATASET_NAME, LOG_KEY
from ...formats.core.checkout import program
from ...formats.core.errors import InputError, check_name
from ...formats.lerobot import read_episode_unit
from ...formats.untrusted.documents import read_json_object
from ...formats.vlnce.files import read_episodes
from ...instruction_gen.facts.named import read_named
from ...instruction_gen.review.log_walks import LogWalks
from ...instruction_gen.review.paths import Review
from ...instruction_gen.review.server import make_server
from ..context import LEDGERS
from ..engine.run_folder import RunFolder, SightFiles
from ..inputs.episode_file import scenes_of
from ..inputs.folders import scenes_in
from ..options.instructions import Review as ReviewOptions
from ..stages.datasets.reviewed import REVIEW_NAME
from ..stages.instructions.instruct_job import read_sights

TEXTS_NAME = "texts.json"  # beside the units of a log


def run(options: ReviewOptions) -> int:
    """Serve the page until interrupted."""
    units = units_of_log(options.run)
    review = log_walks(options, units) if units else review_of(options)
    server, address = make_server(review, options.port)
    sys.stdout.write(f"{len(review.names)} paths to review at {address}\n")
    sys.stdout.flush()
    if options.open:
        webbrowser.open(address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        if isinstance(review, LogWalks):
            how = f"`{program()} convert … --instruction {review.texts}` puts them into the dataset"
            sys.stdout.write(f"texts: {review.texts}; {how}\n")
        else:
            sys.stdout.write(f"decisions: {review.file.path}\n")
    finally:
        server.server_close()
    return 0


def units_of_log(folder: Path) -> list[Path]:
    """Return the episodes that `convert` cut from robots' logs into a folder, in order.

    Raises:
        FileFormatError: If the facts of a unit are damaged.
    """
    parts = sorted(folder.glob(f"units/*/*/{DATASET_NAME}"))
    return [path.parent for path in parts if LOG_KEY in read_json_object(path)]


def log_walks(options: ReviewOptions, units: Sequence[Path]) -> LogWalks:
    """Return the walks of a log that lack texts, or have some.

    Raises:
        InputError: They are of several datasets, so that names may occur twice.
    """
    datasets = sorted({unit.parent.name for unit in units})
    if len(datasets) > 1:
        both = ", ".join(datasets)
        raise InputError(f"{options.run}: logs of {both}; convert each into a folder of its own")
    texts = options.decisions or options.run / TEXTS_NAME
    return LogWalks([read_episode_unit(unit) for unit in units], texts)


def review_of(options: ReviewOptions) -> Review:
    """Return the paths to review."""
    source = options.run
    if source.is_dir():
        files = sorted((source / "episodes" / "instructed").glob("*.json.gz"))
        scenes, folder = options.scenes or source / "scenes", source
        records = RunFolder(source).sights
    else:
        files, folder = [source], source.parent
        scenes = scenes_of(source, options.scenes)
        whole = source.resolve()
        records = SightFiles(whole.parent / LEDGERS / whole.name)
    if not files:
        raise InputError(
            f"{source}: contains no episodes with instructions; run `{program()} collect` first"
        )
    episodes = [episode for path in files for episode in read_episodes(path)]
    known = scenes_in(scenes)
    for scene in sorted({episode.scene_id for episode in episodes}):
        check_name(f"scene of {scenes}", scene, known)
    films = {
        episode.trajectory_id: film
        for episode in episodes
        for film in sorted(folder.glob(f"frames/*/*/ego-*/{episode.episode_id}/rgb.mp4"))[:1]
    }
    decisions = options.decisions or folder / REVIEW_NAME
    # By path, not by file: with several episode files each has a record of its own in a scene.
    seen = read_sights(records.all_seen())
    named = read_named(records.all_named())
    return Review(episodes, scenes, decisions, films, seen, named)
