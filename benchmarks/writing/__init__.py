"""Writing LeRobot's format: by LeRobot itself, by the obvious script, and by vlnpe."""
