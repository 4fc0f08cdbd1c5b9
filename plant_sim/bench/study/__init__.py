"""Studies: the papers' experiments and one's own, run on the twin and set beside what was printed."""
