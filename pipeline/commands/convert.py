"""Commands for existing data: `convert` between formats, `restore` after LeRobot's tools."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from ...formats.convert.restore import restore
from ...formats.core.errors import FileFormatError, InputError, MissingExtraError, check_name
from ...formats.core.rollout import STATE_RATE_HZ
from ...formats.internnav.foreign import Assumptions
from ...formats.ros2.topic_map import TopicMap, read_topic_map
from ...formats.trainers.registry import LAYOUTS
from ...formats.trainers.subset import table
from ...formats.untrusted.documents import read_json_object
from ...formats.untrusted.files import read_input
from ...formats.untrusted.limits import limits
from ...formats.video.codecs import check_rgb_codec
from ..context import open_context
from ..options.convert import Convert, Restore
from ..report.gather import answer_counts
from ..stages.convert import items as convert
from ..stages.convert import source as convert_source
from ..stages.convert.layout_items import Choice, check_choice
from ..summary import print_result, print_stages

N1, ROS2 = convert_source.Kind.N1, convert_source.Kind.ROS2
# The formats that use an option: as input, and as output.
USERS = {
    "vocabulary": ((), (N1,)),
    "scan": ((), (N1,)),
    "every_frame": ((), (N1,)),
    "robot": ((N1, ROS2), (ROS2,)),
    "hfov_deg": ((N1,), ()),
    "base_height_m": ((N1, ROS2), ()),
    "frames_per_second": ((N1, ROS2), ()),
    "map": ((ROS2,), ()),
    "instruction": ((ROS2,), ()),
    "split": ((N1, ROS2), ()),
    "rgb_codec": ((N1, ROS2), ()),
}


def run_convert(options: Convert) -> int:
    """Convert all episodes of a source."""
    chosen, target = _options(options), options.to
    check_name("--to", target, (*convert_source.Kind, *LAYOUTS))
    choice = Choice(options.balance, options.keep_failures)
    check_choice(target, choice)
    if options.from_ in LAYOUTS:
        raise InputError(f"--from {options.from_}: this layout {convert_source.LACKS_POSES}")
    sources = convert_source.detect_all(options.source, target == convert_source.Kind.ROS2)
    kinds = sorted({str(source.kind) for source in sources})
    if options.from_ and [options.from_] != kinds:
        check_name("--from", options.from_, (*convert_source.Kind, *LAYOUTS))
        raise InputError(f"--from {options.from_}: {options.source} has the format {kinds[0]}")
    if kinds == [target]:
        raise InputError(f"{options.source} already has the format {target}; choose another --to")
    _check_used(options, kinds)
    if ROS2 in (target, *kinds) and find_spec("rosbags") is None:  # before any episode is read
        raise MissingExtraError("ROS 2", "ros2")
    with open_context(options.out, options) as context:
        summaries, written = convert.run(context, sources, target, chosen, choice)
    rows = [row for summary in summaries for row in summary.good().values()]
    lines = [
        line
        for (layout, subset), counts in answer_counts(rows).items()
        for line in (f"\n{layout} {subset}, answers:", *table(*counts))
    ]
    lines += [f"written to {path}" for path in written]
    if quarantined := sum(summary.quarantined for summary in summaries):
        reasons = options.out / "quarantine.json"
        lines.append(f"{quarantined} items were quarantined; see {reasons} for the reasons")
    facts = {"written": [str(path) for path in written]}
    return print_stages(options, summaries, "\n".join(lines), failed=not written, **facts)


def run_restore(options: Restore) -> int:
    """Restore a dataset in place."""
    done = restore(options.dataset, options.original)
    facts = {"episodes": done.episodes, "sources": [str(path) for path in done.sources]}
    return print_result(options, facts, f"{options.dataset}: {done.episodes} episodes restored")


def _check_used(options: Convert, kinds: Sequence[str]) -> None:
    """Raise InputError if an option was given that this conversion would ignore."""
    for name, (inputs, outputs) in USERS.items():
        value = getattr(options, name)
        if value == getattr(Convert, name) or options.to in outputs or {*kinds} & {*inputs}:
            continue
        uses = [f"from {' or '.join(inputs)}"] if inputs else []
        uses += [f"to {' or '.join(outputs)}"] if outputs else []
        flag = "" if value is True else f" {value}"
        raise InputError(
            f"--{name.replace('_', '-')}{flag}: {options.source} is {kinds[0]}, written as "
            f"{options.to}; the option is used only {' or '.join(uses)}"
        )


def _options(options: Convert) -> convert_source.Options:
    check_rgb_codec(options.rgb_codec)
    if not 0 < options.hfov_deg < 180:
        raise InputError(f"--hfov-deg {options.hfov_deg}: valid: between 0 and 180")
    if options.base_height_m is not None and not 0 < options.base_height_m < 10:
        raise InputError(f"--base-height-m {options.base_height_m}: valid: between 0 and 10")
    rate = options.frames_per_second
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}: valid: a divisor of {STATE_RATE_HZ}")
    return convert_source.Options(
        options.licence,
        options.vocabulary,
        Assumptions(
            options.robot,
            options.hfov_deg,
            options.base_height_m,
            options.split,
            options.rgb_codec,
            rate,
        ),
        options.scan,
        options.every_frame,
        read_topic_map(options.map) if options.map else TopicMap(),
        *_instructions(options.instruction),
    )


def _instructions(path: Path | None) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the text for all logs that have none, and those of single episodes."""
    if path is None:
        return "", ()
    if path.suffix == ".json":
        texts = read_json_object(path)
        if not all(isinstance(text, str) for text in texts.values()):
            raise FileFormatError(path, 'valid: a text for each episode, {"walk-000": "Go past …"}')
        return "", tuple((name, " ".join(text.split())) for name, text in texts.items())
    return _text(path), ()


def _text(path: Path) -> str:
    try:
        return " ".join(read_input(path, max_bytes=limits().text_bytes).decode().split())
    except UnicodeDecodeError as error:
        raise FileFormatError(path, "not a text in UTF-8") from error
