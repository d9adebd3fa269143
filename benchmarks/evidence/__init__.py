"""Worth of the data: recipes and results behind docs/results/data.md."""
