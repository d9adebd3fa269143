"""Serve your own policy to `vlnpe evaluate`: python examples/own_policy.py [PORT].

    python examples/own_policy.py 8765 &
    vlnpe evaluate runs/apartment-0 --robot aliengo --policy ws://127.0.0.1:8765

It may run in its own environment or on another machine: instead of installing vlnpe, copy
`evaluation/server.py`, which needs numpy, msgpack and websockets.
"""

import sys
from typing import Any

import numpy as np

from vlnpe.evaluation.server import serve

FORWARD, LEFT = 1, 2
STOP = 0


class KeepClear:
    """Walk ahead while there is room, else turn left; put your model in the place of this."""

    images = True
    version = "keep-clear 1"  # results are reused for the same version only

    def reset(self, episode: dict[str, Any]) -> None:
        """Begin an episode; `episode` has the instruction, the robot, and the kind of actions."""
        self.said = f"told: {episode['instruction']}"

    def act(self, observation: dict[str, Any]) -> int:
        """Return the next action; `rgb` is (H, W, 3) uint8, `depth_m` (H, W) float32 [m]."""
        if observation["step"] >= 30:
            return STOP
        depth_m = observation["depth_m"]
        height, width = depth_m.shape
        ahead = depth_m[height // 3 : height // 2, width // 3 : -width // 3]
        seen = ahead[ahead > 0]  # 0: nothing measured
        return FORWARD if np.size(seen) and np.median(seen) > 1.0 else LEFT


if __name__ == "__main__":
    serve(KeepClear, port=int(sys.argv[1]) if len(sys.argv) > 1 else 8765)
