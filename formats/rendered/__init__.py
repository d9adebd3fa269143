"""A rendered view of a rollout: its folder, and the per-frame columns taken from it."""
