"""Rays through triangle meshes: Embree and its packets."""
