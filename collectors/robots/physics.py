"""The physics settings that every model with a robot shares, trained on and replayed with."""

from __future__ import annotations

import mujoco

TIMESTEP_S = 0.005  # 200 Hz, as VLN-PE
POLICY_DECIMATION = 4  # physics steps per policy step: 50 Hz


def apply_physics_options(spec: mujoco.MjSpec) -> None:
    """Set the options a robot's policy was trained with on the root spec of a model.

    `attach` does not carry options over to the parent, so whoever builds a scene around a robot
    calls this on the scene's own spec.
    """
    spec.option.timestep = TIMESTEP_S
    # The servos' damping is stiff at 5 ms; implicit integration keeps it stable.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Elliptic cones halve the speed; pyramids let a loaded foot creep by about 1 cm/s at most.
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.impratio = 1.0
    spec.option.iterations = 30
    spec.option.ls_iterations = 20
