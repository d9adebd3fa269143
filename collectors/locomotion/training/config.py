"""Settings of gait training, per robot."""

from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class RewardWeights:
    """Weights per second of the reward terms of `rewards.py`; negative ones are penalties."""

    track_linear: float = 2.0
    track_yaw: float = 1.0
    track_linear_mean: float = 1.5
    track_yaw_mean: float = 0.75
    alive: float = 0.5
    vertical_velocity: float = -2.0
    roll_pitch_rate: float = -0.1
    tilt: float = -5.0
    base_height: float = -40.0
    torque: float = -1e-4
    joint_acceleration: float = -2.5e-7
    action_rate: float = -0.02
    action_jerk: float = -0.01
    contact_schedule: float = 0.8
    swing_height: float = -60.0
    foot_slip: float = -0.6
    sideways: float = -0.4
    stand_pose: float = -1.0
    stand_joint_velocity: float = -0.02
    joint_limit: float = -5.0


@dataclass(frozen=True)
class TrainingConfig:
    """One phase of training.

    Attributes:
        envs, steps: parallel simulations and policy steps per PPO iteration.
        terrain: `flat`, `rough` (a mix of flat, noise up to 6 cm, steps of 2–5 cm), or `stairs`.
        episode_s: longest episode.
        command_s: range of times between new commands.
        command_margin: commands are drawn from the robot's limits times this.
        command_beyond: and from this much beyond them, for vx, vy [m/s] and yaw [rad/s].
        swing_height_m: height of the foot's arc above the ground.
        high_swing: weight of being above that arc, over that of being below.
        stand_joint_rad: pose to stand in, per leg, at the robot's base height; the default pose
            where empty.
        yaw_widths: squared widths [(rad/s)²] of the bells that reward the turn rate.
        linear_mean_widths, yaw_mean_widths: squared widths [(m/s)², (rad/s)²] of the bells that
            reward the mean velocity.
        friction, mass_scale, gain_scale: ranges drawn once per simulation.
        com_shift_m: largest shift of the base's centre of mass along each axis.
        latency_substeps: largest delay of an action, in physics steps.
        fall_slack: an episode ends at this many times the robot's roll and pitch thresholds; above
            1 there is something to recover from.
        push_m_s, push_s: largest kick of the base and range of times between kicks.
        noise: half width of uniform observation noise per block.
        init_std: exploration noise of a training from scratch.
        entropy: weight of the entropy bonus; a small one lets the exploration noise die down.
        kl: how far an iteration may move the policy; the learning rate follows.
        hidden: widths of actor and critic.
    """

    envs: int = 512
    steps: int = 24
    terrain: str = "flat"
    episode_s: float = 20.0
    command_s: tuple[float, float] = (2.0, 6.0)
    command_margin: float = 1.1
    command_beyond: tuple[float, float, float] = (0.0, 0.0, 0.0)
    swing_height_m: float = 0.08
    high_swing: float = 0.3
    stand_joint_rad: tuple[float, ...] = (0.0, 0.841, -1.682)
    yaw_widths: tuple[float, ...] = (0.25,)
    linear_mean_widths: tuple[float, ...] = (0.01,)
    yaw_mean_widths: tuple[float, ...] = (0.02,)
    friction: tuple[float, float] = (0.4, 1.2)
    mass_scale: tuple[float, float] = (0.85, 1.15)
    gain_scale: tuple[float, float] = (0.9, 1.1)
    com_shift_m: float = 0.02
    latency_substeps: int = 4
    fall_slack: float = 1.3
    push_m_s: float = 0.6
    push_s: tuple[float, float] = (3.0, 6.0)
    action_clip: float = 8.0
    noise: dict[str, float] = field(
        default_factory=lambda: {
            "linear_velocity_base_m_s": 0.03,
            "angular_velocity_base_rad_s": 0.08,
            "gravity_base": 0.02,
            "joint_minus_default_rad": 0.01,
            "joint_velocity_rad_s": 0.4,
        }
    )
    rewards: RewardWeights = field(default_factory=RewardWeights)
    init_std: float = 0.5
    entropy: float = 0.004
    kl: float = 0.015
    hidden: tuple[int, int] = (128, 128)


def ppo_config(config: TrainingConfig, seed: int) -> dict[str, Any]:
    """Return the configuration of `rsl_rl`'s runner for a training from scratch."""
    network = {
        "class_name": "MLPModel",
        "hidden_dims": list(config.hidden),
        "activation": "elu",
        "obs_normalization": True,
    }
    return {
        "seed": seed,
        "num_steps_per_env": config.steps,
        "save_interval": 10**9,
        "obs_groups": {"actor": ["policy"], "critic": ["policy", "privileged"]},
        "actor": {
            **network,
            "distribution_cfg": {
                "class_name": "GaussianDistribution",
                "init_std": config.init_std,
                "std_type": "log",
            },
        },
        "critic": network,
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": 5,
            "num_mini_batches": 4,
            "clip_param": 0.2,
            "gamma": 0.99,
            "lam": 0.95,
            "value_loss_coef": 1.0,
            "entropy_coef": config.entropy,
            "learning_rate": 1e-3,
            "max_grad_norm": 1.0,
            "schedule": "adaptive",
            "desired_kl": config.kl,
            "use_clipped_value_loss": True,
            "symmetry_cfg": {
                "data_augmentation_func": "vlnpe.collectors.locomotion.training.mirror:mirrored",
                "use_data_augmentation": False,
                "use_mirror_loss": True,
                "mirror_loss_coeff": 0.5,
            },
        },
    }


# Actions of half the Aliengo's scale are twice as large, torques an order of magnitude.
_HUMANOID = RewardWeights(
    torque=-1e-5,
    action_rate=-0.01,
    action_jerk=-0.005,
    tilt=-8.0,
    contact_schedule=1.2,
    track_linear_mean=2.5,
    track_yaw_mean=1.25,
)
H1_FLAT = TrainingConfig(
    stand_joint_rad=(0.0, 0.0, -0.332, 0.8, -0.468),
    rewards=_HUMANOID,
    push_m_s=0.7,
    linear_mean_widths=(0.006, 0.09),
    yaw_mean_widths=(0.01, 0.16),
)
G1_FLAT = replace(
    H1_FLAT,
    stand_joint_rad=(-0.109, 0.0, 0.0, 0.3, -0.191, 0.0),
    rewards=replace(_HUMANOID, torque=-2e-5),
)
# Nearer to the commanded velocity than the first phase asks for.
ALIENGO_FLAT = TrainingConfig(
    rewards=RewardWeights(track_linear_mean=2.5, track_yaw_mean=1.25),
    linear_mean_widths=(0.006, 0.09),
    yaw_mean_widths=(0.01, 0.16),
)


def _hard(flat: TrainingConfig) -> TrainingConfig:
    """Return a phase with rough ground, harder kicks, and the exact fall rule of the product.

    Commands go beyond the robot's limits: the calibration (`aim.py`) asks for more than it wants.
    """
    return replace(
        flat,
        terrain="rough",
        command_margin=1.0,
        command_beyond=(0.2, 0.25, 0.5),
        push_m_s=1.0,
        push_s=(2.0, 4.0),
        fall_slack=1.0,
        entropy=0.001,
    )


def _polish(flat: TrainingConfig) -> TrainingConfig:
    """Return a phase on level ground, with gentler kicks and no exploration: exact speeds."""
    rough = _hard(flat)
    return replace(rough, terrain="flat", push_m_s=0.7, push_s=(3.0, 6.0), entropy=0.0)


# Phases of training, in order: settings and PPO iterations.
Phases = tuple[tuple[TrainingConfig, int], ...]
PHASES: dict[str, Phases] = {
    "aliengo": (
        (TrainingConfig(), 450),
        (_hard(ALIENGO_FLAT), 120),
        (_polish(ALIENGO_FLAT), 80),
    ),
    "h1": ((H1_FLAT, 550), (_hard(H1_FLAT), 400), (_polish(H1_FLAT), 150)),
    "g1": ((G1_FLAT, 450), (_hard(G1_FLAT), 350), (_polish(G1_FLAT), 150)),
}

# On stairs the reference knows how high feet go; climbing takes more torque and quicker actions.
_STAIRS = TrainingConfig(
    envs=1200,
    terrain="stairs",
    episode_s=12.0,
    rewards=RewardWeights(
        track_linear_mean=3.0,
        base_height=-10.0,
        vertical_velocity=-1.0,
        roll_pitch_rate=-0.05,
        torque=-2e-5,
        joint_acceleration=-1e-7,
        action_rate=-0.006,
        action_jerk=-0.003,
        contact_schedule=0.25,
        swing_height=0.0,
        stand_pose=-0.3,
    ),
    linear_mean_widths=(0.01, 0.09),
    command_margin=1.0,
    friction=(0.5, 1.2),
    push_m_s=0.5,
    fall_slack=1.2,
    init_std=0.2,
    entropy=0.001,
    kl=0.012,
    hidden=(256, 128),
)


def stairs_phases(level: Phases, leans: bool) -> Phases:
    """Return the phases on stairs of a robot with these phases on level ground.

    One that does not lean would fall over the exploration that others need.
    """
    stand, std = level[-1][0].stand_joint_rad, _STAIRS.init_std if leans else 0.1
    return ((replace(_STAIRS, stand_joint_rad=stand, init_std=std), 800),)
