"""Read scan files safely: meshes and point clouds."""
