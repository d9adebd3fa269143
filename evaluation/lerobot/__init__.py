"""LeRobot's own evaluation in our closed loop: `lerobot-eval --env.type=vlnpe`."""
