"""The contract between a gait and a robot: the card for deployment."""

from .card import deployment, write_deployment

__all__ = ["deployment", "write_deployment"]
