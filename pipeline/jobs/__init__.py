"""The work of each stage's items, one module per kind; keys cover exactly what it imports."""
