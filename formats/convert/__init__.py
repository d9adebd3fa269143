"""From one format to another: LeRobot v3 ↔ MCAP, by way of episode units."""
