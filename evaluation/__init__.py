"""Closed loop: policies see what the robot sees, choose its actions, and are scored."""
