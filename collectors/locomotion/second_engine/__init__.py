"""The gaits in another physics engine."""
