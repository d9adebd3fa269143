"""LeRobot datasets and MCAP files of rollouts: items and jobs."""
