"""What the data is worth: the tables of docs/evidence.md, trained, evaluated and judged."""
