"""Settings of a replay."""

from dataclasses import dataclass, field

from ...formats.core.rollout import REST_M_S
from ..controllers import FlashConfig, PathConfig, SpeedConfig
from ..locomotion.state import State
from ..physics import LevelModelConfig
from ..physics.outcome import OutcomeConfig


@dataclass(frozen=True)
class ReplayConfig:
    """Parameters of a replay.

    Attributes:
        robot: what `get_robot` takes: a registry name, or the path of a robot's folder.
        seed: of the small random joint offsets at spawn and of the sensors' errors, together with
            the episode's id.
        state: what a gait sees: the true state, or its estimate from the robot's own sensors.
        spawn_joint_noise_rad: standard deviation of the joint offsets, so that starts differ.
        settle_least_s, settle_most_s: bounds of the time to settle before the first sample.
        settled_m_s, settled_rad_s: base and joint speeds below which a robot is at rest.
        rest_s: after STOP a robot is at rest once it has been slower than `settled_m_s` for so
            long: at least a frame at 4 frames/s.
        watch_s: how long a robot is watched after STOP: a fall in that time counts, and one that is
            not at rest by its end is judged as it is. The record ends where it came to rest.
        after_fall_s: how long a robot is recorded after a fall, at the end of which it is either
            up or down.
    """

    robot: str = "aliengo"
    controller: str = "path"
    seed: int = 0
    state: State = "true"
    path: PathConfig = field(default_factory=PathConfig)
    speed: SpeedConfig = field(default_factory=SpeedConfig)
    flash: FlashConfig = field(default_factory=FlashConfig)
    outcome: OutcomeConfig = field(default_factory=OutcomeConfig)
    physics: LevelModelConfig = field(default_factory=LevelModelConfig)
    spawn_joint_noise_rad: float = 0.01
    settle_least_s: float = 0.5
    settle_most_s: float = 1.5
    settled_m_s: float = REST_M_S
    settled_rad_s: float = 0.5
    rest_s: float = 0.25
    watch_s: float = 5.0
    after_fall_s: float = 1.0
