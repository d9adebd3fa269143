"""What a scan file holds: reading meshes and point clouds safely."""
