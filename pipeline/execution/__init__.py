"""Runs work items: the stage runner, and executors on this machine or a cluster."""
