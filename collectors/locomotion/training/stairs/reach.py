"""How the legs of a robot reach footholds: polynomials fitted to its kinematics."""

from dataclasses import replace
from functools import cache

import numpy as np

from .....formats.core.errors import InputError
from ....robots import RobotSpec
from ...runtime.footing import POWERS, Footing
from ...runtime.gait import GaitClock
from ..derived import POINT_LEG, Stance

# Shifts of a foot to fit to, ahead and above, and how much of its straight leg is used.
AHEAD_M, GRID = 0.3, 13
ABOVE_M, ABOVE_UPRIGHT_M = (-0.1, 0.22), (-0.12, 0.34)
LENGTHS = (0.33, 0.94)
CHAIN = 3  # points from hip to foot
# A scan from behind the hind feet to more than one tread before the front feet.
FIRST_M, SPACING_M, ROWS = -0.44, 0.04, 27
CLEARANCE_M = 0.07  # of edges
# On two legs the trunk stays upright, and legs bend: they step half a riser down, and half up.
CROUCH_M = 0.05


@cache
def footing(robot: RobotSpec, gait: GaitClock) -> Footing:
    """Return how a robot's gait follows stairs.

    Raises:
        InputError: its legs have other joints than hip, knee, and perhaps ankle that pitch.
    """
    stance = Stance(robot)
    reach: list[list[float]] = []
    bear: list[list[float]] = []
    heights, lengths, lifts, soles = [], [], [], []
    for foot, swing in enumerate(gait.swing_rad):
        # A round sole rolls: its middle is what is put somewhere.
        up = np.array([0.0, 0.0, stance.handles.sole_radius_m[foot].mean()])
        leg = replace(stance.legs[foot], place_m=stance.legs[foot].place_m + up)
        chain = stance.pitch_anchors_m(leg)
        if len(leg.columns) <= POINT_LEG:
            chain = np.vstack([chain, leg.place_m])
        else:
            soles.append(0.5 * stance.sole_m(leg))
        if len(chain) != CHAIN:
            raise InputError(
                f"a leg of robot {robot.name} has {len(leg.columns)} joints, {len(chain)} points "
                "from hip to foot; valid on stairs: hip, knee, and a point foot or an ankle"
            )
        hip, knee, end = chain
        height = float(hip[2] - end[2])
        length = float(np.linalg.norm(knee - hip) + np.linalg.norm(end - knee))
        least, most = (share * length for share in LENGTHS)
        shifts = [
            (ahead, above)
            for ahead in np.linspace(-AHEAD_M, AHEAD_M, GRID)
            for above in np.linspace(*(ABOVE_M if robot.leans else ABOVE_UPRIGHT_M), GRID)
            if least < np.hypot(ahead, height - above) < most
        ]
        both = [stance.reach_and_bear(leg, np.array([a, 0.0, above])) for a, above in shifts]
        terms = np.prod(np.array(shifts)[:, None] ** np.array(POWERS), axis=2)
        for values, rows in zip(zip(*both, strict=True), (reach, bear), strict=True):
            solution, *_ = np.linalg.lstsq(terms, np.array(values), rcond=None)
            rows += solution.round(4).tolist()
        heights.append(height)
        lengths.append(length)
        lifts.append(stance.lift_m(leg, np.array(swing)))
    length = float(np.mean(lengths))
    return Footing(
        scan_x_m=tuple(round(FIRST_M + SPACING_M * k, 3) for k in range(ROWS)),
        scan_y_m=tuple(sorted({round(y, 4) for _, y in gait.foot_xy_m})),
        base_height_m=robot.base_height_m,
        step_m=round(float(np.mean(lifts)), 3),
        clearance_m=CLEARANCE_M,
        leg_m=(float(np.mean(heights)), LENGTHS[0] * length, LENGTHS[1] * length),
        reach_rad=tuple(tuple(row) for row in reach),
        bear_rad=() if robot.leans else tuple(tuple(row) for row in bear),
        lean=1.0 if robot.leans else 0.0,
        crouch_m=0.0 if robot.leans else CROUCH_M,
        sole_m=round(float(np.mean(soles)), 3) if soles else 0.0,
    )
