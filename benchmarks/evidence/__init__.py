"""What the data is worth: recipes and results behind docs/results/data.md."""
