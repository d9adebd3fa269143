"""MCAP files: rollouts (physics truth) and episodes with images, both open in Foxglove."""
