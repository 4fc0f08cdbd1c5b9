"""What needs both sides: the twin in lock step, trials and their reports, benchmarks."""
