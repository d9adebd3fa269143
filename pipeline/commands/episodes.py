"""Commands that make episodes: `align`, `filter`, `sample`."""

from __future__ import annotations

import sys

from ...formats.core.errors import InputError
from ...trajectory_sampler.config import SampleConfig
from ..folders import scenes_in
from ..jobs.episodes import AlignJob, FilterJob, SampleJob
from ..options.episodes import Align, Filter, Sample
from ..summary import tell


def run_align(options: Align) -> int:
    """Align the episodes of one file; return 1 if too many are rejected."""
    scenes = scenes_in(options.scenes)
    result = AlignJob(options.episodes, scenes, options.out, all_scenes=True).run()
    rejected = result.facts["rejected"]
    if not options.json:
        sys.stdout.writelines(f"rejected {name}: {reason}\n" for name, reason in rejected)
    text = f"{options.out}: {result.facts['episodes']} aligned, {len(rejected)} rejected"
    tell(options, result.facts, text)
    return int(len(rejected) > options.max_failed)


def run_filter(options: Filter) -> int:
    """Filter the episodes of one file."""
    facts = FilterJob(options.episodes, options.out, options.max_step_m).run().facts
    return tell(options, facts, f"{options.out}: {facts['kept']} kept, {facts['dropped']} dropped")


def run_sample(options: Sample) -> int:
    """Sample episodes in one scene."""
    try:
        config = SampleConfig(
            count=options.count,
            min_length_m=options.min_length_m,
            max_length_m=options.max_length_m,
            min_crossings=options.min_crossings,
            robot_radius_m=options.robot_radius_m,
            end_clearance_m=max(SampleConfig.end_clearance_m, options.robot_radius_m),
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    facts = SampleJob(options.scene, options.out, config, options.seed).run().facts
    return tell(options, facts, f"{options.out}: {facts['episodes']} episodes")
