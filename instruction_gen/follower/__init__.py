"""Second reading: follow a text through the map, without the facts it was made from."""

from .follow import Followed, follow
from .world import World

__all__ = ["Followed", "World", "follow"]
