"""How a process looks for memory that nobody uses."""

import gc


def collect_cycles_less_often() -> None:
    """Look for cycles of objects less often: most of what imports make lasts."""
    gc.set_threshold(10_000)
