"""What the data is worth: the tables behind docs/results/data.md, trained, evaluated and judged."""
