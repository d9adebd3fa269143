"""The scene and the robot as arrays for the kernels."""
