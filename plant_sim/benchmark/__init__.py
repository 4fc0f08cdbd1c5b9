"""Benchmarks of the speeds stated in the documentation."""
