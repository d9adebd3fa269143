"""Reading glTF: checks, buffers and textures."""
