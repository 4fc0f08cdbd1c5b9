"""Contents of the pages: state, texts, trends, metrics."""
