"""Options of the commands that make episodes: `align`, `filter`, `sample`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...trajectory_sampler.config import SampleConfig
from ...trajectory_sampler.vlnce.align_config import AlignConfig
from . import check_given
from .shared import Clearance, Parallel, WalkedBy


@dataclass(frozen=True)
class Sampling(Clearance):
    """Sampling."""

    min_length_m: float = SampleConfig.min_length_m
    """Minimum geodesic distance from start to goal of sampled paths [m]; the reference path is
    never shorter. Lower it for a single-room scan."""
    max_length_m: float = SampleConfig.max_length_m
    """Maximum length of a sampled reference path [m]; the geodesic distance is never longer."""
    end_clearance_m: float = SampleConfig.end_clearance_m
    """Clearance of the starts and goals of sampled paths, room to turn on the spot [m]; at least
    that of the path. Lower it for a narrow room."""
    min_view_m: float = SampleConfig.min_view_m
    """Minimum depth in the middle of the first and the last picture of a sampled path [m]; paths
    are cut short where that opens the view. 0 accepts goals before a blank wall."""
    min_crossings: int = SampleConfig.min_crossings
    """Minimum number of room-to-room transitions per sampled path; use 0 for a single-room scan."""
    similarity: str = SampleConfig.similarity
    """Distance between sampled paths: frechet (maximum distance, distinguishes different goals and
    different routes) or dtw (mean distance under dynamic time warping)."""
    min_gap_m: float = SampleConfig.min_gap_m
    """Minimum distance between sampled paths [m]; paths closer than this are too similar."""
    family_gap_m: float = SampleConfig.family_gap_m
    """Minimum distance between paths of different splits in one scene, in both directions [m]."""
    max_detour: float = SampleConfig.max_detour
    """Maximum length of a sampled path relative to the shortest one."""
    max_turning_deg: float | None = SampleConfig.max_turning_deg
    """Maximum sum of a sampled path's turns [deg]; unlimited by default."""
    heading: str = SampleConfig.heading
    """Initial heading of the robot: path (along the path) or random."""
    storeys: str = SampleConfig.storeys
    """Sampled paths over storeys: no (paths stay on a level), cross (every path takes a staircase),
    or mixed (19 % do, as in R2R), for robots that climb. The length of a staircase comes on top of
    --min-length-m and --max-length-m."""
    splits: str = ""
    """Number of paths per split over all scenes, e.g. train=147,val_seen=37,val_unseen=429.
    val_seen shares scenes with train, but no similar paths; val_unseen has scenes of its own."""
    train_scenes: str = ""
    """Scenes to train in, for --splits and presets: comma-separated names, or a number N for the
    first N scenes; by default as many as the sizes of the splits need."""
    quota: str = ""
    """Total number of paths in single scenes, for --splits and presets: home_1=40,home_2=80; the
    other scenes share the rest."""
    allow_fewer: bool = False
    """With --splits and presets: accept fewer paths from a scene that cannot hold the requested
    number, instead of failing."""


@dataclass(frozen=True)
class Align(WalkedBy, Parallel):
    """Transform VLN-CE episodes into the frame of repaired scenes, snapped to free floor."""

    episodes: tyro.conf.Positional[tuple[Path, ...]]
    """VLN-CE episode files to read (R2R or RxR), one per split."""
    scenes: Path
    """Folder of repaired scenes, with one subfolder per scene, named after its scan."""
    out: Path | None = None
    """Episode file to write (default aligned.json.gz); for several files a folder (default
    aligned), which gets one file per split."""
    robot_radius_m: float = AlignConfig.robot_radius_m
    """Clearance that starts, goals and paths need [m], if no robot is named."""
    max_start_nudge_m: float = AlignConfig.max_start_nudge_m
    """Maximum distance by which a start in collision may be moved [m]."""
    max_goal_nudge_m: float = AlignConfig.max_goal_nudge_m
    """Maximum distance by which a goal in collision may be moved [m]; at most that of a start."""
    goal_beyond_start: bool = AlignConfig.goal_beyond_start
    """Accept paths whose goal is moved farther than their start, instead of rejecting them."""
    max_waypoint_nudge_m: float = AlignConfig.max_waypoint_nudge_m
    """Maximum distance by which an inner waypoint may be moved [m]; others are bypassed."""
    max_bypassed_share: float = AlignConfig.max_bypassed_share
    """Maximum share of a path's inner waypoints that may be bypassed."""
    keep_climbable: bool = AlignConfig.keep_climbable
    """Also align paths over one staircase that --robot can climb, see `vlnpe filter`; they then
    follow its middle line."""
    max_floor_gap_m: float = AlignConfig.max_floor_gap_m
    """Maximum height of a point above or below its floor [m]."""
    max_failed: int = 0
    """Maximum number of rejected episodes; exit with code 1 above it."""

    def check(self) -> None:
        """Raise InputError if no file is given."""
        check_given(self.episodes)


@dataclass(frozen=True)
class Filter(Clearance, Parallel):
    """Drop episodes that climb stairs, detected by height steps in the reference path."""

    episodes: tyro.conf.Positional[tuple[Path, ...]]
    """VLN-CE episode files to read, one per split."""
    out: Path | None = None
    """Episode file to write, in the same schema (default kept.json.gz); for several files a folder
    (default kept)."""
    rules: str = "step"
    """Rules, comma-separated: step (VLN-PE's: a height step in the reference path), geometric (the
    path leaves its level; needs --scenes), text (the instruction mentions stairs)."""
    combine: str = "any"
    """When to drop an episode: any (if one of the rules applies) or all (if all of them do)."""
    max_step_m: float = 0.3
    """Maximum height difference between consecutive reference points, for the rule step [m]."""
    scenes: Path | None = None
    """Folder of repaired scenes, for the rule geometric and --keep-climbable."""
    keep_climbable: bool = False
    """Keep the episodes over one staircase of the repaired scene that --robot can climb, which the
    rules drop."""
    robot: str = ""
    """Robots that will walk these episodes, comma-separated, for --keep-climbable."""

    def check(self) -> None:
        """Raise InputError if no file is given."""
        check_given(self.episodes)


@dataclass(frozen=True)
class Sample(Sampling, WalkedBy, Parallel):
    """Sample new trajectories in repaired scenes."""

    scenes: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Repaired scenes, or folders of several."""
    out: Path | None = None
    """Episode file to write (default episodes.json.gz). With --splits or --preset a folder (default
    episodes), which gets one file per split."""
    count: int = 6
    """Number of paths to sample per scene, without --splits or --preset."""
    preset: str = ""
    """Sizes inferred from VLN-PE's: gru_vln10 (147, 37 and 429 paths over ten scenes, three of them
    for training) or lab_3dgs (40 and 160 paths in one scene)."""
    robot_radius_m: float = SampleConfig.robot_radius_m
    """Clearance kept at every point of a path [m], if no robot is named."""
    seed: int = 0
    """Random seed."""
    pictures: Path | None = None
    """Folder for pictures of the paths over the planning map, one PNG per scene and level."""
    max_failed: int = 0
    """Maximum number of scenes without any path; exit with code 1 above it."""
