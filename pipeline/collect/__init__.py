"""Chains of stages: from scans to episodes, from episodes to datasets, and evaluation."""
