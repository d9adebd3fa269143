"""Threads of torch, which commands import late."""

import os

from ....formats.process.threads import available_cores


def start_torch(threads: int) -> None:
    """Import torch and limit it to `threads` threads; 0 takes one per core."""
    count = threads or available_cores()
    # Torch reads it once, when it is imported.
    os.environ.setdefault("OMP_NUM_THREADS", str(count))
    import torch

    torch.set_num_threads(count)
