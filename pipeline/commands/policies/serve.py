"""Command `serve`: a policy for programs outside, over HTTP."""

import sys

from ....evaluation.policies.names import MAPS, MODEL_POLICIES, ORACLE
from ....evaluation.policies.registry import resolve_policy
from ....formats.core.errors import InputError
from ....learning.card import read_card
from ...options.evaluate import Serve


def run(options: Serve) -> int:
    """Serve until interrupted.

    Raises:
        InputError: If the policy is unknown or cannot be served, or the address cannot be used.
    """
    policy = resolve_policy(options.policy)
    if policy.is_server or policy.name in (ORACLE, *MAPS, *MODEL_POLICIES):
        raise InputError(
            f"{policy.name} cannot be served: it needs more than images and words; "
            "valid: a learned policy, random, forward, stop"
        )
    from ....evaluation.http.server import DualServer, listen

    policy.identity()  # a damaged checkpoint is said before anything listens
    path = policy.checkpoint
    needs_pose = path is not None and read_card(path)[0].config.model.name == "rdp"
    app = DualServer(policy.make(options.seed), options.instruction, needs_pose=needs_pose)
    try:
        server = listen(app, options.host, options.port)
    except OSError as error:
        raise InputError(
            f"--host {options.host} --port {options.port}: cannot be listened on ({error}); valid: "
            "an address of this machine, 0.0.0.0 for all, and a free port"
        ) from error
    address = f"http://{options.host}:{server.server_port}"
    sys.stdout.write(f"serving {policy.name} on {address}; POST /eval_dual\n")
    sys.stdout.flush()
    server.serve_forever()
    return 0
