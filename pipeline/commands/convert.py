"""Commands for existing data: `convert` between formats, `restore` after LeRobot's tools."""

from ...formats.convert.restore import restore
from ...formats.core.errors import InputError
from ...formats.core.rollout import STATE_RATE_HZ
from ...formats.internnav.foreign import Assumptions
from ...formats.video.mp4 import check_rgb_codec
from ..context import open_context
from ..options.convert import Convert, Restore
from ..stages.convert import items as convert
from ..stages.convert import source as convert_source
from ..summary import joined, print_result, stage_table


def run_convert(options: Convert) -> int:
    """Convert all episodes of a source.

    Raises:
        InputError: If the source cannot be used, or an option is invalid.
    """
    chosen = _options(options)
    source = convert_source.detect(options.source)
    target = convert_source.Kind(options.to)
    if source.kind is target:
        raise InputError(f"{options.source} already has the format {target}; choose another --to")
    with open_context(options.out, options) as context:
        summaries, written = convert.run(context, source, target, chosen)
    quarantined = sum(s.quarantined for s in summaries)
    code = int(quarantined > options.max_failed)
    facts = {
        "written": [str(path) for path in written],
        "stages": {s.stage: s.counts() for s in joined(summaries)},
        "exit_code": code,
    }
    lines = [f"\n{stage_table(summaries)}\n", *(f"written to {path}" for path in written)]
    if quarantined:
        reasons = options.out / "quarantine.json"
        lines.append(f"{quarantined} items were quarantined; see {reasons} for the reasons")
    print_result(options, facts, "\n".join(lines))
    return code


def run_restore(options: Restore) -> int:
    """Restore a dataset in place.

    Raises:
        FileFormatError: If a folder is not a dataset, or an episode is in none of the originals.
    """
    done = restore(options.dataset, options.original)
    facts = {"episodes": done.episodes, "sources": [str(path) for path in done.sources]}
    return print_result(options, facts, f"{options.dataset}: {done.episodes} episodes restored")


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
    )
