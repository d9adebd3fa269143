"""Level surfaces, the storeys that they make, and the stairs between them."""
