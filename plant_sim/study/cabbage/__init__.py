"""Analysis of the cabbage paper's data."""
