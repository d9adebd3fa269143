"""NVIDIA's Jetbot."""
