"""`vlnpe review`: people accept, edit or reject instructions on a local page."""

import sys
import webbrowser

from ...formats.core.checkout import program
from ...formats.core.errors import InputError
from ...formats.vlnce.files import read_episodes
from ...instruction_gen.facts.named import read_named
from ...instruction_gen.review.paths import Review
from ...instruction_gen.review.server import make_server
from ..context import LEDGERS
from ..engine.run_folder import RunFolder, SightFiles
from ..inputs.episode_file import scenes_of
from ..options.instructions import Review as ReviewOptions
from ..stages.datasets.reviewed import REVIEW_NAME
from ..stages.instructions.instruct_job import read_sights


def run(options: ReviewOptions) -> int:
    """Serve the page until interrupted."""
    review = opened(options)
    server, address = make_server(review, options.port)
    sys.stdout.write(f"{len(review.paths)} paths to review at {address}\n")
    sys.stdout.flush()
    if options.open:
        webbrowser.open(address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        sys.stdout.write(f"decisions: {review.file.path}\n")
    finally:
        server.server_close()
    return 0


def opened(options: ReviewOptions) -> Review:
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
