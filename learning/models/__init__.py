"""The models: their parts, and the registry that names them."""
