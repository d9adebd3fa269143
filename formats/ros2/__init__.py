"""Bags of ROS 2: MCAP files of profile `ros2` with CDR messages, read and written by `rosbags`."""
